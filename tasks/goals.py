"""Semantic goals: which blocks are close, which block lies on which, and which combinations can be built.

A configuration of n blocks is described by bits in the order of the paper's Eq. 1. First comes `close(i, j)` for every
unordered pair, then `on(i, j)` and `on(j, i)`, pair by pair. For three blocks:
c(ab) c(ac) c(bc) o(ab) o(ba) o(ac) o(ca) o(bc) o(cb).

A *valid goal* is a bit vector that some aligned placement of the blocks produces. `placements.py` enumerates them.
Bits are always addressed by name or through `GoalSpace.pairs`, never by a hard-coded index. The public DECSTR code
reads its on-bits in another order than its environment writes them, and so turns pyramids into flat goals.
"""

import difflib
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from curiobench.tasks import goal_names
from curiobench.tasks.goal_names import BLOCK_NAMES
from curiobench.tasks.placements import enumerate_configurations

CLOSE_DISTANCE = 0.09
"""Blocks whose centres are at most this far apart are close (metres)."""
ON_HORIZONTAL = 0.05
"""The horizontal distance between a block and the block that it lies on is less than this (metres)."""
ON_VERTICAL = (0.03, 0.06)
"""The height difference between a block and the block that it lies on is between these two (metres)."""

MIN_BLOCKS, MAX_BLOCKS = 2, 5

Keeps = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Selects the goals of a task: returns `(G,)` bool for goals with bits `(G, n_bits)` and layers `(G,)`."""


def predicates(positions: np.ndarray) -> np.ndarray:
    """Evaluates every predicate on the blocks' positions.

    Args:
      positions: `(..., n, 3)` block centres in metres, z up.

    Returns:
      `(..., n_bits)` float32 of zeros and ones, in the order of `GoalSpace.bit_names`; all zeros where a position
      is not finite.
    """
    positions = np.asarray(positions)
    first, second = _pair_indices(positions.shape[-2])
    offset = positions[..., first, :] - positions[..., second, :]
    horizontal = np.hypot(offset[..., 0], offset[..., 1])
    height = offset[..., 2]
    low, high = ON_VERTICAL
    bits = np.empty((*positions.shape[:-2], 3 * len(first)), np.float32)
    bits[..., : len(first)] = np.sqrt(horizontal**2 + height**2) <= CLOSE_DISTANCE
    above = horizontal < ON_HORIZONTAL
    bits[..., len(first) :: 2] = above & (low < height) & (height < high)
    bits[..., len(first) + 1 :: 2] = above & (low < -height) & (-height < high)
    return bits


@cache
def _pair_indices(n_blocks: int) -> tuple[np.ndarray, np.ndarray]:
    return np.triu_indices(n_blocks, k=1)


@dataclass(frozen=True)
class BlockPair:
    """Indices of the predicates of one unordered pair of blocks `i < j` in a goal vector."""

    i: int
    j: int
    close: int
    on_ij: int
    """Index of the bit "i lies on j"."""
    on_ji: int


class GoalSpace:
    """The predicates and valid goals over `n_blocks` blocks; get one with `goal_space(n_blocks)`.

    Attributes:
      n_blocks: number of blocks.
      pairs: one `BlockPair` for each unordered pair of blocks.
      bit_names: `(n_bits,)` names such as "c(ab)" and "o(ba)".
      goals: `(n_goals, n_bits)` float32, every valid goal once, sorted by layer, then by the number of close pairs.
      layers: `(n_goals,)` int, height of the goal's tallest stack, in blocks.
    """

    def __init__(self, n_blocks: int, keeps: Keeps | None = None):
        self.n_blocks = n_blocks
        self._keeps = keeps
        n_pairs = n_blocks * (n_blocks - 1) // 2
        self.pairs = tuple(
            BlockPair(i, j, close=k, on_ij=n_pairs + 2 * k, on_ji=n_pairs + 2 * k + 1)
            for k, (i, j) in enumerate(itertools.combinations(range(n_blocks), 2))
        )
        couples = [(BLOCK_NAMES[p.i], BLOCK_NAMES[p.j]) for p in self.pairs]
        self.bit_names = tuple(f"c({i}{j})" for i, j in couples) + tuple(
            name for i, j in couples for name in (f"o({i}{j})", f"o({j}{i})")
        )
        goals, layers = enumerate_configurations(n_blocks, predicates)
        order = np.lexsort((*-goals.T[::-1], goals.sum(axis=1), layers))
        self.goals, self.layers = goals[order], layers[order]
        if keeps:
            kept = keeps(self.goals, self.layers)
            self.goals, self.layers = self.goals[kept], self.layers[kept]
        self.goals.flags.writeable = self.layers.flags.writeable = False

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Readable name of each goal, such as "a on b, c apart"; unique."""
        return tuple(goal_names.describe(self, bits) for bits in self.goals)

    @property
    def n_bits(self) -> int:
        return 3 * len(self.pairs)

    def __len__(self) -> int:
        return len(self.goals)

    def __reduce__(self) -> tuple[Any, ...]:
        return goal_space, (self.n_blocks, self._keeps)  # copying and unpickling return the process's cached object

    def index(self, bits: np.ndarray) -> int:
        """Position of one bit vector `(n_bits,)` in `goals`; -1 if it is not a valid goal."""
        return int(self._table.indices(bits))

    def indices(self, bits: np.ndarray) -> np.ndarray:
        """Positions of many bit vectors `(..., n_bits)` in `goals`; -1 for those that are not valid goals."""
        return self._table.indices(bits)

    @cached_property
    def _table(self) -> "GoalTable":
        return GoalTable(self.goals)

    @property
    def on_bits(self) -> np.ndarray:
        """`(n_bits,)` bool, True for the bits that say that a block lies on another."""
        return np.array([name.startswith("o") for name in self.bit_names])

    def bit_string(self, bits: np.ndarray) -> str:
        """One bit vector as text, such as "100100000"."""
        return "".join(str(int(bit > 0.5)) for bit in bits)

    def parse(self, goal: "str | int | Sequence[float] | np.ndarray") -> np.ndarray:
        """Turns a name, a bit string, a position in `goals` or a bit vector into a valid goal `(n_bits,)`.

        In a name, blocks that are not mentioned are apart: "a on b" and "a on b, c apart" are the same goal.

        Raises:
          ValueError: the name cannot be parsed, the length is wrong, or no placement of blocks produces the goal.
        """
        if isinstance(goal, str):
            if not goal or set(goal) - {"0", "1"}:
                return self._parse_name(goal)
            bits = np.array([float(c) for c in goal])
        elif isinstance(goal, int | np.integer) and not isinstance(goal, bool):
            if not 0 <= goal < len(self):
                raise ValueError(f"goal {goal} is out of range: there are {len(self)} goals, 0 to {len(self) - 1}")
            bits = self.goals[goal]
        else:
            try:
                bits = np.asarray(goal, dtype=np.float64)
            except (TypeError, ValueError):
                what = f"a name, {self.n_bits} bits or a position in the list of goals"
                raise ValueError(f"a goal is {what}, got {goal!r:.80}") from None
        return self.check(bits)

    def check(self, bits: np.ndarray) -> np.ndarray:
        """Returns `bits` `(n_bits,)` as float32; raises ValueError unless it is a valid goal."""
        if bits.shape != (self.n_bits,):
            raise ValueError(
                f"a goal for {self.n_blocks} blocks has {self.n_bits} bits ({' '.join(self.bit_names)}), "
                f"got an array of shape {bits.shape}"
            )
        if not np.isin(bits, (0, 1)).all():
            raise ValueError(f"goal bits are 0 or 1, got {bits.tolist()}")
        if self.index(bits) < 0:
            text = self.bit_string(bits)
            if self._keeps and goal_space(self.n_blocks).index(bits) >= 0:
                raise ValueError(f"{text} is not one of the task's {len(self)} goals")
            raise ValueError(f"no placement of {self.n_blocks} blocks produces the goal {text}")
        return bits.astype(np.float32)

    def _parse_name(self, name: str) -> np.ndarray:
        try:
            return self.check(goal_names.parse(self, name))
        except ValueError as error:
            near = difflib.get_close_matches(name, self.names, n=3, cutoff=0.3)
            hint = "; did you mean " + " or ".join(repr(n) for n in near) + "?" if near else ""
            raise ValueError(f"unknown goal {name!r}: {error}{hint}") from None


