"""The curricula that any method can run under, by the name that `RunConfig.curriculum` gives.

reached     the paper's: uniform over goals that an episode has ended in.
valid       uniform over all valid goals.
near        ours: half of the episodes pursue a reached goal that differs from their start in few predicates.

A method may bring its own instead; see `methods/curriculum.py`.
"""

from types import MappingProxyType
from typing import Literal

import numpy as np

from curiobench.methods.curriculum import Curriculum, Situation

NEAR_SHARE = 0.5
"""Share of the episodes whose goal `near` draws near their start."""


class Reached(Curriculum):
    """Uniform over goals already reached; while there is none, which is in the first rollout, over all valid goals."""

    def draw(self, situation: Situation, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        n = len(situation.start)
        return generator.choice(_candidates(situation), n), np.zeros(n, bool)


class Valid(Curriculum):
    """Uniform over all valid goals."""

    def draw(self, situation: Situation, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        n = len(situation.start)
        return generator.integers(len(self.goals.bits), size=n), np.zeros(n, bool)


class Near(Reached):
    """Half as `Reached`, half with probability in proportion to exp(-d), d the predicates that differ at the start.

    A goal that holds at the start is not among the near ones, unless there is no other.
    """

    def draw(self, situation: Situation, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        goals, tested = super().draw(situation, generator)
        candidates = _candidates(situation)
        distance = (self.goals.bits[candidates] != situation.start[:, None]).sum(-1)
        weights = np.exp(-distance.astype(float)) * (distance > 0)
        cumulated = np.cumsum(weights, axis=1)
        uniform = generator.random((2, len(goals)))
        near = (cumulated > uniform[0, :, None] * cumulated[:, -1:]).argmax(axis=1)
        chosen = (uniform[1] < NEAR_SHARE) & (cumulated[:, -1] > 0)
        return np.where(chosen, candidates[near], goals), tested


CURRICULA: MappingProxyType[str, type[Curriculum]] = MappingProxyType(
    {"reached": Reached, "valid": Valid, "near": Near}
)
"""By name."""

CurriculumName = Literal[tuple(CURRICULA)]
"""Names of curricula."""


def _candidates(situation: Situation) -> np.ndarray:
    reached = situation.reached
    return np.flatnonzero(reached) if reached.any() else np.arange(len(reached))
