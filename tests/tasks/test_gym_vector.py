"""The vector environment."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import DictInfoToList, FlattenObservation, RecordEpisodeStatistics

import curiobench  # noqa: F401  (registers the environments)

ONES = np.ones((3, 4), np.float32)


def make_vec(n: int = 3, **kwargs):
    return gym.make_vec("curiobench/SemanticStack2-v0", num_envs=n, vectorization_mode="vector_entry_point", **kwargs)


def assert_equal(ours, theirs):
    """Whether two observations or infos are the same, masks and missing entries included."""
    if isinstance(ours, tuple):
        ours, theirs = dict(enumerate(ours)), dict(enumerate(theirs))
    if isinstance(ours, dict):
        assert ours.keys() == theirs.keys()
        for name in ours:
            assert_equal(ours[name], theirs[name])
    elif isinstance(ours, np.ndarray) and ours.dtype.hasobject:
        for one, other in zip(ours, theirs, strict=True):
            assert_equal(one, other)
    else:
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_vector_gives_what_gymnasiums_own_vectors_do(mode):
    ours = make_vec(1, autoreset_mode=mode, max_episode_steps=4)
    theirs = gym.make_vec(
        "curiobench/SemanticStack2-v0",
        num_envs=1,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
        max_episode_steps=4,
    )
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"] == mode
    assert_equal(ours.reset(seed=2), theirs.reset(seed=2))
    for action in np.random.default_rng(0).uniform(-1, 1, (14, 1, 4)).astype(np.float32):
        answer = ours.step(action)
        assert_equal(answer, theirs.step(action))
        assert ours.observation_space.contains(answer[0])
        if mode == AutoresetMode.DISABLED and answer[3].any():
            again = [{"reset_mask": np.array([True])} for _ in range(2)]  # Gymnasium takes the mask out of its own
            assert_equal(ours.reset(options=again[0]), theirs.reset(options=again[1]))
            assert "reset_mask" in again[0]


def test_same_step_reset_gives_the_last_observation_and_the_next_first_one():
    vector = make_vec(autoreset_mode="SameStep", max_episode_steps=3)
    vector.reset(seed=0, options={"goal": ["all apart", "b on a", None]})
    vector.step(ONES)
    vector.reset(options={"goal": "all apart", "reset_mask": np.array([True, False, False])})
    for _ in range(2):
        seen, reward, _, truncated, info = vector.step(ONES * 0)
    assert truncated.tolist() == info["_final_obs"].tolist() == info["_final_info"].tolist() == [False, True, True]
    assert info["final_obs"][0] is None
    np.testing.assert_array_equal(info["final_obs"][1]["desired_goal"], [1, 0, 1])
    assert np.abs(info["final_obs"][1]["observation"][0] - 1.34) > 0.02
    np.testing.assert_allclose(seen["observation"][1:, 0], 1.3419, atol=1e-4)
    assert info["final_info"]["is_success"][1:].tolist() == (reward[1:] > 0).tolist()
    assert info["final_info"]["_is_success"].tolist() == [False, True, True]


def test_vector_without_autoreset_refuses_a_step_after_the_end():
    vector = make_vec(autoreset_mode=AutoresetMode.DISABLED, max_episode_steps=2)
    vector.reset(seed=0)
    vector.step(ONES)
    assert vector.step(ONES)[3].all()
    with pytest.raises(ResetNeeded, match=r"worlds \[0, 1, 2\]"):
        vector.step(ONES)
    vector.reset(options={"reset_mask": np.array([True, True, False])})
    with pytest.raises(ResetNeeded, match=r"worlds \[2\]"):
        vector.step(ONES)


def test_vector_episodes_take_50_steps_by_default():
    vector = make_vec()
    vector.reset(seed=0)
    assert [vector.step(ONES)[3].any() for _ in range(51)] == [False] * 49 + [True, False]
    endless = make_vec(max_episode_steps=-1)
    assert not any(endless.step(ONES)[3].any() for _ in range(60))


def test_vector_keeps_the_options_of_each_world():
    vector = make_vec(max_episode_steps=3)
    vector.reset(seed=0, options={"goal": ["all apart", "all close", None], "biased": [True, False, True]})
    goals = np.array([[0, 0, 0], [1, 0, 1], [0, 0, 0]], np.float32)
    seen, info = vector.reset(options={"goal": goals, "reset_mask": np.array([False, True, False])})
    assert info["_is_success"].tolist() == info["_diverged"].tolist() == [False, True, False]
    np.testing.assert_array_equal(seen["desired_goal"][:2], [[0, 0, 0], [1, 0, 1]])
    drawn, held = set(), np.zeros(3, bool)
    for _ in range(48):
        seen, *_ = vector.step(ONES * 0)
        np.testing.assert_array_equal(seen["desired_goal"][:2], [[0, 0, 0], [1, 0, 1]])
        drawn.add(tuple(seen["desired_goal"][2]))
        held |= seen["observation"][:, 12::15].max(axis=1) > 0.45
    assert len(drawn) > 1
    assert held.tolist() == [True, False, True]


def test_divergence_after_the_end_does_not_count_for_the_next_episode():
    vector = make_vec(max_episode_steps=1)
    vector.reset(seed=0, options={"goal": "all apart"})
    vector.step(ONES)
    vector.unwrapped._worlds._qvel[1] = 1e7
    *_, info = vector.step(ONES)
    assert not info["diverged"].any()
    assert info["is_success"].tolist() == [True] * 3  # blocks start apart


def test_vectors_generator_is_the_seeded_one():
    vector = make_vec()
    seen, _ = vector.reset(seed=7)
    assert vector.np_random_seed == 7
    vector.np_random = np.random.default_rng(7)
    np.testing.assert_array_equal(vector.reset()[0]["observation"], seen["observation"])


def test_gymnasiums_vector_wrappers_take_it():
    vector = DictInfoToList(RecordEpisodeStatistics(make_vec(autoreset_mode="SameStep", max_episode_steps=2)))
    vector.reset(seed=0)
    vector.step(ONES)
    *_, info = vector.step(ONES)
    assert info[1]["final_info"].keys() == {"is_success", "diverged"}
    assert info[1]["episode"]["l"] == 2
    flat = FlattenObservation(make_vec())
    assert flat.reset(seed=0)[0].shape == flat.observation_space.shape == (3, 46)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda v: make_vec(0), "at least one world"),
        (lambda v: make_vec(autoreset_mode="never"), "'never': the modes are NextStep, SameStep, Disabled"),
        (lambda v: make_vec(max_episode_steps=0), "max_episode_steps is at least 1, or -1 for no end, got 0"),
        (lambda v: v.reset(options={"goal": ["b on a", "all close"]}), "3 worlds need one goal or 3, got 2"),
        (lambda v: v.reset(options={"goal": np.zeros((2, 3))}), "3 worlds need one goal or 3, got 2"),
        (lambda v: v.reset(options={"biased": [True, False]}), "biased must be a bool or a list of 3 bools"),
        (lambda v: v.reset(options={"reset_mask": [1, 0, 0]}), r"reset_mask must be 3 bools.*\[1, 0, 0\]"),
        (lambda v: v.reset(options={"reset_mask": np.array([True, False])}), "reset_mask must be 3 bools"),
        (lambda v: v.reset(options={"reset_mask": np.zeros(3, bool)}), "at least one of them True"),
    ],
)
def test_bad_input(call, message):
    vector = make_vec()
    vector.reset(seed=0)
    before = vector.unwrapped.get_state()
    with pytest.raises(ValueError, match=message):
        call(vector)
    assert_equal(vector.unwrapped.get_state(), before)
