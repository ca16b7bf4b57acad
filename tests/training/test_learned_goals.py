"""Learned goals of one evaluation, counted and as text."""

import pytest

from curiobench.learned_goals import format_goals, format_layers, last_evaluation, learned_by_layer


def evaluation(epoch, *learned):
    return [{"epoch": epoch, "layer": 1 + g // 2, "learned": bit, "goal": f"g{g}"} for g, bit in enumerate(learned)]


def test_the_last_evaluation_is_counted_by_layer():
    last = last_evaluation(evaluation(0, 0, 0, 0, 0) + evaluation(2, 1, 1, 0, 1))
    assert [row["epoch"] for row in last] == [2] * 4
    assert learned_by_layer(last) == {1: (2, 2), 2: (1, 2)}
    with pytest.raises(ValueError, match="there is no evaluation yet"):
        last_evaluation([])


def test_layers_and_goals_as_text():
    assert format_layers({1: (2, 8), 2: (10, 21)}) == (
        "layer  learned  goals\n1            2      8\n2           10     21\ntotal       12     29"
    )
    row = {"goal": "a on b", "bits": "110", "layer": 2, "success": 0.5, "success_unsatisfied": None, "learned": 0}
    assert format_goals([row]).splitlines()[1].split() == ["a", "on", "b", "110", "2", "0.50", "no"]
