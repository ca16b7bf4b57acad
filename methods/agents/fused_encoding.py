"""The loop of `pairs.py` that encodes a batch for the networks in one pass, compiled by Numba for the CPU."""

from typing import Any, TypeAlias

import numpy as np

from curiobench.methods.agents.fused import compiled

Scales: TypeAlias = tuple[float, ...]


@compiled
def _length(vector: np.ndarray) -> Any:
    total = vector.dtype.type(0.0)
    for k in range(vector.shape[0]):
        total += vector[k] * vector[k]
    return np.sqrt(total)


@compiled
def _near(
    offset: np.ndarray, distance: float, tanh_scales: Scales, exp_scales: Scales, out: np.ndarray, at: int
) -> int:
    """Write tanhs of an offset (3) and exponentials of a distance to `out` from index `at`; return the next index."""
    for scale in tanh_scales:
        for k in range(3):
            out[at + k] = np.tanh(offset[k] * offset.dtype.type(1 / scale))
        at += 3
    for scale in exp_scales:
        out[at] = np.exp(distance * offset.dtype.type(-1 / scale))
        at += 1
    return at


@compiled
def _count_wrong(achieved: np.ndarray, desired: np.ndarray, out: np.ndarray) -> None:
    """Write to `out` how many bits of a goal are wrong, missing and unwanted."""
    out[:] = 0
    for k in range(achieved.shape[0]):
        difference = desired[k] - achieved[k]
        out[0] += abs(difference)
        out[1] += max(difference, 0)
        out[2] += max(-difference, 0)


@compiled
def encode(
    rows: np.ndarray,
    shift: np.ndarray,
    scale: np.ndarray,
    clip: float,
    detail_scale: np.ndarray,
    sizes: tuple[int, int, int],
    pairs: np.ndarray,
    mode: int,
    weights: tuple[float, float],
    near_field: bool,
    scales: tuple[Scales, Scales, float],
    state: np.ndarray,
    context: np.ndarray,
    features: np.ndarray,
) -> None:
    """`PairEncoder.encode_rows` without identities, in one pass over a batch.

    Args:
        rows: (S, B, D + 2 bits).
        shift, scale: (D + 2 bits) of the normalisation; `clip` bounds it.
        detail_scale: (D) factors of the networks' inputs.
        sizes: of the body, of a block, and the number of bits.
        pairs: (P, 5) as in `PairLayout.pairs`.
        mode: 0 never swaps a pair, 1 swaps it by the goal, 2 by roles.
        weights: of the goal's and of the state's "on" in the score by which roles swap a pair.
        near_field: whether to add near-field features.
        scales: of their tanhs, of their exponentials, and of the untransformed offset.
        state, context, features: the outputs (S, B, D), (S, B, C) and (S, P, B, F).
    """
    body_size, block_size, n_bits = sizes
    tanh_scales, exp_scales, linear_scale = scales
    n_near = 3 * len(tanh_scales) + len(exp_scales)  # features of a block relative to the hand
    n_state = state.shape[2]
    n_blocks = (n_state - body_size) // block_size
    of_blocks, distances = np.empty((n_blocks, n_near), rows.dtype), np.empty(n_blocks, rows.dtype)
    normal = np.empty(rows.shape[2], rows.dtype)
    offset = np.empty(3, rows.dtype)
    bits = np.empty(3, np.int64)
    for s in range(rows.shape[0]):
        for b in range(rows.shape[1]):
            row = rows[s, b]
            for j in range(row.shape[0]):
                normal[j] = min(max((row[j] - shift[j]) * scale[j], -clip), clip)
            for j in range(n_state):
                state[s, b, j] = normal[j]
                normal[j] *= detail_scale[j]
            achieved, desired = row[n_state : n_state + n_bits], row[n_state + n_bits :]
            for j in range(body_size):
                context[s, b, j] = normal[j]
            if near_field:
                _count_wrong(achieved, desired, context[s, b, body_size:])
            for k in range(n_blocks):
                beside_hand = row[body_size + block_size * k + 3 : body_size + block_size * k + 6]
                distances[k] = _length(beside_hand)
                if near_field:
                    _near(beside_hand, distances[k], tanh_scales, exp_scales, of_blocks[k], 0)
            for p in range(pairs.shape[0]):
                first, second = pairs[p, 0], pairs[p, 1]
                start_1, start_2 = body_size + block_size * first, body_size + block_size * second
                bits[:] = pairs[p, 2:]
                score = np.float64(0.0)
                if mode == 1:
                    score = 0.5 - desired[bits[2]]
                elif mode == 2:
                    score = weights[0] * (desired[bits[1]] - desired[bits[2]])
                    score += weights[1] * (achieved[bits[1]] - achieved[bits[2]])
                    score += np.sign(distances[second] - distances[first])
                if score < 0:
                    start_1, start_2 = start_2, start_1
                    bits[1], bits[2] = bits[2], bits[1]
                out = features[s, p, b]
                at = 0
                for start in (start_1, start_2):
                    out[at : at + block_size] = normal[start : start + block_size]
                    at += block_size
                    if near_field:
                        out[at : at + n_near] = of_blocks[(start - body_size) // block_size]
                        at += n_near
                for kind in range(2):
                    for k in range(3):
                        out[at] = normal[n_state + kind * n_bits + bits[k]]
                        at += 1
                if near_field:
                    for k in range(3):
                        difference = desired[bits[k]] - achieved[bits[k]]
                        out[at + k], out[at + 3 + k] = max(difference, 0), max(-difference, 0)
                    at += 6
                    for k in range(3):
                        offset[k] = row[start_1 + k] - row[start_2 + k]
                        out[at + k] = offset[k] / rows.dtype.type(linear_scale)
                    at = _near(offset, _length(offset[:2]), tanh_scales, exp_scales, out, at + 3)
