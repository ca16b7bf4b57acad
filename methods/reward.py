"""The interface of a curiosity method: a reward for a batch of transitions, and one gradient step on its own networks.

Methods and agents do not depend on each other. For each batch an agent does::

    transitions = Transitions(normalised states, actions, normalised next states, epoch, ...)
    r_int = method.reward(transitions)          # before the method learns from this batch
    metrics = method.update(transitions)
    r = r_ext + tau · method.bonus_factor(epoch) · normalise(r_int)    # by past statistics of r_int
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeVar

import numpy as np
import torch
from torch import Tensor

from curiobench.methods.checks import Sees

Part = TypeVar("Part")


@dataclass(frozen=True)
class Batch:
    """Sampled transitions from the replay: raw, in the task's units, with relabelled goals."""

    observation: Tensor
    """(B, D) before the step."""
    action: Tensor
    """(B, A) in [-1, 1]."""
    next_observation: Tensor
    """(B, D) after the step."""
    achieved_goal: Tensor
    """(B, bits) before the step."""
    next_achieved_goal: Tensor
    """(B, bits) after the step."""
    desired_goal: Tensor
    """(B, bits), relabelled or not."""
    reward: Tensor
    """(B,) r_ext of the step under `desired_goal`."""
    step: Tensor | None = None
    """(B,) of the episode, from 0, before the action."""
    episode: Tensor | None = None
    """(B,) number of the episode, counted over the run."""
    particles: Tensor | None = None
    """(P, D) observations drawn uniformly over all steps of the replay; only for a method that asks for them."""
    episode_observation: Tensor | None = None
    """(B, T + 1, D) of each transition's complete episode; only for a method with `uses_episode`."""
    episode_achieved_goal: Tensor | None = None
    """(B, T + 1, bits) likewise."""

    @classmethod
    def from_numpy(cls, arrays: Mapping[str, np.ndarray | None]) -> "Batch":
        """A batch that shares memory with arrays named like its fields. Raises TypeError if names do not match."""
        return cls(**{name: torch.from_numpy(array) for name, array in arrays.items() if array is not None})


@dataclass(frozen=True)
class PolicyView:
    """Actions and log-densities of the policy in a batch's states, for a method with `uses_policy`. No gradients."""

    desired_goal: Tensor
    """(B, bits) goals that the policy pursues: those of the batch, after relabelling."""
    action: Tensor
    """(B, A) drawn from pi(. | s, g)."""
    log_prob: Tensor
    """(B,) log pi of `action`."""
    stored_log_prob: Tensor
    """(B,) log pi of the batch's own actions."""


@dataclass(frozen=True)
class Transitions:
    """A batch as a curiosity method gets it. It has no desired goal, because relabelling must not change what is novel.

    Training fills the fields from `achieved_goal` to `episode`. Other callers may leave out fields that the method does
    not read.
    """

    state: Tensor
    """(B, D) normalised and clipped to ±5."""
    action: Tensor
    """(B, A) in [-1, 1]."""
    next_state: Tensor
    """(B, D) normalised and clipped to ±5."""
    epoch: int
    """Epoch of training from 0, scaled so that every run has the paper's 500. MI's weight of conservativeness depends
    on it."""
    policy: PolicyView | None = None
    """Only for a method with `uses_policy`; the one field with desired goals."""
    particles: Tensor | None = None
    """(P, D) states drawn uniformly over all steps of the replay, normalised and clipped to ±5; only for a method with
    `n_particles`. (A batch is balanced over goals, so it is not a uniform sample.)"""
    achieved_goal: Tensor | None = None
    """(B, bits) predicates that hold before the step, 0 or 1."""
    next_achieved_goal: Tensor | None = None
    """(B, bits) predicates that hold after the step, 0 or 1."""
    raw_state: Tensor | None = None
    """(B, D) all of the observation before the step, not normalised: metres, radians, and these per control step."""
    raw_next_state: Tensor | None = None
    """(B, D) all of the observation after the step, not normalised."""
    step: Tensor | None = None
    """(B,) of the episode, from 0, before the action."""
    episode: Tensor | None = None
    """(B,) number of the episode, counted over the run."""
    episode_states: Tensor | None = None
    """(B, T + 1, D) states of the transition's episode, normalised and clipped to ±5; only for a method with
    `uses_episode`. The transition leads from index `step` to `step + 1`."""
    episode_achieved_goals: Tensor | None = None
    """(B, T + 1, bits) predicates that hold in `episode_states`; only for a method with `uses_episode`."""

    def rows(self, places: Tensor) -> "Transitions":
        """The transitions at indices (N,) of the batch."""
        parts: dict[str, Any] = {
            name: part[places] for name, part in vars(self).items() if isinstance(part, Tensor) and name != "particles"
        }
        if self.policy is not None:
            parts["policy"] = PolicyView(**{name: part[places] for name, part in vars(self.policy).items()})
        return replace(self, **parts)


def given(part: Part | None, name: str) -> Part:
    """A part of `Transitions` that a method reads; raises ValueError if the caller left it out."""
    if part is None:
        raise ValueError(f"this method needs `Transitions.{name}`, which is None")
    return part


@dataclass(frozen=True)
class Collected:
    """N newly collected episodes of T steps, as a curiosity method gets them."""

    states: Tensor
    """(N, T + 1, D) normalised and clipped to ±5."""
    actions: Tensor
    """(N, T, A) in [-1, 1]."""
    achieved_goals: Tensor
    """(N, T + 1, bits) predicates that hold, 0 or 1."""


class IntrinsicReward(ABC):
    """A curiosity method.

    Subclasses are built with `(state_size, action_size, config, generator)`, and with `goal_size` if `uses_policy`.
    `config` is an instance of their frozen dataclass `Config`. All randomness comes from the torch.Generator, and its
    device is the method's.
    """

    Config: type
    uses_policy: ClassVar[bool] = False
    """Get a `PolicyView` with each batch. The reward may then depend on the goal, as DAC's does; a method that scores
    states must not."""

    sees: Sees = "full"
    """Which part of the state `Transitions` holds. A method with a setting `sees` takes it from there. `state_size` is
    the size of that part."""

    uses_episode: ClassVar[bool] = False
    """Get the complete episode of each transition, for novelty within an episode."""

    n_particles: int = 0
    """Number of states of the replay that come with each batch as `Transitions.particles`."""

    @abstractmethod
    def reward(self, transitions: Transitions) -> Tensor:
        """r_int (B,), raw, finite and without gradients. Must not change the method."""

    @abstractmethod
    def update(self, transitions: Transitions) -> dict[str, Tensor]:
        """One gradient step on the method's own networks, if it has any. Returns metrics by name, as scalar tensors."""

    def observe(self, episodes: Collected) -> None:  # noqa: B027 - optional
        """Learn from newly collected episodes, for example by counting visits. Each episode comes once."""

    def bonus_factor(self, epoch: int) -> float:
        """Factor of tau, at least 0, by epoch on the paper's scale of 500: for a bonus that decays (RE3).

        A factor within `reward` would have no effect, because rewards are normalised afterwards.
        """
        return 1.0

    def policy_loss_term(self, transitions: Transitions, desired_goal: Tensor, action: Tensor) -> Tensor | None:
        """An optional term (B,) that is added to log pi(a | s, g) in the policy's loss. Only DAC has one.

        `action` (B, A) was just drawn from the policy and carries its gradients; `desired_goal` is (B, bits).
        """
        return None

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """All state of the method: networks, optimisers, statistics, generator. Tensors and plain values only."""

    @abstractmethod
    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a `state_dict`, so that training continues bit for bit."""
