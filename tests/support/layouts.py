"""Layouts of observations and goals that need no task."""

from itertools import combinations

from curiobench.methods.agents.pairs import PairLayout

SMALL = PairLayout(
    2, ((0, 1, 0, 1, 2),), body_size=3, block_size=6, action_size=2, body_details=(0,), block_details=(1,)
)
"""Two tiny blocks."""


def layout_of(n_blocks: int) -> PairLayout:
    """All close bits, then on(i, j) and on(j, i) of each pair: the paper's order."""
    pairs = list(combinations(range(n_blocks), 2))
    bits = [(k, len(pairs) + 2 * k, len(pairs) + 2 * k + 1) for k in range(len(pairs))]
    return PairLayout(n_blocks, tuple((i, j, *b) for (i, j), b in zip(pairs, bits, strict=True)))
