"""The Gymnasium environments."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from curiobench.tasks import TASKS, task_spec


@pytest.fixture
def env():
    environment = gym.make("curiobench/SemanticStack3-v0", robot="gripper")
    yield environment
    environment.close()


@pytest.mark.parametrize(("task", "robot"), [("stack3", "gripper"), ("stack2", "fetch")])
def test_gymnasiums_checker_passes(task, robot):
    environment = gym.make(task_spec(task).gym_id, robot=robot, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*infinity.*")  # positions have no bounds
        warnings.filterwarnings("ignore", message=".*DISPLAY.*")
        check_env(environment.unwrapped)
    environment.close()


def test_stable_baselines3s_checker_passes(env):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(env.unwrapped)


def test_stable_baselines3_trains_with_its_hindsight_replay(env, tmp_path, monkeypatch):
    sb3 = pytest.importorskip("stable_baselines3")
    monkeypatch.setenv("SB3_LOGDIR", str(tmp_path))  # by itself it makes folders in /tmp
    model = sb3.SAC(
        "MultiInputPolicy",
        env,
        replay_buffer_class=sb3.HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
        learning_starts=100,
        batch_size=64,
        policy_kwargs={"net_arch": [64, 64]},
        seed=0,
    )
    model.learn(200)
    action, _ = model.predict(env.reset(seed=0)[0], deterministic=True)
    assert env.action_space.contains(action)


def test_options_fix_goal_and_start(env):
    for goal in ("a on b", "100100000", [1, 0, 0, 1, 0, 0, 0, 0, 0]):
        seen, _ = env.reset(seed=0, options={"goal": goal})
        assert "".join(str(int(bit)) for bit in seen["desired_goal"]) == "100100000"
    heights = [env.reset(options={"biased": True})[0]["observation"][12::15].max() for _ in range(40)]
    assert max(heights) > 0.43
    heights = [env.reset(options={})[0]["observation"][12::15].max() for _ in range(40)]
    assert max(heights) < 0.43


def test_goal_functions_give_what_steps_do_and_episodes_are_truncated(env):
    env.reset(seed=3, options={"goal": "all apart"})
    for step in range(50):
        seen, reward, terminated, truncated, info = env.step(env.action_space.sample() * 0)
        goals = seen["achieved_goal"], seen["desired_goal"], info
        assert reward == env.unwrapped.compute_reward(*goals)
        assert info["is_success"] == bool(reward)
        assert not terminated
        assert not env.unwrapped.compute_terminated(*goals)
        assert truncated == (step == 49)
        assert not env.unwrapped.compute_truncated(*goals)
    assert reward == 1
    many = np.zeros((4, 7, 9)), np.zeros(9), {}
    for name in ("reward", "terminated", "truncated"):
        assert getattr(env.unwrapped, f"compute_{name}")(*many).shape == (4, 7)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda e: gym.make("curiobench/SemanticStack3-v0", robot="claw"), "unknown robot 'claw'"),
        (lambda e: e.reset(options={"gaol": "a on b"}), "unknown reset option 'gaol'"),
        (lambda e: e.reset(options={"goal": "a on z"}), "no block 'z'"),
        (lambda e: e.reset(options={"goal": ["a on b", "b on a"]}), "1 worlds need one goal or 1, got 2"),
        (lambda e: e.reset(options={"biased": "yes"}), "biased must be a bool, got 'yes'"),
        (lambda e: e.reset(options={"reset_mask": np.array([True])}), "unknown reset option 'reset_mask'"),
        (lambda e: (e.reset(), e.unwrapped.step(np.array([0, 0, 0, 7.0]))), "7.0 in entry 3"),
    ],
)
def test_bad_input(env, call, message):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(ValueError, match=message):
            call(env)


def test_the_time_limit_is_that_of_gymnasium():
    for task in TASKS:
        assert gym.spec(task_spec(task).gym_id).max_episode_steps == task_spec(task).horizon
    env = gym.make("curiobench/SemanticStack2-v0", max_episode_steps=-1)
    env.reset(seed=0)
    assert not any(env.step(np.zeros(4, np.float32))[3] for _ in range(60))


def test_data_is_that_of_mujoco_and_follows_the_world(env):
    env.reset(seed=0)
    data, model = env.unwrapped.data, env.unwrapped.model
    for k in range(1, 4):
        seen, *_ = env.step(np.ones(4, np.float32))
        assert env.unwrapped.data is data
        assert data.time == pytest.approx(0.04 * k)
        np.testing.assert_allclose(data.body("block_a/").xpos, seen["observation"][10:13], atol=1e-6)
    assert data.qpos.shape == (model.nq,)
    twin = gym.make("curiobench/SemanticStack3-v0")
    twin.reset(seed=0)
    for _ in range(3):
        unwatched, *_ = twin.step(np.ones(4, np.float32))
    np.testing.assert_array_equal(seen["observation"], unwatched["observation"])
    seen, _ = env.reset()
    assert data.time == 0
    np.testing.assert_allclose(data.body("block_a/").xpos, seen["observation"][10:13], atol=1e-6)
