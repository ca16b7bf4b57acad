"""Loops of `pairs.py` that encode a batch for the networks, compiled by Numba for the CPU.

Each function makes one part of the encoding, for all rows [observation | achieved | desired] of a set, (B, D + 2 bits).
`sizes` are those of the body and of a block, and the number of bits. `oriented` (B, 5) is a pair of
`PairLayout.pairs` as each row encodes it.
"""

from typing import Any, TypeAlias

import numpy as np

from curiobench.methods.agents.fused import compiled

Scales: TypeAlias = tuple[tuple[float, ...], tuple[float, ...], float]
"""Of near-field features: of tanhs, of exponentials, and of the untransformed offset."""
Sizes: TypeAlias = tuple[int, int, int]


@compiled
def _length(vector: np.ndarray) -> Any:
    total = vector.dtype.type(0.0)
    for k in range(vector.shape[0]):
        total += vector[k] * vector[k]
    return np.sqrt(total)


@compiled
def _near(offset: np.ndarray, distance: float, scales: Scales, out: np.ndarray, at: int) -> None:
    """Write tanhs of an offset (3) and exponentials of a distance to `out` from index `at`."""
    for scale in scales[0]:
        for k in range(3):
            out[at + k] = np.tanh(offset[k] * offset.dtype.type(1 / scale))
        at += 3
    for scale in scales[1]:
        out[at] = np.exp(distance * offset.dtype.type(-1 / scale))
        at += 1


@compiled
def _normalise(
    rows: np.ndarray, shift: np.ndarray, scale: np.ndarray, clip: float, detail_scale: np.ndarray, state: np.ndarray
) -> np.ndarray:
    """Write the states (B, D) of rows; return the normalised rows, with their details scaled."""
    normal = np.empty_like(rows)
    for b in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            normal[b, j] = min(max((rows[b, j] - shift[j]) * scale[j], -clip), clip)
        for j in range(state.shape[1]):
            state[b, j] = normal[b, j]
            normal[b, j] *= detail_scale[j]
    return normal


@compiled
def _write_context(rows: np.ndarray, normal: np.ndarray, sizes: Sizes, near_field: bool, context: np.ndarray) -> None:
    """Write the body, and with `near_field` how many bits are wrong, missing and unwanted, to `context` (B, C)."""
    body_size, _, n_bits = sizes
    achieved = rows.shape[1] - 2 * n_bits
    for b in range(rows.shape[0]):
        for j in range(body_size):
            context[b, j] = normal[b, j]
        context[b, body_size:] = 0
        for j in range(achieved, achieved + n_bits if near_field else achieved):
            difference = rows[b, j + n_bits] - rows[b, j]
            context[b, body_size] += abs(difference)
            context[b, body_size + 1] += max(difference, 0)
            context[b, body_size + 2] += max(-difference, 0)


@compiled
def _beside_hand(rows: np.ndarray, sizes: Sizes, near_field: bool, scales: Scales) -> tuple[np.ndarray, np.ndarray]:
    """Near-field features of each block relative to the hand (B, K, N), and its distance (B, K)."""
    body_size, block_size, n_bits = sizes
    n_blocks = (rows.shape[1] - 2 * n_bits - body_size) // block_size
    n_near = 3 * len(scales[0]) + len(scales[1]) if near_field else 0
    features = np.empty((rows.shape[0], n_blocks, n_near), rows.dtype)
    distances = np.empty((rows.shape[0], n_blocks), rows.dtype)
    for b in range(rows.shape[0]):
        for k in range(n_blocks):
            start = body_size + block_size * k + 3
            offset = rows[b, start : start + 3]
            distances[b, k] = _length(offset)
            if near_field:
                _near(offset, distances[b, k], scales, features[b, k], 0)
    return features, distances


