"""Loops of `pair_attention.py` and `pairs.py` that read and write each number once, compiled by Numba for the CPU.

At these sizes an operation on all activations costs less for its arithmetic than for its way through memory, and each
call takes microseconds. Arrays are C-contiguous and of one float type: (M, R, H) and (M, R), for M members of R rows of
H units. The rows of K contexts, P pairs and B transitions are numbered in the order (k, p, b) or (k, b); `shape` is
(K, P, B).

A norm divides rows that are centred already by their standard deviation; where `norm` is False, by 1.
"""

import numpy as np
from numba import njit

EPSILON = 1e-5
"""Added to variances in norms."""

# reordered sums, but NaN and infinity as they are: a loss that is not finite must be found
_OPTIONS = {"fastmath": {"reassoc", "contract", "arcp", "nsz"}, "error_model": "numpy"}


def _compiled(function):
    """The function compiled for each type that it is called with; kept on the disk where there is a place for it."""
    try:
        return njit(cache=True, **_OPTIONS)(function)
    except RuntimeError:  # neither the folder of this file nor the user's own can be written
        return njit(**_OPTIONS)(function)


@_compiled
def centre(weights, out):
    """out = weights (M, R, H) less the mean of each row; both may be the same array."""
    units = weights.shape[2]
    for m in range(weights.shape[0]):
        for r in range(weights.shape[1]):
            total = weights.dtype.type(0.0)
            for j in range(units):
                total += weights[m, r, j]
            total /= weights.dtype.type(units)
            for j in range(units):
                out[m, r, j] = weights[m, r, j] - total


@_compiled
def _inverse_std(row, norm):
    """1 / standard deviation of a centred row (H)."""
    if not norm:
        return row.dtype.type(1.0)
    total = row.dtype.type(0.0)
    for j in range(row.shape[0]):
        total += row[j] * row[j]
    return row.dtype.type(1.0) / np.sqrt(total / row.dtype.type(row.shape[0]) + row.dtype.type(EPSILON))


@_compiled
def _relu(value):
    return value - value if value < 0 else value  # NaN stays, as in torch


@_compiled
def norm_relu(x, norm, out, scales):
    """out = relu(x / std), and 1 / std in scales."""
    for m in range(x.shape[0]):
        for r in range(x.shape[1]):
            scale = _inverse_std(x[m, r], norm)
            scales[m, r] = scale
            for j in range(x.shape[2]):
                out[m, r, j] = _relu(x[m, r, j]) * scale


@_compiled
def norm_relu_backward(grad, x, scales, norm):
    """Gradient at x from that at the output, in place of the latter, up to a multiple of ones in each row.

    (That part goes with the gradient of centring.)
    """
    zero = x.dtype.type(0.0)
    for m in range(x.shape[0]):
        for r in range(x.shape[1]):
            along = zero
            for j in range(x.shape[2]):
                masked = grad[m, r, j] if x[m, r, j] > zero else zero
                grad[m, r, j] = masked
                along += masked * x[m, r, j]
            scale = scales[m, r]
            along = along * scale * scale / x.dtype.type(x.shape[2]) if norm else zero
            for j in range(x.shape[2]):
                grad[m, r, j] = (grad[m, r, j] - along * x[m, r, j]) * scale


@_compiled
def first_layer(of_pair, of_context, attention, shape, norm, x, h, scales, scores):
    """The first hidden layer of every context with every pair.

    x = of_pair + of_context, h = relu(x / std), scores = attention · h; from rows (p, b) and (k, b), and attention
    (M, H, 1).
    """
    contexts, pairs, batch = shape
    zero = x.dtype.type(0.0)
    for m in range(x.shape[0]):
        for k in range(contexts):
            for p in range(pairs):
                for b in range(batch):
                    r, i, c = (k * pairs + p) * batch + b, p * batch + b, k * batch + b
                    for j in range(x.shape[2]):
                        x[m, r, j] = of_pair[m, i, j] + of_context[m, c, j]
                    scale = _inverse_std(x[m, r], norm)
                    score = zero
                    for j in range(x.shape[2]):
                        value = _relu(x[m, r, j]) * scale
                        h[m, r, j] = value
                        score += attention[m, j, 0] * value
                    scales[m, r], scores[m, r] = scale, score


@_compiled
def first_layer_backward(grad, at_scores, attention, x, scales, shape, norm, at_context):
    """Gradients at x, in place of `grad`, that at h less the scores' part; at_context is their sum over pairs."""
    contexts, pairs, batch = shape
    zero = x.dtype.type(0.0)
    at_context[:] = zero
    for m in range(x.shape[0]):
        for k in range(contexts):
            for p in range(pairs):
                for b in range(batch):
                    r, c = (k * pairs + p) * batch + b, k * batch + b
                    along, of_score, scale = zero, at_scores[m, r], scales[m, r]
                    for j in range(x.shape[2]):
                        at_h = grad[m, r, j] + of_score * attention[m, j, 0]
                        masked = at_h if x[m, r, j] > zero else zero
                        grad[m, r, j] = masked
                        along += masked * x[m, r, j]
                    along = along * scale * scale / x.dtype.type(x.shape[2]) if norm else zero
                    for j in range(x.shape[2]):
                        value = (grad[m, r, j] - along * x[m, r, j]) * scale
                        grad[m, r, j] = value
                        at_context[m, c, j] += value


