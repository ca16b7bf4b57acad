"""Queues: the same as plain lists."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from curiobench.queues import Queues


@settings(max_examples=60)
@given(st.lists(st.tuples(st.lists(st.integers(0, 3), max_size=9), st.integers(0, 9)), max_size=12))
def test_queues_equal_lists(rounds):
    """Each round appends numbers to groups, then removes the oldest ones of some group."""
    queues, lists, number = Queues(4), [[] for _ in range(4)], 0
    for groups, gone in rounds:
        queues.push(np.array(groups, int), number + np.arange(len(groups)))
        for group in groups:
            lists[group].append(number)
            number += 1
        dropped = [group for group in range(4) for _ in range(min(gone, len(lists[group])))]
        queues.drop(np.array(dropped, int))
        for group in dropped:
            lists[group].pop(0)
        assert queues.counts.tolist() == [len(held) for held in lists]
        for group, held in enumerate(lists):
            places = (np.arange(len(held)) + 0.5) / max(1, len(held))
            assert queues.draw(np.full(len(held), group), places).tolist() == held
