"""Copies of environments, in this process and in others, and their saved states."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest

import curiobench  # noqa: F401  (registers the environments)
from curiobench.tasks.gym_env import SemanticStackEnv

ID = "curiobench:curiobench/SemanticStack2-v0"
ACTIONS = np.random.default_rng(0).uniform(-1, 1, (12, 4)).astype(np.float32)


def play(env, actions, options=None):
    """All numbers of a few steps, of an episode after them, and of its first steps."""
    n = getattr(env, "num_envs", None)
    numbers = []
    for action in actions if n is None else np.repeat(actions[:, None], n, axis=1):
        seen, reward, _, truncated, info = env.step(action)
        numbers += [seen["observation"], seen["desired_goal"], reward, truncated, info["is_success"]]
        if n is None and truncated:
            numbers.append(env.reset(options=options)[0]["observation"])
    return np.concatenate([np.ravel(number) for number in numbers])


@pytest.mark.parametrize(
    ("robot", "duplicate"), [("gripper", copy.deepcopy), ("fetch", lambda env: pickle.loads(pickle.dumps(env)))]
)
def test_a_copy_continues_with_the_same_numbers(robot, duplicate):
    env = gym.make(ID, robot=robot, max_episode_steps=8)
    env.reset(seed=1, options={"biased": True})
    play(env, ACTIONS[:5])
    twin = duplicate(env)
    assert twin.unwrapped.np_random is twin.unwrapped._worlds.rng
    expected = play(env, ACTIONS)
    np.testing.assert_array_equal(play(twin, ACTIONS), expected)  # and the first left no trace in it


def test_a_copy_of_an_environment_that_renders_gives_the_same_picture():
    env = gym.make(ID, render_mode="rgb_array", width=64, height=48)
    env.reset(seed=0)
    picture = env.render().copy()
    assert env.unwrapped.data is not None
    twin = copy.deepcopy(env)
    np.testing.assert_array_equal(twin.render(), picture)
    np.testing.assert_array_equal(twin.unwrapped.data.qpos, env.unwrapped.data.qpos)
    env.close()
    twin.close()


def test_a_saved_state_continues_with_the_same_numbers(tmp_path):
    env = SemanticStackEnv("stack2")
    env.reset(seed=1, options={"goal": "b on a"})
    play(env, ACTIONS[:5])
    np.savez(tmp_path / "state.npz", **env.get_state())
    seen = env.step(ACTIONS[0])[0]
    expected = env.reset()[0]["observation"], play(env, ACTIONS)
    with np.load(tmp_path / "state.npz", allow_pickle=False) as file:
        state = dict(file)
    for other in (env, SemanticStackEnv("stack2")):
        other.set_state(state)
        np.testing.assert_array_equal(other.step(ACTIONS[0])[0]["observation"], seen["observation"])
        np.testing.assert_array_equal(other.reset()[0]["observation"], expected[0])
        np.testing.assert_array_equal(play(other, ACTIONS), expected[1])
    assert all(isinstance(array, np.ndarray) and array.dtype != object for array in state.values())


def test_a_state_keeps_any_generator():
    env = SemanticStackEnv("stack2")
    env.np_random = np.random.Generator(np.random.MT19937(3))
    env.reset()
    state = env.get_state()
    expected = env.reset()[0]["observation"]
    env.set_state(state)
    np.testing.assert_array_equal(env.reset()[0]["observation"], expected)


def test_copies_and_states_of_a_vector_keep_its_ends_and_its_options():
    vector = gym.make_vec(ID, num_envs=3, n_threads=2, max_episode_steps=4)
    vector.reset(seed=1, options={"goal": [None, "b on a", None], "biased": [True, False, True]})
    play(vector, ACTIONS[:2])
    state, twin = vector.unwrapped.get_state(), pickle.loads(pickle.dumps(vector))
    expected = play(vector, ACTIONS)
    np.testing.assert_array_equal(play(twin, ACTIONS), expected)
    vector.reset(seed=5)
    seen = vector.unwrapped.set_state(state)
    np.testing.assert_array_equal(seen["desired_goal"][1], [1, 0, 1])
    np.testing.assert_array_equal(play(vector, ACTIONS), expected)


def test_states_that_do_not_fit_are_refused_and_nothing_moves():
    env = SemanticStackEnv("stack2")
    seen, _ = env.reset(seed=0)
    good = env.get_state()
    bad = [
        ({**good, "state": good["state"][:, 1:]}, "has the shapes"),
        ({name: good[name] for name in good if name != "rng"}, "has the shapes"),
        (SemanticStackEnv("stack3").get_state(), "has the shapes"),
        ({**good, "state": good["state"] * np.nan}, "not finite"),
        ({**good, "desired_goal": np.ones((1, 3))}, "no placement"),
        ({**good, "divergences": np.array(np.nan)}, "not a state"),
        ({**good, "rng": np.array('{"bit_generator": "MT19937"}')}, "PCG64"),
    ]
    for state, message in bad:
        with pytest.raises(ValueError, match=message):
            env.set_state(state)
        assert all(np.array_equal(value, good[name]) for name, value in env.get_state().items())
    np.testing.assert_array_equal(env.set_state(env.get_state())["observation"], seen["observation"])


def test_spawned_processes_make_it_from_its_id():
    vector = gym.vector.AsyncVectorEnv([lambda: gym.make(ID)], context="spawn")
    seen, _ = vector.reset(seed=3)
    vector.close()
    np.testing.assert_array_equal(seen["observation"][0], gym.make(ID).reset(seed=3)[0]["observation"])
    plain = ID.removeprefix("curiobench:")
    vector = gym.make_vec(plain, vectorization_mode="async", vector_kwargs={"context": "spawn"})
    np.testing.assert_array_equal(vector.reset(seed=3)[0]["observation"], seen["observation"])
    vector.close()
