"""Loops of `pair_attention.py` that read and write each number once, compiled by Numba for the CPU.

At these sizes the memory traffic of an operation on all activations costs more than its arithmetic, and each call takes
microseconds. Arrays are C-contiguous and of one float type: (M, R, H) and (M, R), for M members of R rows of
H units. The rows of K contexts, P pairs and B transitions are numbered in the order (k, p, b) or (k, b); `shape` is
(K, P, B).

A norm divides rows, which are centred already, by their standard deviation. If `norm` is False, it divides by 1.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from numba.core.dispatcher import Dispatcher

Function = TypeVar("Function", bound=Callable[..., Any])
Shape: TypeAlias = tuple[int, int, int]

EPSILON = 1e-5
"""Added to variances in norms."""

# sums may be reordered, but NaN and infinity are preserved, so that a non-finite loss is detected
_FASTMATH = {"reassoc", "contract", "arcp", "nsz"}


def compiled(function: Function) -> "Dispatcher[Function]":
    """Compile a function for each type that it is called with. Cached on disk if a cache folder is writable."""
    try:
        return njit(cache=True, fastmath=_FASTMATH, error_model="numpy")(function)
    except RuntimeError:  # neither the folder of this file nor the user's own can be written
        return njit(fastmath=_FASTMATH, error_model="numpy")(function)


@compiled
def centre(weights: np.ndarray, out: np.ndarray) -> None:
    """out = weights (M, R, H) minus the mean of each row; both may be the same array."""
    units = weights.shape[2]
    for m in range(weights.shape[0]):
        for r in range(weights.shape[1]):
            total = weights.dtype.type(0.0)
            for j in range(units):
                total += weights[m, r, j]
            total /= weights.dtype.type(units)
            for j in range(units):
                out[m, r, j] = weights[m, r, j] - total


@compiled
def _inverse_std(row: np.ndarray, norm: bool) -> Any:
    """1 / standard deviation of a centred row (H)."""
    if not norm:
        return row.dtype.type(1.0)
    total = row.dtype.type(0.0)
    for j in range(row.shape[0]):
        total += row[j] * row[j]
    return row.dtype.type(1.0) / np.sqrt(total / row.dtype.type(row.shape[0]) + row.dtype.type(EPSILON))


@compiled
def _relu(value: Any) -> Any:
    return value - value if value < 0 else value  # NaN stays, as in torch


@compiled
def norm_relu(x: np.ndarray, norm: bool, out: np.ndarray, scales: np.ndarray) -> None:
    """out = relu(x / std), and 1 / std in scales."""
    for m in range(x.shape[0]):
        for r in range(x.shape[1]):
            scale = _inverse_std(x[m, r], norm)
            scales[m, r] = scale
            for j in range(x.shape[2]):
                out[m, r, j] = _relu(x[m, r, j]) * scale


@compiled
def norm_relu_backward(grad: np.ndarray, x: np.ndarray, scales: np.ndarray, norm: bool) -> None:
    """Replace `grad`, the gradient at the output, by the gradient at x, up to a constant in each row.

    The gradient of centring removes that constant.
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


@compiled
def first_layer(
    of_pair: np.ndarray,
    of_context: np.ndarray,
    attention: np.ndarray,
    shape: Shape,
    norm: bool,
    x: np.ndarray,
    h: np.ndarray,
    scales: np.ndarray,
    scores: np.ndarray,
) -> None:
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


@compiled
def first_layer_backward(
    grad: np.ndarray,
    at_scores: np.ndarray,
    attention: np.ndarray,
    x: np.ndarray,
    scales: np.ndarray,
    shape: Shape,
    norm: bool,
    at_context: np.ndarray,
) -> None:
    """Replace `grad`, the gradient at h without the scores' part, by the gradient at x (up to a constant in each row).

    at_context becomes its sum over pairs.
    """
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


@compiled
def pool(
    z: np.ndarray,
    scores: np.ndarray,
    shape: Shape,
    norm: bool,
    weights: np.ndarray,
    scales: np.ndarray,
    pooled: np.ndarray,
) -> None:
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


@compiled
def pool_backward(
    grad: np.ndarray,
    z: np.ndarray,
    weights: np.ndarray,
    scales: np.ndarray,
    shape: Shape,
    norm: bool,
    at_z: np.ndarray,
    at_scores: np.ndarray,
) -> None:
    """Gradients at z (up to a constant in each row) and at scores, from the gradient at pooled."""
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
