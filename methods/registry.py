"""Which methods exist, and how a method spec such as `sac` becomes an agent. The one place to register a method."""

import difflib
from dataclasses import dataclass

import torch

from curiobench.methods.dac import DAC
from curiobench.methods.hybrid import HybridAgent, HybridConfig
from curiobench.methods.icm import ICM
from curiobench.methods.mi import MI
from curiobench.methods.networks import PairLayout
from curiobench.methods.re3 import RE3
from curiobench.methods.reward import IntrinsicReward
from curiobench.methods.rnd import RND
from curiobench.methods.sac import SAC, SACConfig

REWARDS: dict[str, type[IntrinsicReward]] = {"icm": ICM, "rnd": RND, "dac": DAC, "re3": RE3, "mi": MI}
"""Curiosity methods by spec."""

HYBRID = "+hm"
"""Behind a curiosity method's spec: that method under the hybrid policy mechanism."""

ALIASES = {"mihm": "mi+hm"}
"""Other names of specs; the paper calls its method MIHM."""


@dataclass(frozen=True)
class MethodSpec:
    """A parsed method spec."""

    text: str
    """The spec's one form: lower case, aliases resolved."""
    reward: type[IntrinsicReward] | None
    """The curiosity method; None for `sac`."""
    hybrid: bool = False
    """Whether the hybrid policy mechanism collects."""


def available_specs() -> list[str]:
    """Every spec that `make_agent` accepts, aliases last."""
    return ["sac", *REWARDS, *(name + HYBRID for name in REWARDS), *ALIASES]


def parse_spec(text: str) -> MethodSpec:
    """Read a method spec.

    Raises ValueError, which names the nearest legal spec.
    """
    spec = text.strip().lower()
    spec = ALIASES.get(spec, spec)
    if spec in available_specs():
        name = spec.removesuffix(HYBRID)
        return MethodSpec(spec, REWARDS.get(name), hybrid=name != spec)
    legal = ", ".join(available_specs())
    if spec == "sac" + HYBRID:
        raise ValueError(f"method {text!r}: the hybrid mechanism needs a curiosity method; available: {legal}")
    near = difflib.get_close_matches(spec, available_specs(), n=1, cutoff=0.0)
    raise ValueError(f"unknown method {text!r}; the nearest is {near[0]!r}; available: {legal}")


def make_agent(
    spec: str,
    layout: PairLayout,
    config: SACConfig,
    generator: torch.Generator,
    hybrid: HybridConfig | None = None,
    settings: object | None = None,
) -> SAC:
    """The agent of a method spec, on the generator's device.

    Args:
        spec: see `available_specs`. Raises ValueError if it is not among them.
        layout: where blocks and predicate bits stand in observations and goals.
        config: settings of the agent.
        generator: source of all randomness of agent and method.
        hybrid: settings of the hybrid policy mechanism, used with `+hm` only; its defaults if None.
        settings: of the curiosity method, an instance of its `Config`; its defaults if None.
    """
    parsed = parse_spec(spec)
    if parsed.reward is None:
        return SAC(layout, config, generator)
    goals = {"goal_size": layout.goal_size} if parsed.reward.uses_policy else {}
    sizes = layout.observation_size, layout.action_size
    intrinsic = parsed.reward(*sizes, settings or parsed.reward.Config(), generator, **goals)
    if parsed.hybrid:
        return HybridAgent(layout, config, generator, intrinsic, hybrid)
    return SAC(layout, config, generator, intrinsic)
