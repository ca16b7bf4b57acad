"""What a curiosity method is: a reward for a batch of transitions, and one gradient step on its own networks.

A method does not know which agent uses it, and the agent does not know which method it has. An agent does, per batch::

    transitions = Transitions(normalised states, actions, normalised next states, epoch, ...)
    r_int = method.reward(transitions)          # before the method learns from this very batch
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
    """Sampled transitions as the replay gives them: raw, relabelled, in the task's units."""

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
    """(B, T + 1, D) of each transition's whole episode; only for a method that asks for them."""
    episode_achieved_goal: Tensor | None = None
    """(B, T + 1, bits) likewise."""

    @classmethod
    def from_numpy(cls, arrays: Mapping[str, np.ndarray | None]) -> "Batch":
        """Arrays named like the fields, shared without copying. Raises TypeError on a missing or unknown name."""
        return cls(**{name: torch.from_numpy(array) for name, array in arrays.items() if array is not None})


@dataclass(frozen=True)
class PolicyView:
    """What the agent's policy does in a batch's states, for a method with `uses_policy`. Carries no gradients."""

    desired_goal: Tensor
    """(B, bits) that the policy pursues, the batch's, relabelled or not."""
    action: Tensor
    """(B, A) drawn from pi(. | s, g)."""
    log_prob: Tensor
    """(B,) log pi of `action`."""
    stored_log_prob: Tensor
    """(B,) log pi of the batch's own actions."""


@dataclass(frozen=True)
class Transitions:
    """What a curiosity method sees of a batch. There is no desired goal: relabelling must not change what is novel.

    Training fills the fields from `achieved_goal` to `episode`. Code that calls a method itself may leave out what the
    method does not read.
    """

    state: Tensor
    """(B, D) normalised and clipped to ±5."""
    action: Tensor
    """(B, A) in [-1, 1]."""
    next_state: Tensor
    """(B, D) normalised and clipped to ±5."""
    epoch: int
    """Epoch of training, from 0, in a run of the paper's 500; shorter runs count faster. MI's weight of
    conservativeness depends on it."""
    policy: PolicyView | None = None
    """Only for a method with `uses_policy`, which then sees goals."""
    particles: Tensor | None = None
    """(P, D) states drawn uniformly over all steps of the replay, normalised and clipped to ±5; only for a method with
    `n_particles`. A batch is no such sample: it is balanced over goals."""
    achieved_goal: Tensor | None = None
    """(B, bits) predicates that hold before the step, 0 or 1."""
    next_achieved_goal: Tensor | None = None
    """(B, bits) predicates that hold after the step, 0 or 1."""
    raw_state: Tensor | None = None
    """(B, D) all of the observation before the step, in the task's units."""
    raw_next_state: Tensor | None = None
    """(B, D) all of the observation after the step, in the task's units."""
    step: Tensor | None = None
    """(B,) of the episode, from 0, before the action."""
    episode: Tensor | None = None
    """(B,) number of the episode, counted over the run."""
    episode_states: Tensor | None = None
    """(B, T + 1, D) states of each transition's whole episode, normalised and clipped to ±5; only for a method with
    `uses_episode`. The transition leads from place `step` to the next."""
    episode_achieved_goals: Tensor | None = None
    """(B, T + 1, bits) predicates that hold in them; likewise."""

    def rows(self, places: Tensor) -> "Transitions":
        """Those at places (N,) of the batch."""
        parts: dict[str, Any] = {
            name: part[places] for name, part in vars(self).items() if isinstance(part, Tensor) and name != "particles"
        }
        if self.policy is not None:
            parts["policy"] = PolicyView(**{name: part[places] for name, part in vars(self.policy).items()})
        return replace(self, **parts)


def given(part: Part | None, name: str) -> Part:
    """A part of `Transitions` that a method reads; raises ValueError where the caller left it out."""
    if part is None:
        raise ValueError(f"this method needs `Transitions.{name}`, which is None")
    return part


@dataclass(frozen=True)
class Collected:
    """N freshly collected episodes of T steps, as a curiosity method sees them."""

    states: Tensor
    """(N, T + 1, D) normalised and clipped to ±5."""
    actions: Tensor
    """(N, T, A) in [-1, 1]."""
    achieved_goals: Tensor
    """(N, T + 1, bits) predicates that hold, 0 or 1."""


class IntrinsicReward(ABC):
    """One curiosity method. Subclasses take `(state_size, action_size, config, generator)`, `config` being an instance
    of their own frozen dataclass `Config`; all randomness comes from the torch.Generator, whose device is the method's.
    With `uses_policy` they also take `goal_size`.
    """

    Config: type
    uses_policy: ClassVar[bool] = False
    """Ask the agent for a `PolicyView`. Its reward may then change with the goal; DAC needs that, a method that scores
    states must not."""

    sees: Sees = "full"
    """What of the state the agent puts into `Transitions`. A method with a setting of that name takes it from there,
    and its `state_size` is that of what it sees."""

    uses_episode: ClassVar[bool] = False
    """Ask the agent for the whole episode of each transition, for novelty within an episode."""

    n_particles: int = 0
    """How many states of the replay the agent is asked for in each batch, as `Transitions.particles`."""

    @abstractmethod
    def reward(self, transitions: Transitions) -> Tensor:
        """r_int (B,), raw, finite and without gradients. Changes nothing in the method."""

    @abstractmethod
    def update(self, transitions: Transitions) -> dict[str, Tensor]:
        """One gradient step on the method's own networks (or none). Metrics by name, as scalar tensors."""

    def observe(self, episodes: Collected) -> None:  # noqa: B027 - optional
        """Learn from episodes that were just collected, such as visits to count. Each episode comes once."""

    def bonus_factor(self, epoch: int) -> float:
        """Factor of tau in an epoch of the paper's 500, at least 0: for a bonus that is to fade (RE3).

        A factor within `reward` would do nothing of the kind, since rewards are normalised after it.
        """
        return 1.0

    def policy_loss_term(self, transitions: Transitions, desired_goal: Tensor, action: Tensor) -> Tensor | None:
        """Optional (B,), added to log pi(a | s, g) in the policy's loss; None for all methods but DAC.

        `action` (B, A) was just drawn from the policy and carries its gradients; `desired_goal` is (B, bits).
        """
        return None

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """All that the method holds: networks, optimisers, statistics, generator. Tensors and plain values only."""

    @abstractmethod
    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore what `state_dict` gave, so that training continues to the bit."""
