"""The interface of a curriculum, which chooses the goals of training episodes by the outcomes of earlier episodes.

In each cycle a run does:

    goals, tested = curriculum.draw(situation, generator)
    episodes towards these goals; the agent acts by its deterministic policy where `tested`
    curriculum.observe(goals, reached, tested)

and, after each epoch, `curriculum.end_epoch()`.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Goals:
    """The valid goals of a task."""

    bits: np.ndarray
    """`(G, bits)` uint8, 0 or 1."""
    layers: np.ndarray
    """`(G,)` height of the tallest stack, in blocks."""
    pairs: np.ndarray
    """`(P, 3)` indices of close(i, j), on(i, j) and on(j, i) in a goal, for each pair of blocks."""

    @property
    def close(self) -> np.ndarray:
        """`(G, P)` which pairs of blocks are close."""
        return self.bits[:, self.pairs[:, 0]] > 0


@dataclass(frozen=True)
class Situation:
    """What a curriculum knows when it draws goals."""

    reached: np.ndarray
    """`(G,)` bool, which goals an episode has ended in."""
    start: np.ndarray
    """`(N, bits)` predicates that hold at the start of each episode."""


@dataclass(frozen=True)
class NoSettings:
    """A method without settings."""


class GoalMethod(ABC):  # noqa: B024 - its kinds draw different things
    """What curricula and relabellings have in common.

    Subclasses take `(goals, config)`, `config` being an instance of their own frozen `Config`.
    """

    Config: type = NoSettings

    def __init__(self, goals: Goals, config: Any = None) -> None:
        self.goals, self.config = goals, config


class Curriculum(GoalMethod):
    """Draws goals."""

    @abstractmethod
    def draw(self, situation: Situation, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Indices `(N,)` of goals in the list of valid goals, and `(N,)` bool: which episodes are tests. The agent does
        not explore in tests. All randomness comes from the generator.
        """

    def observe(self, goals: np.ndarray, reached: np.ndarray, tested: np.ndarray) -> None:
        """Learn from N episodes: the goals `(N,)` that they pursued, the goals `(N,)` that they ended in (-1 if that
        goal is not valid), and `(N,)` bool: which were tests. Episodes whose physics diverged are left out."""

    def end_epoch(self) -> None:
        """Called after each epoch of training."""

    def replay_weights(self) -> np.ndarray | None:
        """Probabilities `(G,)` with which the replay draws goals; None leaves the choice to the replay."""
        return None

    def metrics(self) -> Mapping[str, float]:
        """Columns of progress.csv; the same names each time."""
        return {}

    def state_dict(self) -> dict[str, Any]:
        """All that the curriculum has learned, as plain values for JSON."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a `state_dict`."""
