"""Numbers in groups, oldest first, for vectorised random draws."""

import numpy as np


class Queues:
    """One first-in, first-out queue of integers per group. Each is a ring in one shared array, doubled when it is full.

    Attributes:
        counts: `(G,)` numbers held by each group.
    """

    def __init__(self, n_groups: int) -> None:
        self.counts = np.zeros(n_groups, np.int64)
        self._heads = np.zeros(n_groups, np.int64)
        self._widths = np.full(n_groups, 2, np.int64)
        self._starts = 2 * np.arange(n_groups)
        self._flat = np.zeros(2 * n_groups, np.int64)

    def push(self, groups: np.ndarray, numbers: np.ndarray) -> None:
        """Append numbers `(K,)` to their groups `(K,)`, in the order given."""
        order = np.argsort(groups, kind="stable")
        groups, numbers = groups[order], numbers[order]
        new = np.bincount(groups, minlength=len(self.counts))
        if (self.counts + new > self._widths).any():
            self._widen(self.counts + new)
        rank = np.arange(len(groups)) - (np.cumsum(new) - new)[groups]
        self._flat[self._places(groups, self.counts[groups] + rank)] = numbers
        self.counts += new

    def drop(self, groups: np.ndarray) -> None:
        """Remove as many of each group's oldest numbers as the group occurs in groups `(K,)`."""
        gone = np.bincount(groups, minlength=len(self.counts))
        self._heads = (self._heads + gone) % self._widths
        self.counts -= gone

    def draw(self, groups: np.ndarray, uniform: np.ndarray) -> np.ndarray:
        """A number of each group `(K,)`, none of them empty, by random numbers `(K,)` in [0, 1)."""
        return self._flat[self._places(groups, (uniform * self.counts[groups]).astype(np.int64))]

    def _places(self, groups: np.ndarray, ranks: np.ndarray) -> np.ndarray:
        return self._starts[groups] + (self._heads[groups] + ranks) % self._widths[groups]

    def _widen(self, needed: np.ndarray) -> None:
        groups = np.repeat(np.arange(len(self.counts)), self.counts)
        ranks = np.arange(len(groups)) - np.repeat(np.cumsum(self.counts) - self.counts, self.counts)
        held = self._flat[self._places(groups, ranks)]
        doubled = 2 ** np.ceil(np.log2(np.maximum(needed, 1))).astype(np.int64)
        self._widths = np.where(needed > self._widths, doubled, self._widths)
        self._starts = np.cumsum(self._widths) - self._widths
        self._heads[:] = 0
        self._flat = np.zeros(self._widths.sum(), np.int64)
        self._flat[self._places(groups, ranks)] = held
