"""Which methods exist, and how a method spec such as `sac` becomes an agent. The one place to register a method."""

import difflib
from dataclasses import dataclass

import torch

from curiobench.methods.dac import DAC
from curiobench.methods.icm import ICM
from curiobench.methods.mi import MI
from curiobench.methods.networks import PairLayout
from curiobench.methods.re3 import RE3
from curiobench.methods.reward import IntrinsicReward
from curiobench.methods.rnd import RND
from curiobench.methods.sac import SAC, SACConfig

REWARDS: dict[str, type[IntrinsicReward]] = {"icm": ICM, "rnd": RND, "dac": DAC, "re3": RE3, "mi": MI}
"""Curiosity methods by spec."""

PLANNED = ("mihm",)
"""Specs of the benchmark whose code does not exist yet, beside `X+hm` for every method X."""


@dataclass(frozen=True)
class MethodSpec:
    """A parsed method spec."""

    text: str
    """As written, in lower case."""
    reward: type[IntrinsicReward] | None
    """The curiosity method; None for `sac`."""


def available_specs() -> list[str]:
    """Every spec that `make_agent` accepts."""
    return ["sac", *REWARDS]


def parse_spec(text: str) -> MethodSpec:
    """Read a method spec.

    Raises ValueError, which names the nearest legal spec, or says that a planned method is not implemented yet.
    """
    spec = text.strip().lower()
    if spec in available_specs():
        return MethodSpec(spec, REWARDS.get(spec))
    legal = ", ".join(available_specs())
    base, plus, mechanism = spec.partition("+")
    if base in (*PLANNED, *REWARDS) and (not plus or (mechanism == "hm" and base != "mihm")):
        raise ValueError(f"method {text!r} is not implemented yet; available: {legal}")
    near = difflib.get_close_matches(spec, available_specs(), n=1, cutoff=0.0)
    raise ValueError(f"unknown method {text!r}; the nearest is {near[0]!r}; available: {legal}")


def make_agent(spec: str, layout: PairLayout, config: SACConfig, generator: torch.Generator) -> SAC:
    """The agent of a method spec, on the generator's device.

    Args:
        spec: see `available_specs`. Raises ValueError if it is not among them.
        layout: where blocks and predicate bits stand in observations and goals.
        config: settings of the agent.
        generator: source of all randomness of agent and method.
    """
    reward = parse_spec(spec).reward
    intrinsic = None
    if reward is not None:
        goals = {"goal_size": layout.goal_size} if reward.uses_policy else {}
        intrinsic = reward(layout.observation_size, layout.action_size, reward.Config(), generator, **goals)
    return SAC(layout, config, generator, intrinsic)
