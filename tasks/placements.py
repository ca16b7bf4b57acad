"""Enumeration of the configurations that can be built, by aligned placements of blocks.

In an aligned placement every block lies on the table, centred on one block, or centred on the midpoint of two close
blocks of equal height (a pyramid). Blocks are not rotated, and no two blocks of one layer overlap. Columns are added
to the table one by one, on rings around the columns already there. This covers the combinations of "touching", "near"
and "far" that are geometrically possible. Episodes also reach other configurations, such as offset stacks or a held
block. These occur as achieved goals but never as desired goals.
"""

import itertools
from collections.abc import Callable, Iterator

import numpy as np

BLOCK_SIZE = 0.05
"""Edge of a block, in metres."""

_RINGS = (0.0501, 0.055, 0.063, 0.073, 0.08, 0.089)
"""Distances at which a column is placed beside another (metres): from contact to just below the closeness limit."""
_ANGLES = np.deg2rad(np.arange(0, 360, 15))
_OFFSETS = np.array([[r * np.cos(t), r * np.sin(t)] for r in _RINGS for t in _ANGLES])
_FAR = 1.0
"""Distance of a column that has no relation to the others (metres)."""
_TOUCHING, _NEAR = 0.0748, 0.09
"""Horizontal distances up to which blocks of adjacent layers (first) and of one layer (second) are close (metres)."""
_REPRESENTATIVES = 8
"""Number of layouts kept per signature: layouts with equal signatures may differ in where further columns fit."""


