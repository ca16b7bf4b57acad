"""Batched worlds equal the composer environment, whatever the number of worlds and threads."""

import itertools
import logging

import numpy as np
import pytest

from curiobench.tasks import ROBOTS, BatchedStacking, load
from curiobench.tasks.goals import GoalSpace, goal_space, predicates
from curiobench.tasks.placements import _placements


@pytest.mark.parametrize("robot", ROBOTS)
def test_composer_environment_and_batched_worlds_agree_to_the_bit(robot):
    """Both make the same MuJoCo steps: commands computed by the same code, solver cold at each control step."""
    environment = load("stack3", robot, biased=True, random_state=0)
    worlds = BatchedStacking("stack3", 1, robot)
    rng = np.random.default_rng(1)
    for _ in range(6 if robot == "gripper" else 2):
        timestep = environment.reset()
        worlds.qpos[:] = environment.physics.data.qpos
        worlds._qvel[:] = 0
        worlds.desired_goal[:] = timestep.observation["desired_goal"]
        for _ in range(50):
            action = rng.uniform(-1, 1, 4)
            timestep = environment.step(action)
            seen, reward = worlds.step(action[None])
            np.testing.assert_array_equal(worlds.qpos[0], environment.physics.data.qpos)
            np.testing.assert_array_equal(worlds._qvel[0], environment.physics.data.qvel)
            np.testing.assert_array_equal(seen.observation[0], timestep.observation["observation"])
            np.testing.assert_array_equal(seen.achieved_goal[0], timestep.observation["achieved_goal"])
            assert reward[0] == timestep.reward


def play(n_worlds: int = 12, n_threads: int = 1, seed: int = 0, steps: int = 20) -> list[np.ndarray]:
    worlds = BatchedStacking("stack3", n_worlds, n_threads=n_threads, seed=seed)
    worlds.reset(biased=True)
    rng = np.random.default_rng(5)
    seen = []
    for _ in range(steps):
        observation, reward = worlds.step(rng.uniform(-1, 1, (n_worlds, 4)))
        seen += [observation.observation, observation.achieved_goal, observation.desired_goal, reward]
    return seen


def test_numbers_depend_on_the_seed_and_not_on_threads():
    one, three, other = play(), play(n_threads=3), play(seed=1)
    assert all(np.array_equal(a, b) for a, b in zip(one, three, strict=True))
    assert not np.array_equal(one[0], other[0])


def test_worlds_do_not_influence_each_other():
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (10, 4))
    alone = BatchedStacking("stack2", 1, seed=0)
    among = BatchedStacking("stack2", 3, seed=1)
    among.qpos[1] = alone.qpos[0]
    for action in actions:
        single, _ = alone.step(action[None])
        crowd, _ = among.step(np.stack([-action, action, rng.uniform(-1, 1, 4)]))
        np.testing.assert_array_equal(single.observation[0], crowd.observation[1])


def test_a_reset_touches_only_its_worlds():
    worlds = BatchedStacking("stack3", 4, seed=0)
    worlds.step(np.full((4, 4), 0.5))
    before = worlds.observe()
    after = worlds.reset(np.array([1, 3]), goals=goal_space(3).goals[[7, 9]])
    np.testing.assert_array_equal(after.observation[[0, 2]], before.observation[[0, 2]])
    np.testing.assert_array_equal(after.desired_goal[[1, 3]], goal_space(3).goals[[7, 9]])
    assert worlds.step_counts.tolist() == [1, 0, 1, 0]
    masked = worlds.reset(np.array([True, False, False, False]))
    np.testing.assert_array_equal(masked.observation[1:], after.observation[1:])


def test_every_goal_is_produced_by_placing_blocks():
    """Blocks placed in each of the 35 configurations stay there, and the reward says so."""
    space = goal_space(3)
    worlds = BatchedStacking("stack3", len(space), seed=0)
    worlds.desired_goal[:] = space.goals
    worlds.place(np.arange(len(space)), _placements_of(space) + [1.22, 0.85, 0.425])
    for _ in range(10):
        _, reward = worlds.step(np.zeros((len(space), 4)))
        assert (reward == 1).all()


def _placements_of(space: GoalSpace) -> np.ndarray:
    """Positions `(n_goals, n, 3)` that produce each goal, table height 0."""
    found = {}
    for placement in _placements(space.n_blocks):
        cluster = np.rint(placement[:, :1])  # columns far apart stand a metre apart: too wide for the table
        placement = placement - cluster * [0.85, 0, 0]
        for order in itertools.permutations(range(space.n_blocks)):
            positions = placement[list(order)]
            found.setdefault(space.index(predicates(positions)), positions)
    return np.array([found[index] for index in range(len(space))])


def test_reward_is_compute_reward():
    worlds = BatchedStacking("stack3", 64, seed=0)
    worlds.reset(biased=True)
    seen, reward = worlds.step(np.zeros((64, 4)))
    np.testing.assert_array_equal(reward, worlds.compute_reward(seen.achieved_goal, seen.desired_goal, {}))


@pytest.mark.parametrize("damage", ["nan", "huge"])
def test_a_diverged_world_is_reported_and_reset_and_no_other(caplog, damage):
    worlds = BatchedStacking("stack2", 3, seed=0)
    twin = BatchedStacking("stack2", 3, seed=0)
    worlds._qvel[1, 0] = np.nan if damage == "nan" else 1e12
    with caplog.at_level(logging.WARNING):
        seen, _ = worlds.step(np.zeros((3, 4)))
    unharmed, _ = twin.step(np.zeros((3, 4)))
    assert worlds.diverged.tolist() == [False, True, False]
    assert worlds.divergences == 1
    assert "worlds [1]" in caplog.text
    assert np.isfinite(seen.observation).all()
    np.testing.assert_array_equal(seen.observation[[0, 2]], unharmed.observation[[0, 2]])
    seen, _ = worlds.step(np.zeros((3, 4)))
    assert not worlds.diverged.any()
    assert worlds.step_counts.tolist() == [2, 2, 2]


def test_long_random_play_never_diverges():
    worlds = BatchedStacking("stack3", 64, seed=0)
    rng = np.random.default_rng(0)
    for _ in range(4):
        worlds.reset(biased=True)
        for _ in range(50):
            worlds.step(rng.uniform(-1, 1, (64, 4)))
    assert worlds.divergences == 0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda w: w.step(np.full((2, 4), np.nan)), r"nan in entry 0 of world 0"),
        (lambda w: w.step(np.full((2, 4), 1.1)), r"1.1 in entry 0"),
        (lambda w: w.step(np.zeros((3, 4))), r"shape \(2, 4\)"),
        (lambda w: w.reset(goals=np.zeros(5)), "9 bits"),
        (lambda w: w.reset(goals=np.zeros((3, 9))), r"shape \(2, 9\)"),
        (lambda w: w.reset(goals=np.tile([0, 0, 0, 1, 0, 0, 0, 0, 0], (2, 1))), "no placement"),
        (lambda w: w.reset(np.array([2])), "2 worlds"),
        (lambda w: BatchedStacking("stack3", 0), "at least one world"),
        (lambda w: BatchedStacking("stack3", 1, n_threads=0), "at least one world and one thread"),
    ],
)
def test_bad_input_is_refused_and_nothing_moves(call, message):
    worlds = BatchedStacking("stack3", 2, seed=0)
    before = worlds.observe().observation
    with pytest.raises(ValueError, match=message):
        call(worlds)
    np.testing.assert_array_equal(worlds.observe().observation, before)
