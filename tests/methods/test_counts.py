"""Counts: by hand, and only of what was collected."""

import pytest
import torch
from curiosity import ACTION, fresh, random_transitions

from curiobench.methods.counts import Counts
from curiobench.methods.reward import Collected, Transitions


def episodes(*paths: list[tuple[int, int]]) -> Collected:
    """Of configurations of two predicates."""
    goals = torch.tensor(paths).float()
    n, steps = goals.shape[0], goals.shape[1] - 1
    return Collected(torch.zeros(n, steps + 1, 3), torch.zeros(n, steps, ACTION), goals)


def rewards(method: Counts, *reached: tuple[int, int]) -> list[float]:
    zeros, goals = torch.zeros(len(reached), 3), torch.tensor(reached).float()
    return method.reward(Transitions(zeros, zeros[:, :2], zeros, 0, next_achieved_goal=goals)).tolist()


def test_rewards_by_hand():
    """Where an episode begins does not count. A configuration never met is worth as much as one met once."""
    method = fresh(Counts)
    assert rewards(method, (0, 0), (1, 1)) == [1, 1]
    method.observe(episodes([(0, 0), (0, 1), (0, 1), (0, 1)], [(0, 0), (0, 1), (1, 0), (0, 0)]))
    assert rewards(method, (0, 0), (0, 1), (1, 0), (1, 1)) == pytest.approx([1, 0.5, 1, 1])
    method.observe(episodes([(1, 1), (1, 1), (1, 0), (0, 0)]))
    assert rewards(method, (0, 0), (0, 1), (1, 0), (1, 1)) == pytest.approx([2**-0.5, 0.5, 2**-0.5, 1])
    before = method.state_dict()["visits"]
    assert method.update(random_transitions())["counts_configurations"] == 4
    assert torch.equal(method.state_dict()["visits"], before)  # batches are not counted


def test_every_task_s_predicates_fit():
    bits = torch.eye(30)  # of five blocks
    assert len(Counts.code(bits).unique()) == 30
    assert Counts.code(torch.ones(1, 62)) == 2**62 - 1
