"""Statistics: rliable's own examples, and the same numbers by another route in plain numpy.

The score matrices X, Y and A are those of rliable's tests (google-research/rliable, tests/rliable/metrics_test.py and
tests/library_test.py), and so are the values that are written out here for them.
"""

from itertools import product

import numpy as np
import pytest

from curiobench.analysis.statistics import (
    ENOUGH_SEEDS,
    curve_interval,
    improvement_interval,
    interquartile_mean,
    performance_profile,
    probability_of_improvement,
    seed_warnings,
    stratified_bootstrap,
)

X = np.array([[1, 2], [2, 2], [1, 1], [2, 1]])
Y = np.array([[1, 1], [2, 2], [3, 3]])
A = np.arange(80).reshape(5, 16)
B = A[::-1]


def middle_half(scores):
    """Interquartile mean by sorting."""
    values = np.sort(np.asarray(scores, float).ravel())
    cut = len(values) // 4
    return values[cut : len(values) - cut].mean()


def pairs_won(x, y):
    """Probability of improvement by going through all pairs, a task at a time."""
    tasks = zip(x.T, y.T, strict=True)
    return np.mean([np.mean([(a > b) + 0.5 * (a == b) for a, b in product(*pair)]) for pair in tasks])


def resampled(scores, statistic, n, rng):
    """Statistic of n resamples, each column drawn by itself; one after the other."""
    columns = np.arange(scores.shape[1])
    return np.array([statistic(scores[rng.integers(0, len(scores), scores.shape), columns]) for _ in range(n)])


def test_rliables_own_examples():
    assert interquartile_mean(X) == 1.5
    assert interquartile_mean(Y) == 2
    assert probability_of_improvement(X, Y) == pytest.approx(1 / 3)
    thresholds = np.array([0.0, 0.25, 0.5, 1.0])
    for scores in (A, B):
        assert performance_profile(scores, thresholds).tolist() == [np.mean(scores > t) for t in thresholds]


@pytest.mark.parametrize("shape", [(3, 1), (5, 4), (7, 35)])
def test_point_estimates_by_another_route(shape):
    rng = np.random.default_rng(1)
    x, y = rng.integers(0, 6, shape) / 5, rng.integers(0, 6, (shape[0] + 1, shape[1])) / 5
    assert interquartile_mean(x) == pytest.approx(middle_half(x))
    assert probability_of_improvement(x, y) == pytest.approx(pairs_won(x, y))
    assert probability_of_improvement(x, y) + probability_of_improvement(y, x) == pytest.approx(1)
    assert probability_of_improvement(x, x) == pytest.approx(0.5)


@pytest.mark.parametrize("statistic", [interquartile_mean, np.mean])
def test_stratified_interval_by_another_route(statistic):
    low, high = stratified_bootstrap(A, statistic, resamples=4_000)
    expected = np.quantile(resampled(A, statistic, 4_000, np.random.default_rng(7)), [0.025, 0.975])
    spread = expected[1] - expected[0]
    assert [low, high] == pytest.approx(expected, abs=0.08 * spread)
    assert low < statistic(A) < high


def test_strata_are_resampled_apart_and_a_third_axis_together():
    scores = np.array([[0.0, 0.0], [1.0, 1.0]])
    apart = stratified_bootstrap(scores, np.mean)
    together = stratified_bootstrap(scores[:, None, :], np.mean)
    # two seeds: a mean of four draws is 0 or 1 with probability 1/16 each, of two draws with 1/4 each
    assert apart == (0.0, 1.0)
    assert stratified_bootstrap(scores, np.mean, confidence=0.8) == (0.25, 0.75)
    assert together == stratified_bootstrap(scores[:, None, :], np.mean, confidence=0.6) == (0.0, 1.0)


def test_interval_of_means_against_all_resamples_there_are():
    seeds = np.array([0.1, 0.4, 0.7, 1.0])
    every = [np.mean(chosen) for chosen in product(seeds, repeat=4)]
    low, high = curve_interval(np.column_stack([seeds, 10 * seeds]), resamples=50_000)
    exact = np.quantile(every, [0.025, 0.975])
    assert [low[0], high[0]] == pytest.approx(exact, abs=1e-9)
    assert [low[1], high[1]] == pytest.approx(10 * exact, abs=1e-9)
    assert stratified_bootstrap(seeds[:, None], np.mean, resamples=50_000) == pytest.approx(exact, abs=1e-9)


def test_interval_of_the_probability_of_improvement_by_another_route():
    rng = np.random.default_rng(3)
    found = []
    for _ in range(2_000):
        rows_a, rows_b = rng.integers(0, 5, A.shape), rng.integers(0, 3, (3, 16))
        found.append(pairs_won(A[rows_a, np.arange(16)], B[:3][rows_b, np.arange(16)] - 20))
    low, high = improvement_interval(A, B[:3] - 20)
    assert [low, high] == pytest.approx(np.quantile(found, [0.025, 0.975]), abs=0.02)


def test_the_same_numbers_twice_and_others_with_another_seed():
    scores = np.random.default_rng(0).random((5, 3))
    for interval in (
        lambda seed: stratified_bootstrap(scores, interquartile_mean, seed=seed),
        lambda seed: tuple(end[0] for end in curve_interval(scores, resamples=50, seed=seed)),
        lambda seed: improvement_interval(scores, scores[:4] / 2, seed=seed),
    ):
        assert interval(0) == interval(0)
        assert interval(0) != interval(1)


def test_one_seed_has_no_interval():
    assert np.isnan(stratified_bootstrap(X[:1], np.mean)).all()
    assert np.isnan(curve_interval(X[:1])).all()
    assert np.isnan(improvement_interval(X, Y[:1])).all()


def test_too_few_seeds_are_named():
    assert seed_warnings([("sac", 1)]) == ["1 seed: no interval, and nothing to conclude about the method"]
    assert seed_warnings([("sac", 3), ("icm", 3)])[0].startswith("3 seeds are too few")
    assert seed_warnings([("sac", ENOUGH_SEEDS)]) == []
    (line,) = seed_warnings([("sac", ENOUGH_SEEDS), ("icm", 3), *((f"m{i}", 2) for i in range(4))])
    assert line.startswith("2 seeds of 4 methods and 3 seeds of icm are too few")


def test_few_seeds_cover_less_than_they_claim():
    """The coverage that docs/results.md tells: normal scores, intervals of 95 %."""
    rng = np.random.default_rng(0)
    for n_seeds, coverage in ((3, 0.75), (5, 0.84), (10, 0.90)):
        low, high = curve_interval(rng.normal(size=(n_seeds, 4_000)), resamples=1_000)
        assert np.mean((low <= 0) & (high >= 0)) == pytest.approx(coverage, abs=0.02)


@pytest.mark.parametrize("scores", [np.zeros(3), np.zeros((0, 2)), [[0.0, np.nan]], [[np.inf, 1.0]]])
def test_unfit_scores_are_refused(scores):
    with pytest.raises(ValueError, match="score"):
        stratified_bootstrap(np.asarray(scores), np.mean)
    with pytest.raises(ValueError, match="score"):
        probability_of_improvement(np.asarray(scores), np.zeros((2, 2)))


def test_unlike_strata_are_refused():
    with pytest.raises(ValueError, match="2 strata cannot be compared with scores of 3"):
        probability_of_improvement(np.zeros((2, 2)), np.zeros((2, 3)))
