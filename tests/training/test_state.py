"""What a run records, from episodes and an evaluation that are made up."""

from dataclasses import replace

import numpy as np
from tiny_runs import TINY

from curiobench import state as module
from curiobench.evaluation import Evaluation
from curiobench.replay import Episodes
from curiobench.state import TrainingState, progress_row
from curiobench.tasks.goals import goal_space

STACK, NOWHERE = [1, 1, 0], [0, 1, 0]
"""Bits: a on b, and no valid goal."""


def test_a_row_of_progress_by_hand(tmp_path, monkeypatch):
    starts = [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [1, 0, 0]]
    ends = [[0, 0, 0], [1, 0, 0], STACK, NOWHERE, STACK]
    desired = [[0, 0, 0], [1, 0, 0], [1, 0, 0], STACK, [1, 0, 1]]  # the first two succeed, one of them from the start
    achieved = np.repeat(np.array([starts], np.uint8).swapaxes(0, 1), 51, axis=1)
    achieved[:, -1] = ends
    episodes = Episodes(np.zeros((5, 51, 40)), achieved, np.zeros((5, 50, 4)), np.array(desired, np.uint8))
    monkeypatch.setattr(module, "collect", lambda *_: (episodes, np.arange(7) < 5))
    state = TrainingState(replace(TINY, worlds=7), tmp_path)
    state.collect()
    succeeded = np.ones((4, 10), bool)
    succeeded[2:, 0] = False
    row = progress_row(state, Evaluation(goal_space(2), succeeded, np.zeros((4, 10), bool)))
    counts = {"epoch": 1, "steps": 350, "updates": 0, "episodes": 7, "diverged": 2}
    rates = {"training_success": 2 / 7, "training_success_unsatisfied": 1 / 4, "success": 0.95}
    expected = counts | rates | {"goals_reached": 3, "goals_learned": 4}
    assert {name: row[name] for name in expected} == expected
    assert progress_row(state, None)["success"] is None