class GoalTable:
    """Finds bit vectors in a list of goals, many at once."""

    def __init__(self, goals: np.ndarray):
        """Builds the table for `(G, n_bits)` distinct goals of zeros and ones, at most 62 bits each."""
        self._weights = 1 << np.arange(goals.shape[1], dtype=np.int64)
        codes = self._codes(goals)
        self._order = np.argsort(codes)
        self._sorted = codes[self._order]

    def _codes(self, bits: np.ndarray) -> np.ndarray:
        return (np.asarray(bits) > 0.5) @ self._weights

    def indices(self, bits: np.ndarray) -> np.ndarray:
        """Positions `(...)` of bit vectors `(..., n_bits)` in the list, -1 for those that are not in it."""
        codes = self._codes(bits)
        found = np.searchsorted(self._sorted, codes).clip(max=len(self._sorted) - 1)
        return np.where(self._sorted[found] == codes, self._order[found], -1)


def goal_space(n_blocks: int, keeps: Keeps | None = None) -> GoalSpace:
    """The cached `GoalSpace` over `n_blocks` blocks (2 to 5), with all valid goals or those that `keeps` selects.

    Raises:
      ValueError: the number of blocks is not 2 to 5.
    """
    if not MIN_BLOCKS <= n_blocks <= MAX_BLOCKS:
        raise ValueError(f"the number of blocks is {MIN_BLOCKS} to {MAX_BLOCKS}, got {n_blocks}")
    return _cached_goal_space(n_blocks, keeps)


@cache
def _cached_goal_space(n_blocks: int, keeps: Keeps | None) -> GoalSpace:
    return GoalSpace(n_blocks, keeps)
