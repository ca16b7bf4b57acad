"""The protocol's constants are those that evaluations come from."""

import numpy as np
import pytest

from curiobench.evaluation import Evaluator
from curiobench.protocol import satisfied_starts
from curiobench.tasks import BatchedStacking
from curiobench.versions import versions


class Still:
    """An agent that does nothing."""

    def act(self, observation, *_, **__):
        return np.zeros((len(observation), 4))


@pytest.mark.parametrize("episodes", [10, 25])
@pytest.mark.parametrize(
    ("task", "robot"),
    [
        ("stack2", "gripper"),
        ("stack3", "gripper"),
        pytest.param("stack4", "gripper", marks=pytest.mark.slow),
        pytest.param("stack4", "fetch", marks=pytest.mark.slow),
    ],
)
def test_satisfied_starts_are_those_of_the_evaluation(monkeypatch, task, robot, episodes):
    monkeypatch.setattr(BatchedStacking, "horizon", 1)
    rows = Evaluator(task, robot, episodes).evaluate(Still()).rows()
    held = {row["bits"]: row["episodes"] - row["episodes_unsatisfied"] for row in rows}
    assert {bits: count for bits, count in held.items() if count} == satisfied_starts(task, episodes)


def test_other_numbers_of_episodes_are_not_on_record():
    assert satisfied_starts("stack2", 11) is None
    assert satisfied_starts("stack5", 25) is None


def test_runs_write_the_protocol_down():
    found = versions("sac")
    assert (found["task_version"], found["evaluation_seed"]) == (1, 20_260)
