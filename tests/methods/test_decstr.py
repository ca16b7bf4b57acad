"""DECSTR's curriculum: its buckets, progress by hand, and what is drawn how often."""

import json

import numpy as np
import pytest
from scipy.stats import chisquare

from curiobench.build import goals_of
from curiobench.methods.curriculum import Goals, Situation
from curiobench.methods.decstr import DECSTR, DECSTRConfig, buckets
from curiobench.tasks.goals import goal_space

THREE = goals_of(goal_space(3))
OF_BUCKET = {
    0: {"all apart", "a close to b, c apart"},
    1: {"a close to b and c", "all close"},
    2: {"a on b, c apart", "a on b, c close to b"},
    3: {"a on b, c close to a and b", "a on b and c"},
    4: {"a on b, b on c", "a on b, c on a"},
}
"""Some goals of each of the authors' buckets, which they list as bits."""


def method(goals: Goals = THREE, **config) -> DECSTR:
    return DECSTR(goals, DECSTRConfig(**config))


def with_history(**config) -> DECSTR:
    """Three goals, a bucket each: progress 0.5 and competence 0.75; 0.25 and 0.25 (it got worse); too few tests."""
    goals = Goals(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0]], np.uint8), np.array([1, 2, 3]), np.array([[0, 1, 2]]))
    found = method(goals, window=8, least=4, **config)
    for goal, outcomes in ((0, "111100010111"), (1, "01010100"), (2, "111")):
        for success in outcomes:
            found.observe(
                np.array([goal, goal]), np.array([goal if success == "1" else -1, goal]), np.array([1, 0]) > 0
            )
    found.end_epoch()
    return found


def situation(n: int) -> Situation:
    return Situation(np.zeros(3, bool), np.zeros((n, 3), np.uint8))


def test_buckets_of_three_blocks_are_the_authors():
    found, names = buckets(THREE), goal_space(3).names
    assert np.bincount(found).tolist() == [4, 4, 12, 9, 6]
    for bucket, some in OF_BUCKET.items():
        assert some <= {name for name, b in zip(names, found, strict=True) if b == bucket}


@pytest.mark.parametrize(("n_blocks", "n_buckets"), [(2, 2), (4, 6)])
def test_buckets_of_other_tasks_leave_no_gap(n_blocks, n_buckets):
    assert set(buckets(goals_of(goal_space(n_blocks)))) == set(range(n_buckets))


def test_competence_and_progress_by_hand():
    """Of the last eight tests: 0001 0111, and 0101 0100. Episodes that are no tests do not count."""
    found = with_history()
    assert found.competence.tolist() == [0.75, 0.25, 0.0]
    assert found.progress.tolist() == [0.5, 0.25, 0.0]
    weights = np.array([0.25 * 0.5, 0.75 * 0.25, 0.0])
    np.testing.assert_allclose(found.probabilities, weights / weights.sum())
    assert found.metrics()["decstr_competence_0"] == 0.75


def test_without_progress_every_bucket_is_as_likely():
    np.testing.assert_allclose(method().probabilities, 0.2)
    assert method().replay_weights().sum() == pytest.approx(1)


def test_goals_are_drawn_by_bucket_and_uniformly_in_it():
    """A test's bucket is uniform; the others' has the probability p."""
    found, n = method(test_share=0.3), 20_000
    found.competence[:], found.progress[:] = [0.5, 0.2, 0, 0, 0], [0.2, 0.5, 0, 0, 0.5]
    drawn, tested = found.draw(Situation(np.zeros(35, bool), np.zeros((n, 9))), np.random.default_rng(0))
    assert tested.mean() == pytest.approx(0.3, abs=0.01)
    sizes = np.bincount(found.buckets)
    for chosen, probabilities in ((tested, np.full(5, 0.2)), (~tested, np.array([0.1, 0.4, 0, 0, 0.5]))):
        expected = (probabilities / sizes)[found.buckets]
        counts = np.bincount(drawn[chosen], minlength=35)
        assert not counts[expected == 0].any()
        assert chisquare(counts[expected > 0], chosen.sum() * expected[expected > 0]).pvalue > 1e-3
    np.testing.assert_allclose(found.replay_weights(), (np.array([0.1, 0.4, 0, 0, 0.5]) / sizes)[found.buckets])


def test_a_saved_curriculum_continues_with_the_same_draws():
    first, second = with_history(), with_history()
    second.tests[0].clear()
    second.load_state_dict(json.loads(json.dumps(first.state_dict())))
    for curriculum in (first, second):
        curriculum.observe(np.array([1]), np.array([1]), np.array([True]))
        curriculum.end_epoch()
    assert first.state_dict() == second.state_dict()
    draws = [curriculum.draw(situation(9), np.random.default_rng(0))[0].tolist() for curriculum in (first, second)]
    assert draws[0] == draws[1]
