"""The Gymnasium environments."""

import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import curiobench  # noqa: F401  (registers the environments)
from curiobench.tasks.gym_env import SemanticStackEnv


@pytest.fixture
def env():
    environment = gym.make("curiobench/SemanticStack3-v0", robot="gripper")
    yield environment
    environment.close()


def make_vec(n: int = 3, **kwargs):
    return gym.make_vec("curiobench/SemanticStack2-v0", num_envs=n, vectorization_mode="vector_entry_point", **kwargs)


@pytest.mark.parametrize("n_blocks", [2, 3, 4, 5])
def test_gymnasiums_checker_passes(n_blocks):
    environment = gym.make(f"curiobench/SemanticStack{n_blocks}-v0", render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*infinity.*")  # positions have no bounds
        warnings.filterwarnings("ignore", message=".*DISPLAY.*")
        check_env(environment.unwrapped)
    environment.close()


def test_gymnasiums_checker_passes_for_the_arm():
    environment = gym.make("curiobench/SemanticStack2-v0", robot="fetch")
    check_env(environment.unwrapped)
    environment.close()


def test_stable_baselines3s_checker_passes(env):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(env.unwrapped)


def test_stable_baselines3_trains_with_its_hindsight_replay(env):
    sb3 = pytest.importorskip("stable_baselines3")
    model = sb3.SAC(
        "MultiInputPolicy",
        env,
        replay_buffer_class=sb3.HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
        learning_starts=200,
        batch_size=64,
        policy_kwargs={"net_arch": [64, 64]},
        seed=0,
    )
    model.learn(2_000)
    assert model.num_timesteps == 2_000
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


def test_reward_follows_compute_reward_and_episodes_are_truncated(env):
    seen, info = env.reset(seed=3, options={"goal": "all apart"})
    for step in range(50):
        seen, reward, terminated, truncated, info = env.step(env.action_space.sample() * 0)
        assert reward == env.unwrapped.compute_reward(seen["achieved_goal"], seen["desired_goal"], info)
        assert info["is_success"] == bool(reward)
        assert not terminated
        assert truncated == (step == 49)
    assert reward == 1


def test_vector_worlds_equal_single_ones():
    vector = make_vec(1)
    single = gym.make("curiobench/SemanticStack2-v0")
    a, _ = vector.reset(seed=4)
    b, _ = single.reset(seed=4)
    np.testing.assert_array_equal(a["observation"][0], b["observation"])
    for action in np.random.default_rng(0).uniform(-1, 1, (10, 4)).astype(np.float32):
        a, reward, *_ = vector.step(action[None])
        b, single_reward, *_ = single.step(action)
        np.testing.assert_array_equal(a["observation"][0], b["observation"])
        assert reward[0] == single_reward


def test_vector_starts_over_in_the_step_after_the_end():
    vector = make_vec()
    vector.reset(seed=0, options={"goal": "b on a"})
    for _ in range(50):
        seen, _, _, truncated, _ = vector.step(np.ones((3, 4), np.float32))
    assert truncated.all()
    assert (np.abs(seen["observation"][:, 0] - 1.34) > 0.1).all()
    seen, reward, _, truncated, _ = vector.step(np.ones((3, 4), np.float32))
    assert not truncated.any()
    assert not reward.any()
    np.testing.assert_allclose(seen["observation"][:, 0], 1.3419, atol=1e-4)
    np.testing.assert_array_equal(seen["desired_goal"], [[1, 0, 1]] * 3)


def test_vector_can_start_over_in_the_same_step():
    vector = make_vec(autoreset_mode=AutoresetMode.SAME_STEP)
    vector.reset(seed=0)
    for _ in range(50):
        seen, _, _, truncated, info = vector.step(np.ones((3, 4), np.float32))
    assert truncated.all()
    assert (np.abs(info["final_obs"]["observation"][:, 0] - 1.34) > 0.1).all()
    np.testing.assert_allclose(seen["observation"][:, 0], 1.3419, atol=1e-4)


def test_vector_resets_masked_worlds_with_goals_of_their_own():
    vector = make_vec()
    vector.reset(seed=0)
    vector.step(np.ones((3, 4), np.float32))
    goals = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 1]], np.float32)
    seen, _ = vector.reset(options={"goal": goals})
    np.testing.assert_array_equal(seen["desired_goal"], goals)
    vector.step(np.ones((3, 4), np.float32))
    seen, _ = vector.reset(options={"goal": "all close", "reset_mask": np.array([True, False, False])})
    np.testing.assert_array_equal(seen["desired_goal"], [[1, 0, 0], [1, 1, 0], [1, 0, 1]])
    assert seen["observation"][1, 0] > 1.36


@pytest.mark.parametrize("robot", ["gripper", "fetch"])
def test_pictures_show_the_scene(robot):
    environment = gym.make("curiobench/SemanticStack3-v0", robot=robot, render_mode="rgb_array")
    environment.reset(seed=0)
    picture = environment.render()
    environment.close()
    assert picture.shape == (480, 640, 3)
    red, green, blue = (picture.astype(int)[..., k] for k in range(3))
    for channel, others in ((red, (green, blue)), (green, (red, blue)), (blue, (red, green))):
        assert (channel - np.maximum(*others) > 40).sum() > 100  # a block of this colour is in sight


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda e: gym.make("curiobench/SemanticStack3-v0", robot="claw"), "unknown robot 'claw'"),
        (lambda e: SemanticStackEnv(render_mode="ascii"), "render mode 'ascii'"),
        (lambda e: e.reset(options={"gaol": "a on b"}), "unknown reset option 'gaol'"),
        (lambda e: e.reset(options={"goal": "a on z"}), "no block 'z'"),
        (lambda e: make_vec(0), "at least one world"),
        (lambda e: (e.reset(), e.unwrapped.step(np.array([0, 0, 0, 7.0]))), "7.0 in entry 3"),
    ],
)
def test_bad_input(env, call, message):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(ValueError, match=message):
            call(env)


def test_importing_curiobench_loads_neither_mujoco_nor_torch():
    code = (
        "import sys, curiobench, curiobench.tasks; sys.exit(bool({'mujoco', 'torch', 'dm_control'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