@compiled
def _orient(
    rows: np.ndarray,
    distances: np.ndarray,
    pair: np.ndarray,
    n_bits: int,
    mode: int,
    weights: tuple[float, float],
    oriented: np.ndarray,
) -> None:
    """Write to `oriented` the pair, with its blocks swapped in the rows whose score is below 0."""
    achieved, desired = rows.shape[1] - 2 * n_bits, rows.shape[1] - n_bits
    first, second, _, on, reverse = pair
    for b in range(rows.shape[0]):
        score = np.float64(0.0)
        if mode == 1:
            score = 0.5 - rows[b, desired + reverse]
        elif mode == 2:
            score = weights[0] * (rows[b, desired + on] - rows[b, desired + reverse])
            score += weights[1] * (rows[b, achieved + on] - rows[b, achieved + reverse])
            score += np.sign(distances[b, second] - distances[b, first])
        oriented[b] = pair
        if score < 0:
            oriented[b, 0], oriented[b, 1], oriented[b, 3], oriented[b, 4] = second, first, reverse, on


@compiled
def _write_pair(
    normal: np.ndarray, of_blocks: np.ndarray, oriented: np.ndarray, sizes: Sizes, features: np.ndarray
) -> None:
    """Write the two blocks, with their features `of_blocks`, and the pair's bits to `features` (B, F)."""
    body_size, block_size, n_bits = sizes
    n_near = of_blocks.shape[2]
    n_state = normal.shape[1] - 2 * n_bits
    for b in range(normal.shape[0]):
        at = 0
        for block in oriented[b, :2]:
            for j in range(block_size):
                features[b, at + j] = normal[b, body_size + block_size * block + j]
            at += block_size
            for j in range(n_near):
                features[b, at + j] = of_blocks[b, block, j]
            at += n_near
        for start in (n_state, n_state + n_bits):
            for k in range(3):
                features[b, at + k] = normal[b, start + oriented[b, 2 + k]]
            at += 3


@compiled
def _write_near_field(
    rows: np.ndarray, oriented: np.ndarray, sizes: Sizes, scales: Scales, features: np.ndarray
) -> None:
    """Write a pair's missing and unwanted bits, and the position of its blocks to each other, to `features` (B, ·)."""
    body_size, block_size, n_bits = sizes
    achieved, desired = rows.shape[1] - 2 * n_bits, rows.shape[1] - n_bits
    offset = np.empty(3, rows.dtype)
    for b in range(rows.shape[0]):
        for k in range(3):
            bit = oriented[b, 2 + k]
            difference = rows[b, desired + bit] - rows[b, achieved + bit]
            features[b, k], features[b, 3 + k] = max(difference, 0), max(-difference, 0)
        first, second = body_size + block_size * oriented[b, 0], body_size + block_size * oriented[b, 1]
        for k in range(3):
            offset[k] = rows[b, first + k] - rows[b, second + k]
            features[b, 6 + k] = offset[k] / rows.dtype.type(scales[2])
        _near(offset, _length(offset[:2]), scales, features[b], 9)


@compiled
def encode(
    rows: np.ndarray,
    normalisation: tuple[np.ndarray, np.ndarray, float, np.ndarray],
    sizes: Sizes,
    pairs: np.ndarray,
    orientation: tuple[int, tuple[float, float]],
    near_field: bool,
    scales: Scales,
    out: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """`PairEncoder.encode_rows` without identities.

    Args:
        rows: (S, B, D + 2 bits).
        normalisation: shift and scale (D + 2 bits), their bound, and the factors (D) of the networks' inputs.
        sizes: of the body, of a block, and the number of bits.
        pairs: (P, 5) as in `PairLayout.pairs`.
        orientation: 0 never swaps a pair, 1 swaps it by the goal, 2 by roles; and the weights of the goal's and of the
            state's "on" in the score by which roles swap it.
        near_field: whether to add near-field features.
        scales: of near-field features.
        out: states (S, B, D), contexts (S, B, C) and pairs (S, P, B, F).
    """
    oriented = np.empty((rows.shape[1], 5), np.int64)
    for row, state, context, features in zip(rows, *out):  # noqa: B905 - Numba has no `strict`
        normal = _normalise(row, *normalisation, state)
        _write_context(row, normal, sizes, near_field, context)
        of_blocks, distances = _beside_hand(row, sizes, near_field, scales)
        plain = 2 * (sizes[1] + of_blocks.shape[2]) + 6  # columns before the near-field ones of a pair
        for p in range(pairs.shape[0]):
            _orient(row, distances, pairs[p], sizes[2], *orientation, oriented)
            _write_pair(normal, of_blocks, oriented, sizes, features[p])
            if near_field:
                _write_near_field(row, oriented, sizes, scales, features[p, :, plain:])