def enumerate_configurations(
    n_blocks: int, predicates: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Every configuration that an aligned placement of `n_blocks` blocks produces.

    Args:
      n_blocks: number of blocks.
      predicates: maps positions `(..., n_blocks, 3)` in metres to bits `(..., n_bits)`.

    Returns:
      `(n, n_bits)` float32 configurations without duplicates, and their layers `(n,)` (height of the tallest stack, in
      blocks).
    """
    positions = np.array(list(_placements(n_blocks)))
    _, first = np.unique(predicates(positions), axis=0, return_index=True)
    positions = positions[first]
    renamed = np.array(list(itertools.permutations(range(n_blocks))))
    bits = predicates(positions[:, renamed, :]).reshape(len(positions) * len(renamed), -1)
    bits, first = np.unique(bits, axis=0, return_index=True)
    layers = np.rint(positions[:, :, 2].max(axis=1) / BLOCK_SIZE).astype(int) + 1
    return bits, layers[first // len(renamed)]


def _placements(n_blocks: int) -> Iterator[np.ndarray]:
    """Yields positions `(n_blocks, 3)` in metres, height 0 for a block on the table, without names for the blocks."""
    for n_columns in range(1, n_blocks + 1):
        for columns in _column_layouts(n_columns, carries=n_columns < n_blocks):
            yield from _add_blocks_on_top(np.column_stack([columns, np.zeros(n_columns)]), n_blocks)


def _column_layouts(n_columns: int, carries: bool) -> list[np.ndarray]:
    """Layouts `(n_columns, 2)` of columns on the table, a few per distinct signature (see `_relations`)."""
    layouts = [np.zeros((1, 2))]
    for _ in range(n_columns - 1):
        candidates = np.concatenate([_with_one_more_column(layout) for layout in layouts])
        _, kind = np.unique(_relations(candidates, carries), axis=0, return_inverse=True)
        layouts = [layout for k in range(kind.max() + 1) for layout in _spread(candidates[kind.ravel() == k])]
    return layouts


def _spread(layouts: np.ndarray) -> np.ndarray:
    """At most `_REPRESENTATIVES` of the layouts, evenly spaced."""
    step = max(1, len(layouts) / _REPRESENTATIVES)
    return layouts[np.arange(0, len(layouts), step).astype(int)]


def _with_one_more_column(columns: np.ndarray) -> np.ndarray:
    """All ways `(k, n + 1, 2)` to put one more column beside one of `columns` `(n, 2)`, or far from all."""
    beside = (columns[:, None] + _OFFSETS).reshape(-1, 2)
    gap = np.abs(beside[:, None] - columns).max(axis=-1).min(axis=-1)
    new = np.vstack([beside[gap >= BLOCK_SIZE], columns[-1] + [_FAR, 0.0]])
    return np.concatenate([np.broadcast_to(columns, (len(new), *columns.shape)), new[:, None]], axis=1)


def _relations(layouts: np.ndarray, carries: bool) -> np.ndarray:
    """Signatures `(k, ·)` of layouts `(k, n, 2)`, independent of the order of the columns.

    A signature encodes classes of the distances between columns. If blocks will lie on the columns, it also encodes
    which columns are close to which possible pyramid tops. Layouts with equal signatures produce the same
    configurations up to a permutation of the blocks.
    """
    n = layouts.shape[1]
    first, second = np.triu_indices(n, k=1)
    distance = np.linalg.norm(layouts[:, :, None] - layouts[:, None], axis=-1)
    if carries:
        tops = (layouts[:, first] + layouts[:, second]) / 2
        beside_top = np.linalg.norm(layouts[:, :, None] - tops[:, None], axis=-1) <= _TOUCHING
        relation = np.digitize(distance, (_TOUCHING, _NEAR), right=True)
        extra = np.zeros((*distance.shape, n), np.int64)
        extra[:, first, second] = extra[:, second, first] = beside_top.transpose(0, 2, 1)
    else:
        relation, extra = (distance <= _NEAR).astype(np.int64), np.zeros((*distance.shape, 1), np.int64)
    return _canonical(relation, extra)


def _canonical(relation: np.ndarray, extra: np.ndarray) -> np.ndarray:
    """The smallest hash of `(k, n, n)` relations with `(k, n, n, ·)` extras over all permutations of the columns."""
    n = relation.shape[1]
    first, second = np.triu_indices(n, k=1)
    n_digits = len(first) * (1 + extra.shape[-1])
    weights = np.random.default_rng(0).integers(1 << 62, size=n_digits)
    codes = []
    for order in itertools.permutations(range(n)):
        p = np.array(order)
        thirds = extra[:, p[first], p[second]]
        thirds = thirds[..., p] if thirds.shape[-1] == n else thirds
        digits = np.concatenate([relation[:, p[first], p[second]], thirds.reshape(len(relation), -1)], axis=1)
        codes.append(digits @ weights)  # wraps around, as a hash may
    return np.min(codes, axis=0)[:, None]


def _add_blocks_on_top(blocks: np.ndarray, n_blocks: int) -> Iterator[np.ndarray]:
    """Yields every completion of `blocks` `(k, 3)` to `n_blocks` by blocks that rest on one or two blocks.

    Blocks are added layer by layer from below, so that the same placement is produced in few orders.
    """
    if len(blocks) == n_blocks:
        yield blocks
        return
    for spot in _resting_spots(blocks):
        if spot[2] >= blocks[-1, 2]:
            yield from _add_blocks_on_top(np.vstack([blocks, spot]), n_blocks)


def _resting_spots(blocks: np.ndarray) -> Iterator[np.ndarray]:
    """Yields centres `(3,)` of a block that rests on one block, or on the midpoint of two close ones."""
    level = np.array([0.0, 0.0, BLOCK_SIZE])
    spots = [block + level for block in blocks]
    for one, other in itertools.combinations(blocks, 2):
        if one[2] == other[2] and np.linalg.norm(one - other) <= _NEAR:
            spots.append((one + other) / 2 + level)
    for spot in spots:
        layer = blocks[np.isclose(blocks[:, 2], spot[2])]
        if len(layer) == 0 or np.abs(layer[:, :2] - spot[:2]).max(axis=-1).min() >= BLOCK_SIZE - 1e-9:
            yield spot
