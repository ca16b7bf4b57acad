"""Evaluation: the same starts for every agent, success at the last step, goals counted, training untouched."""

import numpy as np
import pytest
from tiny_runs import TINY

from curiobench import evaluation
from curiobench.check.subject import same as same_state
from curiobench.evaluation import (
    Evaluation,
    Evaluator,
    format_goals,
    format_layers,
    last_evaluation,
    learned_by_layer,
)
from curiobench.state import TrainingState
from curiobench.tasks import BatchedStacking
from curiobench.tasks.goals import goal_space


class Recording:
    """An agent that keeps the first observations of each batch of episodes."""

    def __init__(self, action=0.0):
        self.starts, self.action, self.calls = [], action, 0

    def act(self, observation, achieved_goal, desired_goal, deterministic=False):
        assert deterministic
        if self.calls % 50 == 0:
            self.starts.append(observation)
        self.calls += 1
        return np.full((len(observation), 4), self.action, np.float32)


def test_starts_depend_neither_on_the_agent_nor_on_what_happened_before(monkeypatch):
    monkeypatch.setattr(evaluation, "MAX_WORLDS", 3)
    evaluator, calm, wild = Evaluator("stack2", "gripper", 2), Recording(), Recording(0.5)
    evaluator.evaluate(calm)
    assert len(calm.starts) == 3  # 8 episodes, 3 at a time
    step = BatchedStacking.step

    def draw_more(self, actions):
        self.rng.random()  # as a world that diverges does
        return step(self, actions)

    monkeypatch.setattr(BatchedStacking, "step", draw_more)
    evaluator.evaluate(wild)
    np.testing.assert_array_equal(calm.starts, wild.starts)


def test_evaluating_changes_nothing_of_training(tmp_path):
    state = TrainingState(TINY, tmp_path)
    evaluator = Evaluator("stack2", "gripper", 1)
    state.collect()
    before = state.agent.state_dict(), state.save(tmp_path)
    evaluator.evaluate(state.agent)
    after = state.agent.state_dict(), state.save(tmp_path)
    assert same_state(before, after)


def test_success_is_read_at_the_last_step_and_a_diverged_episode_has_failed(monkeypatch):
    step = BatchedStacking.step

    def scripted(self, actions):
        seen, reward = step(self, actions)
        last = self.step_counts[0] == 50
        self.diverged = np.arange(self.n_worlds) == (1 if self.step_counts[0] == 10 else -1)
        return seen, np.full_like(reward, last) if not last else (np.arange(self.n_worlds) < 3).astype(np.float32)

    monkeypatch.setattr(BatchedStacking, "step", scripted)
    outcome = Evaluator("stack2", "gripper", 1).evaluate(Recording())
    np.testing.assert_array_equal(outcome.success[:, 0], [True, False, True, False])


def test_rows_and_layers():
    success = np.array([[1] * 9 + [0], [1] * 8 + [0] * 2, [0] * 10, [1] * 10], bool)
    satisfied = np.array([[1] * 8 + [0] * 2, [1] * 10, [0] * 10, [0] * 10], bool)
    outcome = Evaluation(goal_space(2), success, satisfied)
    assert outcome.learned.tolist() == [True, False, False, True]  # 80 % is not above 80 %
    assert learned_by_layer(outcome.rows()) == {1: (1, 2), 2: (1, 2)}
    first, second, *_ = outcome.rows()
    assert first == {
        "goal": "all apart",
        "bits": "000",
        "layer": 1,
        "episodes": 10,
        "success": 0.9,
        "episodes_unsatisfied": 2,
        "success_unsatisfied": 0.5,
        "learned": 1,
    }
    assert second["success_unsatisfied"] is None


def test_refuses_no_episodes():
    with pytest.raises(ValueError, match="episodes per goal is 0"):
        Evaluator("stack2", "gripper", 0)


def rows_of(epoch, *learned):
    return [{"epoch": epoch, "layer": 1 + g // 2, "learned": bit, "goal": f"g{g}"} for g, bit in enumerate(learned)]


def test_the_last_evaluation_is_counted_by_layer():
    last = last_evaluation(rows_of(0, 0, 0, 0, 0) + rows_of(2, 1, 1, 0, 1))
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
