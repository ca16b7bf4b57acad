"""Statistics of a few seeds, as Agarwal et al. (2021), "Deep RL at the edge of the statistical precipice", define them.

Scores are arrays `(S, T)` of S seeds and T strata, such as tasks. With a third axis `(S, T, G)`, the last axis holds
scores of the same agent, such as one per goal. These depend on each other, so bootstrap resampling keeps them together.
Intervals are percentile bootstrap intervals, from a random generator with its own seed. They are NaN for fewer than two
seeds. Scores with another shape or with values that are not finite raise ValueError.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

CONFIDENCE, RESAMPLES = 0.95, 2_000
ENOUGH_SEEDS = 10  # with fewer, intervals are much too narrow; docs/results.md gives their actual coverage
_ENDS = (1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2
_BATCH = 500_000  # number of scores resampled at a time, small enough for a processor's cache


def interquartile_mean(scores: np.ndarray, axis: int | None = None) -> np.ndarray | float:
    """Mean of the middle half of the scores, without the lowest and highest quarter, along an axis or over all."""
    from scipy.stats import trim_mean  # the import takes a second

    return trim_mean(scores, 0.25, axis=axis)


def stratified_bootstrap(
    scores: np.ndarray,
    statistic: Callable[..., np.ndarray],
    confidence: float = CONFIDENCE,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> tuple[float, float]:
    """Confidence interval of a statistic. Seeds are resampled in each stratum independently.

    Args:
        scores: `(S, T)` or `(S, T, G)`.
        statistic: function of all scores along an `axis`, in any order, such as `interquartile_mean` or `np.mean`.
        confidence: confidence level of the interval.
        resamples: number of bootstrap resamples.
        seed: seed of the resampling.

    Returns:
        Low and high end of the interval.
    """
    scores = _checked(scores, (2, 3))
    if len(scores) < 2:
        return float("nan"), float("nan")
    from scipy import stats

    def of_resamples(*chosen: np.ndarray, axis: int) -> np.ndarray:
        """Statistic `(R,)` of the resamples, given the seeds `(R, S)` drawn in each stratum."""
        drawn = [scores[seeds.astype(int), stratum] for stratum, seeds in enumerate(chosen)]  # (R, S) or (R, S, G) each
        return statistic(np.stack(drawn, axis=1).reshape(len(drawn[0]), -1), axis=-1)

    interval = stats.bootstrap(
        [np.arange(len(scores))] * scores.shape[1],
        of_resamples,
        n_resamples=resamples,
        batch=max(1, _BATCH // scores.size),
        vectorized=True,
        confidence_level=confidence,
        method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return float(interval.low), float(interval.high)


def curve_interval(values: np.ndarray, resamples: int = RESAMPLES, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Intervals `(…)` of means over seeds of values `(S, …)`, such as one value per seed and epoch."""
    values = _checked(values, range(1, 10))
    if len(values) < 2:
        return np.full(values.shape[1:], np.nan), np.full(values.shape[1:], np.nan)
    counts = _counts_of_seed(len(values), resamples, seed)
    means = (counts @ values.reshape(len(values), -1) / len(values)).reshape(resamples, *values.shape[1:])
    low, high = np.quantile(means, _ENDS, axis=0)
    return low, high


def probability_of_improvement(x: np.ndarray, y: np.ndarray) -> float:
    """Probability that a random run of x `(S, T)` scores higher than one of y `(S', T)`, averaged over strata.

    This is the Mann-Whitney statistic divided by the number of pairs. Ties count half. Raises ValueError if the numbers
    of strata differ.
    """
    return float(_wins(x, y).mean())


def improvement_interval(x: np.ndarray, y: np.ndarray, seed: int = 0) -> tuple[float, float]:
    """Interval of `probability_of_improvement`; seeds of x and of y are resampled in each stratum."""
    wins = _wins(x, y)  # (T, S, S')
    if min(wins.shape[1:]) < 2:
        return float("nan"), float("nan")
    rng = np.random.default_rng(seed)
    found = np.zeros(RESAMPLES)
    for stratum in wins:
        left, right = (_counts(size, RESAMPLES, rng) for size in stratum.shape)
        found += (left @ stratum * right).sum(axis=1) / stratum.size
    low, high = np.quantile(found / len(wins), _ENDS)
    return float(low), float(high)


def performance_profile(scores: np.ndarray, thresholds: np.ndarray) -> np.ndarray:
    """Share `(K,)` of scores `(S, T)` above each threshold `(K,)`; all strata have equal weight."""
    scores = np.sort(_checked(scores, (2,)), axis=None)
    return 1 - np.searchsorted(scores, np.asarray(thresholds), side="right") / scores.size


def area_under_curve(epochs: np.ndarray, success: np.ndarray) -> np.ndarray:
    """Mean success `(…)` over training: the area under `(…, E)` by the trapezoidal rule, divided by its length.

    The epochs `(E,)` are increasing. For a single evaluation the result is its success.
    """
    if len(epochs) == 1:
        return success[..., 0]
    return np.trapezoid(success, epochs, axis=-1) / (epochs[-1] - epochs[0])


def seed_warnings(sizes: Sequence[tuple[str, int]]) -> list[str]:
    """Warnings about too few seeds, given the name and number of seeds of each method.

    They cover the numbers of seeds below `ENOUGH_SEEDS`, and name the methods unless all have the same number.
    """
    by_size: dict[int, list[str]] = {}
    for name, size in sizes:
        by_size.setdefault(size, []).append(name)
    said = {}
    for size, names in sorted(by_size.items()):
        whose = ", ".join(names) if len(names) <= 3 else f"{len(names)} methods"
        said[size] = f"{size} seed" + "s" * (size > 1) + (f" of {whose}" if len(by_size) > 1 else "")
    lines = [f"{said[1]}: no interval, and nothing to conclude about the method"] if 1 in said else []
    if few := [text for size, text in said.items() if 1 < size < ENOUGH_SEEDS]:
        narrow = f"intervals of fewer than {ENOUGH_SEEDS} are much too narrow"
        lines.append(f"{' and '.join(few)} are too few to conclude: {narrow}")
    return lines


def _checked(scores: np.ndarray, dimensions: tuple[int, ...] | range) -> np.ndarray:
    scores = np.asarray(scores, float)
    if scores.ndim not in dimensions or not scores.size:
        raise ValueError(f"scores have the shape {scores.shape}; the first axis is seeds, the second strata")
    if not np.isfinite(scores).all():
        raise ValueError("a score is not finite")
    return scores


def _counts(size: int, resamples: int, rng: np.random.Generator) -> np.ndarray:
    """How often each seed is in each resample, `(R, S)`; one matrix product then gives the means of all resamples."""
    return rng.multinomial(size, np.full(size, 1 / size), resamples).astype(float)


@lru_cache(maxsize=8)
def _counts_of_seed(size: int, resamples: int, seed: int) -> np.ndarray:
    """`_counts` from a new generator, cached because all curves of a figure use the same counts."""
    return _counts(size, resamples, np.random.default_rng(seed))


def _wins(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """`(T, S, S')`, 1 where the run of x is better, ½ where both are equal, else 0."""
    x, y = _checked(x, (2,)), _checked(y, (2,))
    if x.shape[1] != y.shape[1]:
        raise ValueError(f"scores of {x.shape[1]} strata cannot be compared with scores of {y.shape[1]}")
    first, second = x.T[:, :, None], y.T[:, None, :]
    return (first > second) + (first == second) / 2
