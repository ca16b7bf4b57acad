"""Replay: what a batch holds, episodes and particles drawn how often, the ring, and saves."""

import numpy as np
import pytest
from scipy.stats import chisquare
from small_replay import GOALS, STEPS, episodes_of, filled, replay_of

from curiobench.replay import ReplayConfig


def same(first: dict[str, np.ndarray], second: dict[str, np.ndarray]) -> bool:
    return all(np.array_equal(first[name], second[name]) for name in first)


def test_samples_are_contiguous_arrays_of_matching_transitions():
    batch = filled(11).sample(64, np.random.default_rng(0), 64, episodes=True)
    place = batch["observation"][:, 0]
    assert (place // 100 >= 3).all()  # episodes 0 to 2 were overwritten
    np.testing.assert_array_equal(batch["next_observation"], batch["observation"] + 1)
    np.testing.assert_allclose(batch["action"][:, 0], place / 1e4, rtol=1e-6)
    assert all(array.flags.c_contiguous and len(array) == 64 for array in batch.values())
    kinds = {name: "uint8" for name in batch if "goal" in name} | dict.fromkeys(("step", "episode"), "int64")
    assert {name: array.dtype.name for name, array in batch.items()} == dict.fromkeys(batch, "float32") | kinds
    np.testing.assert_array_equal(100 * batch["episode"] + batch["step"], place)
    rows = np.arange(64), batch["step"]
    np.testing.assert_array_equal(batch["episode_observation"][rows], batch["observation"])
    np.testing.assert_array_equal(batch["episode_achieved_goal"][rows], batch["achieved_goal"])


def test_goals_are_balanced_and_only_valid_ones_drawn():
    replay = replay_of(capacity=20)
    replay.add(episodes_of(list(range(10)), [(0, 0)] * 7 + [(1, 1)] + [(0, 1)] * 2))  # 01 is not a valid goal
    assert replay.valid_goals[replay.ends.counts > 0].tolist() == [[0, 0], [1, 1]]
    episode = replay.sample(4000, np.random.default_rng(0))["observation"][:, 0] // 100
    assert abs((episode == 7).mean() - 0.5) < 0.03
    assert (episode < 8).all()
    unbalanced = replay_of(capacity=20, balance_goals=False)
    unbalanced.add(episodes_of(list(range(10)), [(0, 0)] * 10))
    episode = unbalanced.sample(4000, np.random.default_rng(0))["observation"][:, 0] // 100
    assert np.allclose(np.bincount(episode.astype(int), minlength=10) / 4000, 0.1, atol=0.02)


@pytest.mark.parametrize("save_every", [1, 3, 5])
@pytest.mark.parametrize("relabelling", ["future", "arrivals"])
def test_saved_replay_continues_to_the_bit(tmp_path, save_every, relabelling):
    """From the last save, and from the one before it: a kill may come before the agent is saved."""
    original, saves = replay_of(relabelling=relabelling, folder=tmp_path / "arrays"), []
    for k in range(23):
        original.add(episodes_of([k, k + 100], [tuple(GOALS[k % 3]), tuple(GOALS[k % 2])]))
        if k % save_every == 0:
            saves.append((original.save(tmp_path), original.sample(30, np.random.default_rng(0))))
            for name, expected in saves[-2:]:
                restored = replay_of(relabelling=relabelling)
                restored.load(tmp_path, name)
                assert same(restored.sample(30, np.random.default_rng(0)), expected)
            assert restored.added == original.added
            if k == 12:  # go on with the restored one
                original = restored
    held = sum(path.stat().st_size for path in tmp_path.glob("episodes-*"))
    assert held < 40 * sum(array[0].nbytes for array in original.arrays.values()) + 20_000


def test_a_save_writes_only_what_is_new(tmp_path):
    replay = filled(5)
    replay.save(tmp_path)
    replay.add(episodes_of([5], [(1, 1)]))
    (tmp_path / "episodes-5-9.npz.partial").touch()  # of a killed save
    replay.save(tmp_path)
    assert replay.save(tmp_path) == "replay-6.json"
    assert sorted(path.name for path in tmp_path.glob("episodes-*")) == ["episodes-0-5.npz", "episodes-5-6.npz"]


def test_bad_input_is_named(tmp_path):
    replay = replay_of()
    with pytest.raises(ValueError, match="empty"):
        replay.sample(4, np.random.default_rng(0))
    name = filled(3).save(tmp_path)
    with pytest.raises(ValueError, match="holds shapes"):
        replay_of(capacity=9).load(tmp_path, name)
    for wrong_config in ({"capacity": 0}, {"relabel_share": 1.5}, {"satisfied_cap": -0.1}, {"relabelling": "past"}):
        with pytest.raises(ValueError, match=next(iter(wrong_config))):
            ReplayConfig(**wrong_config)


def test_particles_are_uniform_over_all_that_steps_led_to():
    """Whatever the episodes ended in; and they are drawn after the batch, which stays what it was."""
    replay = replay_of(capacity=8)
    replay.add(episodes_of(list(range(8)), [(0, 0)] + 7 * [(1, 1)]))
    drawn = replay.sample(16, np.random.default_rng(0), 4_000)
    places, counts = np.unique(drawn["particles"][:, 0], return_counts=True)
    assert places.tolist() == [100 * episode + step for episode in range(8) for step in range(1, STEPS + 1)]
    assert chisquare(counts).pvalue > 1e-3
    without = replay.sample(16, np.random.default_rng(0))
    assert without["particles"] is None
    assert same({name: array for name, array in without.items() if array is not None}, drawn)


def test_a_weighted_goal_that_no_episode_ended_in_gives_any_episode():
    replay = replay_of()
    replay.add(episodes_of([0, 1], [(0, 0), (1, 0)]))
    replay.goal_weights = np.array([0.0, 0.0, 1.0])
    slots = replay.draw_episodes(np.random.default_rng(0).random((2, 4_000)))
    assert np.bincount(slots) / 4_000 == pytest.approx([0.5, 0.5], abs=0.03)
