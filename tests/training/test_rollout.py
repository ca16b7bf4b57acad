"""Collecting: which goals are pursued, what an episode holds, and what stops it."""

from dataclasses import replace

import numpy as np
import pytest
from tiny_runs import TINY

from curiobench.methods.guard import NonFiniteError
from curiobench.rollout import collect
from curiobench.state import TrainingState
from curiobench.tasks import BatchedStacking


class Still:
    """An agent that does nothing; it remembers what it was asked."""

    def __init__(self):
        self.calls = []

    def act(self, observation, achieved_goal, desired_goal, deterministic=False):
        self.calls.append((observation, deterministic))
        return np.zeros((len(observation), 4), np.float32)


@pytest.fixture(scope="module")
def worlds():
    return BatchedStacking("stack2", 3, seed=0)


def test_an_episode_holds_what_the_agent_saw_and_did(worlds):
    agent, goals = Still(), worlds.goal_space.goals[[0, 1, 2]]
    worlds.reset()
    episodes, whole = collect(worlds, agent, goals)
    assert whole.all()
    assert episodes.observation.shape == (3, 51, worlds.observation_size)
    assert episodes.achieved_goal.shape == (3, 51, 3)
    assert episodes.action.shape == (3, 50, 4)
    assert len(agent.calls) == 50
    assert not any(deterministic for _, deterministic in agent.calls)
    np.testing.assert_array_equal(episodes.observation[:, :50].swapaxes(0, 1), [seen for seen, _ in agent.calls])
    np.testing.assert_array_equal(episodes.observation[:, 50], worlds.observe().observation)
    np.testing.assert_array_equal(episodes.achieved_goal[:, 50], worlds.observe().achieved_goal)


def test_diverged_episodes_are_left_out(worlds, monkeypatch):
    step = BatchedStacking.step

    def diverge_once(self, actions):
        outcome = step(self, actions)
        self.diverged = np.array([False, self.step_counts[0] == 20, False])
        return outcome

    monkeypatch.setattr(BatchedStacking, "step", diverge_once)
    goals = worlds.goal_space.goals[[0, 1, 2]]
    worlds.reset()
    episodes, whole = collect(worlds, Still(), goals)
    np.testing.assert_array_equal(episodes.desired_goal, goals[[0, 2]])
    assert whole.tolist() == [True, False, True]


def test_in_a_test_episode_the_agent_does_not_explore(worlds):
    agent = Still()
    worlds.reset()
    collect(worlds, agent, worlds.goal_space.goals[[0, 1, 2]], np.array([False, True, False]))
    assert [(len(seen), deterministic) for seen, deterministic in agent.calls] == [(3, False), (1, True)] * 50


def test_an_observation_that_is_not_finite_is_named(worlds, monkeypatch):
    observe = BatchedStacking.observe

    def spoil(self):
        seen = observe(self)
        if self.step_counts[0] == 7:
            seen.observation[2, 5] = np.nan
        return seen

    monkeypatch.setattr(BatchedStacking, "observe", spoil)
    worlds.reset()
    with pytest.raises(NonFiniteError, match="step 7 of an episode: entry 5 of world 2's observation is nan"):
        collect(worlds, Still(), worlds.goal_space.goals[[0, 0, 0]])


@pytest.mark.parametrize(("starts", "expected"), [("biased", [False, True]), ("plain", [False, False])])
def test_biased_starts_begin_with_their_epoch_or_never(tmp_path, monkeypatch, starts, expected):
    seen, reset = [], BatchedStacking.reset

    def note(self, worlds=None, biased=False, goals=None):
        seen.append(biased)
        return reset(self, worlds, biased, goals)

    state = TrainingState(replace(TINY, starts=starts), tmp_path)
    monkeypatch.setattr(BatchedStacking, "reset", note)
    state.collect()
    state.counters.epoch = TINY.biased_from_epoch
    state.collect()
    assert seen == expected
