"""Which goals training episodes pursue.

A curriculum is a function of the goals reached so far and of where the episodes start. It returns positions `(N,)` in
the list of valid goals.

reached     the paper's: uniform over goals that an episode has ended in.
near        ours: half of the episodes pursue a reached goal that differs from their start in few predicates.
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

NEAR_SHARE = 0.5
"""Share of the episodes whose goal `near` draws near their start."""


@dataclass(frozen=True)
class Situation:
    """What a curriculum may look at."""

    valid_goals: np.ndarray
    """`(G, bits)` all goals, 0 or 1."""
    reached: np.ndarray
    """`(G,)` bool, which of them an episode has ended in."""
    start: np.ndarray
    """`(N, bits)` predicates that hold where each episode starts."""


def draw_reached(situation: Situation, generator: np.random.Generator) -> np.ndarray:
    """Uniform over goals already reached; while there is none, which is in the first rollout, over all valid goals."""
    return generator.choice(_candidates(situation), len(situation.start))


def draw_near(situation: Situation, generator: np.random.Generator) -> np.ndarray:
    """Half as `draw_reached`, half with probability in proportion to exp(-d), d the predicates that differ at start.

    A goal that holds at the start is not among the near ones, unless there is no other.
    """
    goals = draw_reached(situation, generator)
    candidates = _candidates(situation)
    distance = (situation.valid_goals[candidates] != situation.start[:, None]).sum(-1)
    weights = np.exp(-distance.astype(float)) * (distance > 0)
    cumulated = np.cumsum(weights, axis=1)
    uniform = generator.random((2, len(goals)))
    near = (cumulated > uniform[0, :, None] * cumulated[:, -1:]).argmax(axis=1)
    chosen = (uniform[1] < NEAR_SHARE) & (cumulated[:, -1] > 0)
    return np.where(chosen, candidates[near], goals)


CURRICULA: MappingProxyType[str, Callable[[Situation, np.random.Generator], np.ndarray]] = MappingProxyType(
    {"reached": draw_reached, "near": draw_near}
)
"""By the name that `RunConfig.curriculum` gives."""

Curriculum = Literal[tuple(CURRICULA)]
"""Names of curricula."""


def _candidates(situation: Situation) -> np.ndarray:
    reached = situation.reached
    return np.flatnonzero(reached) if reached.any() else np.arange(len(reached))
