"""Classes of the methods in `specs.BUILT_IN`, and functions that make an agent from a method spec such as `sac`.

A method is a class of one of three kinds: an intrinsic reward, a curriculum or a relabelling.

Methods that are not built in need no registration here; see plugins.py.
"""

import difflib
import importlib
from collections.abc import Callable
from dataclasses import dataclass

import torch

from curiobench.methods.agents.agent import LearningAgent
from curiobench.methods.agents.hybrid import HybridAgent
from curiobench.methods.agents.pairs import PairLayout
from curiobench.methods.agents.sac import SAC
from curiobench.methods.agents.settings import HybridConfig, SACConfig
from curiobench.methods.curriculum import Curriculum
from curiobench.methods.plugins import Method, building, load_class, load_installed, trace
from curiobench.methods.relabelling import Relabelling
from curiobench.methods.reward import IntrinsicReward
from curiobench.methods.specs import BUILT_IN, HYBRID, available_specs, canonical, installed_methods, split


def _built_in(place: str) -> type[Method]:
    """The class at a `module:Class` of this package."""
    module, _, name = place.partition(":")
    return getattr(importlib.import_module(f"curiobench.methods.{module}"), name)


_BUILT_IN: dict[str, type[Method]] = {spec: _built_in(method.place) for spec, method in BUILT_IN.items()}


@dataclass(frozen=True)
class MethodSpec:
    """A parsed method spec."""

    text: str
    """Canonical form of the spec: aliases resolved, lower case except for `package.module:Class`."""
    method: type[Method] | None
    """The class; None for `sac`."""
    hybrid: bool = False
    """Whether the hybrid policy mechanism collects the data."""

    @property
    def reward(self) -> type[IntrinsicReward] | None:
        """The class if it is an intrinsic reward."""
        return self._if_a(IntrinsicReward)

    @property
    def curriculum(self) -> type[Curriculum] | None:
        """The class if it is a curriculum."""
        return self._if_a(Curriculum)

    @property
    def relabelling(self) -> type[Relabelling] | None:
        """The class if it is a relabelling."""
        return self._if_a(Relabelling)

    def _if_a(self, kind: type) -> type | None:
        return self.method if self.method is not None and issubclass(self.method, kind) else None


def parse_spec(text: str) -> MethodSpec:
    """Read a method spec: one of `available_specs`, `package.module:Class`, or `package.module:Class+hm`.

    Raises ValueError with the nearest legal spec or, for a method that is not built in, its file and what is wrong.
    """
    spec = canonical(text)
    name, hybrid = split(spec)
    if spec == "sac":
        return MethodSpec(spec, None)
    if name in _BUILT_IN:
        found = MethodSpec(spec, _BUILT_IN[name], hybrid)
    elif ":" in name:
        found = MethodSpec(spec, load_class(name, name), hybrid)
    elif name in installed_methods():
        found = MethodSpec(spec, load_installed(name), hybrid)
    else:
        found = None
    if hybrid and (name == "sac" or (found is not None and found.reward is None)):
        why = f"{HYBRID} needs a method with an intrinsic reward, and {name} has none"
        hybrids = ", ".join(known for known in available_specs() if known.endswith(HYBRID))
        raise ValueError(f"method {text!r}: {why}; use one of {hybrids}")
    if found is not None:
        return found
    known = available_specs()
    near = difflib.get_close_matches(spec, known, n=1, cutoff=0.0)
    legal = f"{', '.join(known)}, package.module:Class"
    raise ValueError(f"unknown method {text!r}; the nearest is {near[0]!r}; available: {legal}")


def traced(spec: str) -> dict[str, str]:
    """File and digest of a spec's method, by `plugins.trace`; empty for a built-in method."""
    method = parse_spec(spec).method
    return {} if method is None or method in _BUILT_IN.values() else trace(method)


def make_agent(
    spec: str,
    layout: PairLayout,
    config: SACConfig,
    generator: torch.Generator,
    hybrid: HybridConfig | None = None,
    settings: object | None = None,
) -> LearningAgent:
    """The agent of a method spec, on the generator's device.

    Args:
        spec: see `parse_spec`.
        layout: columns of blocks and predicate bits in observations and goals.
        config: settings of the agent.
        generator: source of all randomness of agent and method.
        hybrid: settings of the hybrid policy mechanism, used with `+hm` only; its defaults if None.
        settings: settings of the method, an instance of its `Config`; its defaults if None. Not used for a curriculum
            or relabelling, which is not part of the agent.

    Raises:
        ValueError: the spec is not legal, or the curiosity method cannot be built. The message is one line and names
            the method's file.
    """
    parsed = parse_spec(spec)
    if parsed.reward is None:
        return SAC(layout, config, generator)
    intrinsic = _build(parsed.reward, parsed.text, layout, settings or parsed.reward.Config(), generator)
    if parsed.hybrid:
        return HybridAgent(layout, config, generator, intrinsic, hybrid)
    return SAC(layout, config, generator, intrinsic)


def _build(
    method: type[IntrinsicReward], spec: str, layout: PairLayout, settings: object, generator: torch.Generator
) -> IntrinsicReward:
    goals = {"goal_size": layout.goal_size} if method.uses_policy else {}
    state_size = len(layout.columns(getattr(settings, "sees", method.sees)))
    make: Callable[..., IntrinsicReward] = method  # arguments by convention, see `IntrinsicReward`
    with building(method, spec):
        return make(state_size, layout.action_size, settings, generator, **goals)
