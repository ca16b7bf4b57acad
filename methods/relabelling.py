"""The interface of a relabelling, which draws the transitions of a batch from the replay and chooses their goals."""

from abc import abstractmethod
from typing import Protocol

import numpy as np

from curiobench.methods.curriculum import GoalMethod

Draw = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Slots `(B,)`, steps before the action `(B,)` and desired goals `(B, bits)`."""


class Replay(Protocol):
    """The part of `curiobench.replay.EpisodeReplay` that a relabelling can read."""

    steps: int
    """T, the length of every episode."""
    arrays: dict[str, np.ndarray]
    """achieved_goal `(capacity, T + 1, bits)`, desired_goal `(capacity, bits)`, observation and action by slot; the
    first `len(replay)` slots are filled."""
    goal_ids: np.ndarray
    """`(capacity, T + 1)` index of the achieved goal in the list of valid goals, -1 if it is not valid."""

    def __len__(self) -> int: ...

    def draw_episodes(self, uniform: np.ndarray) -> np.ndarray:
        """Slots `(B,)` from uniform numbers `(2, B)`, balanced over goals according to the run's settings."""
        ...


class Relabelling(GoalMethod):
    """Draws transitions. It is stateless, so checkpoints do not save it."""

    @abstractmethod
    def draw(self, replay: Replay, size: int, generator: np.random.Generator) -> Draw:
        """Draw `size` transitions. All randomness comes from the generator."""
