"""Start positions of blocks: spread on the table, or biased towards stacks and a held block."""

from dataclasses import dataclass

import numpy as np

from curiobench.tasks.placements import BLOCK_SIZE
from curiobench.tasks.robots import GRIP_START
from curiobench.tasks.scene import BLOCK_REST_HEIGHT

SPREAD = 0.15
"""Largest distance, in x and in y, between a block and the point below the grip's start (metres), as in the paper."""
MIN_DISTANCE = 0.0707
"""Least distance between columns of blocks (metres). Upright cubes at this distance do not overlap at any yaw angle."""
HAND_CLEARANCE = 0.12
"""Least distance between a stack of three, which is as high as the hand at its start, and the hand's axis (metres)."""
HELD_FINGER_POSITION = 0.024
"""Finger position that holds a block (metres). The opening is 0.2 mm narrower than the block."""
NONE_HELD = -1


@dataclass(frozen=True)
class BiasedStarts:
    """Probabilities of a biased start (paper, section 5.1)."""

    stack_of_two: float = 0.21
    """Probability that two blocks start stacked."""
    stack_of_three: float = 0.09
    """Probability that three blocks start stacked; in tasks with two blocks, that two do."""
    held: float = 0.5
    """Probability that one block starts between the fingers; it never carries another block."""

    def __post_init__(self) -> None:
        chances = (self.stack_of_two, self.stack_of_three, self.held)
        if not all(0 <= p <= 1 for p in chances) or self.stack_of_two + self.stack_of_three > 1:
            raise ValueError(
                f"probabilities of biased starts must lie in [0, 1] and stacks add up to at most 1: {self}"
            )


def sample_starts(
    rng: np.random.Generator, biased: np.ndarray, n_blocks: int, probabilities: BiasedStarts, spread: float = SPREAD
) -> tuple[np.ndarray, np.ndarray]:
    """Draws block positions for N worlds.

    Args:
      rng: the only source of randomness.
      biased: `(N,)` bool, True for worlds with a biased start.
      n_blocks: number of blocks per world.
      probabilities: probabilities of biased starts.
      spread: largest distance of blocks on the table, in x and in y, from the point below the grip's start (metres).

    Returns:
      Centres `(N, n_blocks, 3)` in metres, and indices `(N,)` of the held blocks or `NONE_HELD`.
    """
    n_worlds = len(biased)
    heights = _stack_heights(rng, biased, n_blocks, probabilities)
    named = rng.permuted(np.tile(np.arange(n_blocks), (n_worlds, 1)), axis=1)
    columns = _columns(rng, heights, n_blocks, spread)
    level = np.arange(n_blocks)
    stacked = level < heights[:, None]
    xy = np.where(stacked[..., None], columns[:, :1], columns)
    z = BLOCK_REST_HEIGHT + BLOCK_SIZE * np.where(stacked, level, 0)
    slots = np.concatenate([xy, z[..., None]], axis=-1)
    # the top of the stack and the blocks beside it may be held: these are the last slots
    n_free = n_blocks - heights + 1
    slot = n_blocks - 1 - rng.integers(n_free)
    is_held = biased & (rng.random(n_worlds) < probabilities.held)
    rows = np.flatnonzero(is_held)
    slots[rows, slot[rows]] = GRIP_START
    positions = np.empty_like(slots)
    np.put_along_axis(positions, named[..., None], slots, axis=1)
    return positions, np.where(is_held, named[np.arange(n_worlds), slot], NONE_HELD)


def _stack_heights(
    rng: np.random.Generator, biased: np.ndarray, n_blocks: int, probabilities: BiasedStarts
) -> np.ndarray:
    """Height `(N,)` of the stack in each world; 1 where all blocks lie on the table."""
    draw = rng.random(len(biased))
    heights = np.ones(len(biased), int)
    heights[draw < probabilities.stack_of_two + probabilities.stack_of_three] = 2
    heights[draw < probabilities.stack_of_three] = min(3, n_blocks)
    return np.where(biased, heights, 1)


def _columns(rng: np.random.Generator, heights: np.ndarray, n_blocks: int, spread: float) -> np.ndarray:
    """Positions `(N, n_blocks, 2)` of columns that keep `MIN_DISTANCE`; the first is that of a stack."""
    columns = np.empty((len(heights), n_blocks, 2))
    pending = np.arange(len(heights))
    first, second = np.triu_indices(n_blocks, k=1)
    while len(pending):
        drawn = rng.uniform(-spread, spread, (len(pending), n_blocks, 2))
        gap = np.linalg.norm(drawn[:, first] - drawn[:, second], axis=-1).min(axis=-1)
        clear = (heights[pending] < 3) | (np.linalg.norm(drawn[:, 0], axis=-1) >= HAND_CLEARANCE)
        good = (gap >= MIN_DISTANCE) & clear
        columns[pending[good]] = drawn[good] + GRIP_START[:2]
        pending = pending[~good]
    return columns