@_compiled
def pool(z, scores, shape, norm, weights, scales, pooled):
    """pooled = sum over pairs of weights · relu(z / std), weights the softmax of scores; scales = 1 / std."""
    contexts, pairs, batch = shape
    for m in range(z.shape[0]):
        for k in range(contexts):
            for b in range(batch):
                first, c = k * pairs * batch + b, k * batch + b
                largest = scores[m, first]
                for p in range(1, pairs):
                    largest = max(largest, scores[m, first + p * batch])
                total = z.dtype.type(0.0)
                for p in range(pairs):
                    r = first + p * batch
                    weights[m, r] = np.exp(scores[m, r] - largest)
                    total += weights[m, r]
                for p in range(pairs):
                    r = first + p * batch
                    weights[m, r] /= total
                    scales[m, r] = _inverse_std(z[m, r], norm)
                    share = weights[m, r] * scales[m, r]
                    for j in range(z.shape[2]):
                        value = _relu(z[m, r, j]) * share
                        pooled[m, c, j] = value if p == 0 else pooled[m, c, j] + value


@_compiled
def pool_backward(grad, z, weights, scales, shape, norm, at_z, at_scores):
    """Gradients at z (up to a multiple of ones in each row) and at scores, from that at pooled."""
    contexts, pairs, batch = shape
    zero = z.dtype.type(0.0)
    for m in range(z.shape[0]):
        for k in range(contexts):
            for b in range(batch):
                first, c = k * pairs * batch + b, k * batch + b
                mean = zero
                for p in range(pairs):
                    r = first + p * batch
                    along = zero
                    for j in range(z.shape[2]):
                        masked = grad[m, c, j] if z[m, r, j] > zero else zero
                        at_z[m, r, j] = masked
                        along += masked * z[m, r, j]
                    scale = scales[m, r]
                    share = weights[m, r] * scale
                    through_norm = share * along * scale * scale / z.dtype.type(z.shape[2]) if norm else zero
                    for j in range(z.shape[2]):
                        at_z[m, r, j] = share * at_z[m, r, j] - through_norm * z[m, r, j]
                    at_scores[m, r] = along * scale
                    mean += weights[m, r] * at_scores[m, r]
                for p in range(pairs):
                    r = first + p * batch
                    at_scores[m, r] = weights[m, r] * (at_scores[m, r] - mean)


@_compiled
def _length(vector):
    total = vector.dtype.type(0.0)
    for k in range(vector.shape[0]):
        total += vector[k] * vector[k]
    return np.sqrt(total)


@_compiled
def _near(offset, distance, tanh_scales, exp_scales, out, at):
    """Write tanhs of an offset (3) and exponentials of a distance to `out` from place `at` on; the next place."""
    for scale in tanh_scales:
        for k in range(3):
            out[at + k] = np.tanh(offset[k] * offset.dtype.type(1 / scale))
        at += 3
    for scale in exp_scales:
        out[at] = np.exp(distance * offset.dtype.type(-1 / scale))
        at += 1
    return at


@_compiled
def _count_wrong(achieved, desired, out):
    """How many bits of a goal are wrong, missing and unwanted."""
    out[:] = 0
    for k in range(achieved.shape[0]):
        difference = desired[k] - achieved[k]
        out[0] += abs(difference)
        out[1] += max(difference, 0)
        out[2] += max(-difference, 0)


@_compiled
def encode(
    rows, shift, scale, clip, detail_scale, sizes, pairs, mode, weights, near_field, scales, state, context, features
):
    """`PairEncoder.encode_rows` without identities, in one pass over a batch.

    Args:
        rows: (S, B, D + 2 bits).
        shift, scale: (D + 2 bits) of the normalisation; `clip` bounds it.
        detail_scale: (D) factors of what the networks see.
        sizes: of the body, of a block, and the number of bits.
        pairs: (P, 5) as in `PairLayout.pairs`.
        mode: 0 where no pair is turned, 1 where the goal turns it, 2 where roles do.
        weights: of the goal's and of the state's "on" in what turns a pair by role.
        near_field: whether its features are wanted.
        scales: of their tanhs, of their exponentials, and of the offset that is fed as it is.
        state, context, features: (S, B, D), (S, B, C) and (S, P, B, F), written.
    """
    body_size, block_size, n_bits = sizes
    tanh_scales, exp_scales, linear_scale = scales
    n_near = 3 * len(tanh_scales) + len(exp_scales)  # features of a block beside the hand
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
