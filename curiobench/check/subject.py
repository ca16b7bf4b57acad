"""What the properties are checked on: a curiosity method in a task's sizes, batches, and an agent."""

import copy
import random
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from curiobench.methods.agents.pairs import PairLayout
from curiobench.methods.agents.sac import SAC
from curiobench.methods.agents.settings import SACConfig
from curiobench.methods.reward import Batch, Collected, IntrinsicReward, PolicyView, Transitions
from curiobench.tasks.spec import EPISODE_STEPS

BATCH = 64
"""Transitions in a batch, unless a property asks for more."""


@dataclass(frozen=True)
class Subject:
    """A curiosity method in a task's sizes."""

    method: type[IntrinsicReward]
    """Its class; settings are its defaults."""
    layout: PairLayout
    """Sizes of observations, actions and goals."""

    def fresh(self, generator: torch.Generator | None = None) -> IntrinsicReward:
        """A new one, drawn from a generator of its own if none is given."""
        sizes = self.layout.observation_size, self.layout.action_size
        goals = {"goal_size": self.layout.goal_size} if self.method.uses_policy else {}
        return self.method(*sizes, self.method.Config(), generator or torch.Generator().manual_seed(0), **goals)

    def trained(self, generator: torch.Generator | None = None) -> IntrinsicReward:
        """One that has learned from three batches."""
        method = self.fresh(generator)
        for seed in range(3):
            method.observe(self.collected(seed))
            method.reward(self.transitions(seed))
            method.update(self.transitions(seed))
        return method

    def transitions(self, seed: int, size: int = BATCH) -> Transitions:
        """Noise, equal for equal seeds, in tensors of its own; with a policy's view and particles if asked for."""
        generator = torch.Generator().manual_seed(seed)
        observation, action = self.layout.observation_size, self.layout.action_size
        states = [torch.randn((size, observation), generator=generator).clamp(-5, 5) for _ in range(2)]
        stored = torch.rand((size, action), generator=generator) * 2 - 1
        view = self.view(seed, size) if self.method.uses_policy else None
        seen = Transitions(states[0], stored, states[1], epoch=3, policy=view, particles=self.particles(seed))
        return replace(seen, **self.around(seed, states))

    def around(self, seed: int, states: list[Tensor]) -> dict[str, Tensor]:
        """Further fields of transitions with these states (B, D): random episodes that contain them."""
        size, generator = len(states[0]), torch.Generator().manual_seed(300 + seed)
        step = torch.randint(EPISODE_STEPS, (size,), generator=generator)
        found = {"step": step, "episode": torch.randperm(size, generator=generator)}
        goals = self.goals(generator, size * (EPISODE_STEPS + 1)).unflatten(0, (size, -1))
        rows = torch.arange(size)
        found |= {"achieved_goal": goals[rows, step], "next_achieved_goal": goals[rows, step + 1]}
        found |= {"raw_state": 2 * states[0] + 1, "raw_next_state": 2 * states[1] + 1}
        if self.method.uses_episode:
            shape = (size, EPISODE_STEPS + 1, self.layout.observation_size)
            found["episode_states"] = torch.randn(shape, generator=generator).clamp(-5, 5)
            found["episode_states"][rows, step], found["episode_states"][rows, step + 1] = states
            found["episode_achieved_goals"] = goals
        return found

    def collected(self, seed: int) -> Collected:
        """Four episodes of noise."""
        generator = torch.Generator().manual_seed(400 + seed)
        states = torch.randn((4, EPISODE_STEPS + 1, self.layout.observation_size), generator=generator).clamp(-5, 5)
        actions = torch.rand((4, EPISODE_STEPS, self.layout.action_size), generator=generator) * 2 - 1
        return Collected(states, actions, self.goals(generator, 4 * (EPISODE_STEPS + 1)).unflatten(0, (4, -1)))

    def particles(self, seed: int) -> Tensor | None:
        """As many states as the method asks for."""
        size = self.fresh().n_particles, self.layout.observation_size
        return torch.randn(size, generator=torch.Generator().manual_seed(200 + seed)) if size[0] else None

    def view(self, seed: int, size: int = BATCH) -> PolicyView:
        """Of a uniformly random policy that pursues random goals."""
        generator = torch.Generator().manual_seed(100 + seed)
        action = torch.rand((size, self.layout.action_size), generator=generator) * 2 - 1
        log_prob = torch.full((size,), -self.layout.action_size * float(np.log(2)))
        return PolicyView(self.goals(generator, size), action, log_prob, log_prob.clone())

    def goals(self, generator: torch.Generator, size: int) -> Tensor:
        """Random bits (size, bits)."""
        return torch.randint(2, (size, self.layout.goal_size), generator=generator).float()

    def batch(self, size: int = BATCH) -> Batch:
        """Noise, for an agent."""
        generator = torch.Generator().manual_seed(0)
        seen = self.transitions(0, size)
        goals = [self.goals(generator, size) for _ in range(3)]
        reward = torch.rand(size, generator=generator).round()
        of_episodes = {
            "episode_observation": seen.episode_states,
            "episode_achieved_goal": seen.episode_achieved_goals,
        }
        given = {name: getattr(seen, name) for name in ("step", "episode", "particles")}
        return Batch(seen.state, seen.action, seen.next_state, *goals, reward, **given, **of_episodes)

    def agent(self, method: IntrinsicReward | None = None) -> SAC:
        """A small agent."""
        return SAC(self.layout, SACConfig(hidden=64), torch.Generator().manual_seed(0), method)


def snapshot(method: IntrinsicReward) -> dict[str, Any]:
    """A copy of a method's state, as the agent keeps it."""
    return copy.deepcopy(method.state_dict())


def same(first: Any, second: Any) -> bool:
    """Whether nested states are equal to the bit; NaN is equal to NaN here, for finiteness is another property."""
    if isinstance(first, Tensor) and isinstance(second, Tensor):
        if first.shape != second.shape or first.dtype != second.dtype:
            return False
        return bool(((first == second) | ((first != first) & (second != second))).all())
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return np.array_equal(first, second)
    if isinstance(first, dict) and isinstance(second, dict):
        return first.keys() == second.keys() and all(same(value, second[key]) for key, value in first.items())
    if isinstance(first, list | tuple) and isinstance(second, list | tuple):
        return len(first) == len(second) and all(map(same, first, second))
    if isinstance(first, PolicyView) and isinstance(second, PolicyView):
        return same(vars(first), vars(second))
    return bool(np.all(first == second))


@contextmanager
def seeded_globals() -> Iterator[None]:
    """Global random generators in a known state; afterwards they are as before."""
    before = global_generators()
    torch.manual_seed(0)
    np.random.seed(0)  # noqa: NPY002 - the global one is what is meant
    random.seed(0)
    try:
        yield
    finally:
        torch.set_rng_state(before[0])
        np.random.set_state(before[1])  # noqa: NPY002
        random.setstate(before[2])


def global_generators() -> tuple[Tensor, tuple, tuple]:
    """States of the global generators of torch, numpy and Python."""
    return torch.get_rng_state(), np.random.get_state(), random.getstate()  # noqa: NPY002
