"""Curricula: which goals are drawn, and how often."""

import numpy as np
import pytest

from curiobench.curriculum import CURRICULA
from curiobench.methods.curriculum import Goals, Situation

GOALS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1]], np.uint8)


def shares(curriculum: str, reached: list[bool], start: list[int]) -> np.ndarray:
    """How often each goal is drawn for episodes with this start."""
    situation = Situation(np.array(reached), np.tile(np.array(start, np.uint8), (8000, 1)))
    goals = Goals(GOALS, np.ones(len(GOALS), int), np.array([[0, 1, 2]]))
    drawn, tested = CURRICULA[curriculum](goals).draw(situation, np.random.default_rng(0))
    assert not tested.any()
    return np.bincount(drawn, minlength=len(GOALS)) / len(drawn)


@pytest.mark.parametrize(
    ("reached", "expected"), [([False, True, False, True], [0, 0.5, 0, 0.5]), ([False] * 4, [0.25] * 4)]
)
def test_reached_is_uniform_over_goals_reached_or_over_all(reached, expected):
    assert shares("reached", reached, [0, 0, 0]) == pytest.approx(expected, abs=0.02)


def test_valid_is_uniform_over_all_goals():
    assert shares("valid", [False, True, False, False], [0, 0, 0]) == pytest.approx([0.25] * 4, abs=0.02)


def test_near_weighs_reached_goals_by_their_distance_from_the_start():
    """Half uniform over three; half by exp(-d), d = 1 and 2 from the start, which itself is not drawn there."""
    weights = np.exp([-1.0, -2.0])
    near = np.array([0, *(weights / weights.sum()), 0])
    uniform = np.array([1, 1, 1, 0]) / 3
    assert shares("near", [True, True, True, False], [0, 0, 0]) == pytest.approx((near + uniform) / 2, abs=0.02)


def test_near_falls_back_where_only_the_start_s_own_goal_was_reached():
    assert shares("near", [True, False, False, False], [0, 0, 0]).tolist() == [1, 0, 0, 0]
