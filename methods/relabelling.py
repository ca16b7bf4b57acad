"""What a relabelling is: it decides which transitions of the replay a batch holds, and under which goals."""

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
    """`(capacity, T + 1)` position of the achieved goal among the valid ones, -1 where it is none of them."""

    def __len__(self) -> int: ...

    def draw_episodes(self, uniform: np.ndarray) -> np.ndarray:
        """Slots `(B,)` from uniform numbers `(2, B)`: as balanced over goals as the run asks for."""
        ...


class Relabelling(GoalMethod):
    """Draws transitions. It keeps no state: a checkpoint does not hold it."""

    @abstractmethod
    def draw(self, replay: Replay, size: int, generator: np.random.Generator) -> Draw:
        """`size` transitions; all randomness from the generator."""
