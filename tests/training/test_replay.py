"""Replay: relabelled rewards by hand, what is drawn how often, the ring, and saves that survive a kill."""

from collections import Counter

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chisquare

from curiobench import files
from curiobench.methods.mi import MI
from curiobench.methods.re3 import RE3
from curiobench.methods.reward import Batch, Transitions
from curiobench.queues import Queues
from curiobench.relabelling import N_ARRIVAL_KINDS, draw_arrivals
from curiobench.replay import EpisodeReplay, Episodes, ReplayConfig

STEPS, SIZE, ACTIONS = 4, 3, 2
GOALS = np.array([[0, 0], [1, 0], [1, 1]], np.uint8)
ON_BITS = np.array([False, True])


def compute_reward(achieved: np.ndarray, desired: np.ndarray, info: object) -> np.ndarray:
    return (achieved == desired).all(-1).astype(np.float32)


def replay_of(capacity: int = 8, folder=None, **config) -> EpisodeReplay:
    config = ReplayConfig(**{"capacity": capacity, **config})
    return EpisodeReplay(config, GOALS, compute_reward, STEPS, SIZE, ACTIONS, ON_BITS, folder)


def episodes_of(numbers: list[int], finals: list[tuple[int, int]]) -> Episodes:
    """Episodes whose observations are 100 · episode + step, so that each is known. Goal 00 until the end."""
    n, steps = len(numbers), np.arange(STEPS + 1)
    achieved = np.zeros((n, STEPS + 1, 2), np.uint8)
    achieved[:, -1] = finals
    place = 100 * np.array(numbers)[:, None] + steps
    observation = np.repeat(place[:, :, None], SIZE, axis=2)
    return Episodes(observation, achieved, np.repeat(place[:, :-1, None] / 1e4, ACTIONS, axis=2), achieved[:, 0])


def filled(episodes: int, capacity: int = 8, **config) -> EpisodeReplay:
    replay = replay_of(capacity, **config)
    for k in range(episodes):
        replay.add(episodes_of([k], [tuple(GOALS[k % 3])]))
    return replay


def same(first: dict[str, np.ndarray], second: dict[str, np.ndarray]) -> bool:
    return all(np.array_equal(first[name], second[name]) for name in first)


def test_relabelled_rewards_of_a_hand_made_episode():
    """Bits 00, 10, 10, 11, 00 at steps 0 … 4, pursuing 11; every goal must be one achieved at a later step."""
    achieved = np.array([[[0, 0], [1, 0], [1, 0], [1, 1], [0, 0]]], np.uint8)
    base = episodes_of([0], [(0, 0)])
    replay = replay_of(relabel_share=1.0)
    replay.add(Episodes(base.observation, achieved, base.action, np.array([[1, 1]])))
    batch = replay.sample(4000, np.random.default_rng(0))
    step = batch["observation"][:, 0].astype(int)
    future = {0: {"10": 2, "11": 1, "00": 1}, 1: {"10": 1, "11": 1, "00": 1}, 2: {"11": 1, "00": 1}, 3: {"00": 1}}
    for t, expected in future.items():
        goals, counts = np.unique(
            [f"{first}{second}" for first, second in batch["desired_goal"][step == t]], return_counts=True
        )
        share = dict(zip(goals, counts / counts.sum(), strict=True))
        assert share.keys() == expected.keys()
        assert all(abs(share[g] - expected[g] / sum(expected.values())) < 0.06 for g in share)
    np.testing.assert_array_equal(batch["next_achieved_goal"], achieved[0, step + 1])
    by_hand = (achieved[0, step + 1] == batch["desired_goal"]).all(1)
    np.testing.assert_array_equal(batch["reward"], by_hand.astype(np.float32))
    assert 0.3 < batch["reward"].mean() < 0.9


@pytest.mark.parametrize("share", [0.0, 0.8])
def test_relabelled_share(share):
    base = episodes_of([0], [(1, 1)])
    replay = replay_of(relabel_share=share)
    replay.add(Episodes(base.observation, base.achieved_goal, base.action, np.array([[0, 1]])))  # never achieved
    batch = replay.sample(5000, np.random.default_rng(0))
    assert abs((batch["desired_goal"] != [0, 1]).any(1).mean() - share) < 0.02
    assert batch["reward"].any() == (share > 0)


def test_samples_are_contiguous_arrays_of_matching_transitions():
    batch = filled(11).sample(64, np.random.default_rng(0), 64, episodes=True)
    place = batch["observation"][:, 0]
    assert (place // 100 >= 3).all()  # episodes 0 to 2 were overwritten
    np.testing.assert_array_equal(batch["next_observation"], batch["observation"] + 1)
    np.testing.assert_allclose(batch["action"][:, 0], place / 1e4, rtol=1e-6)
    assert all(array.flags.c_contiguous and len(array) == 64 for array in batch.values())
    assert {name: array.dtype.name for name, array in batch.items()} == {
        "observation": "float32",
        "action": "float32",
        "next_observation": "float32",
        "achieved_goal": "uint8",
        "next_achieved_goal": "uint8",
        "desired_goal": "uint8",
        "reward": "float32",
        "particles": "float32",
        "step": "int64",
        "episode": "int64",
        "episode_observation": "float32",
        "episode_achieved_goal": "uint8",
    }
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


@pytest.mark.parametrize("cap", [0.0, 0.3, 1.0])
def test_cap_on_transitions_whose_goal_already_holds(cap):
    def share(config: dict) -> float:
        batch = filled(8, **config).sample(500, np.random.default_rng(1))
        return compute_reward(batch["achieved_goal"], batch["desired_goal"], None).mean()

    free, capped = share({}), share({"satisfied_cap": cap})
    assert capped <= cap + 1e-9
    assert abs(capped - min(free, cap)) < 0.07


def test_cap_gives_way_when_every_goal_already_holds():
    replay = replay_of(satisfied_cap=0.1)
    replay.add(episodes_of([0, 1], [(0, 0), (0, 0)]))
    batch = replay.sample(30, np.random.default_rng(0))
    assert len(batch["reward"]) == 30
    assert batch["reward"].all()


@settings(max_examples=60)
@given(st.lists(st.tuples(st.lists(st.integers(0, 3), max_size=9), st.integers(0, 9)), max_size=12))
def test_queues_equal_lists(rounds):
    """Each round appends numbers to groups, then removes the oldest ones of some group."""
    queues, lists, number = Queues(4), [[] for _ in range(4)], 0
    for groups, gone in rounds:
        queues.push(np.array(groups, int), number + np.arange(len(groups)))
        for group in groups:
            lists[group].append(number)
            number += 1
        dropped = [group for group in range(4) for _ in range(min(gone, len(lists[group])))]
        queues.drop(np.array(dropped, int))
        for group in dropped:
            lists[group].pop(0)
        assert queues.counts.tolist() == [len(held) for held in lists]
        for group, held in enumerate(lists):
            places = (np.arange(len(held)) + 0.5) / max(1, len(held))
            assert queues.draw(np.full(len(held), group), places).tolist() == held


def random_episodes(rng: np.random.Generator, n: int) -> Episodes:
    """Episodes whose bits flip at random; [0, 1] among them, which is no valid goal."""
    base = episodes_of(list(range(n)), [(0, 0)] * n)
    achieved = rng.integers(0, 2, (n, STEPS + 1, 2)).astype(np.uint8)
    return Episodes(base.observation, achieved, base.action, GOALS[rng.integers(0, 3, n)])


def arrivals_by_hand(replay: EpisodeReplay) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """(slot, step) of every arrival, by goal and kind, read off the definition."""
    found: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for slot in range(len(replay)):
        achieved = replay.arrays["achieved_goal"][slot].tolist()
        for step in range(1, STEPS + 1):
            before, after = achieved[step - 1], achieved[step]
            if after == before or after not in GOALS.tolist():
                continue
            kind = 0 if after[1] > before[1] else 1 if after[0] > before[0] else 2
            found.setdefault((GOALS.tolist().index(after), kind), []).append((slot, step))
    return found


@pytest.mark.parametrize("episodes", [5, 8, 23])
def test_arrivals_are_drawn_as_defined(episodes):
    """A goal and kind, an arrival of it, an earlier step without that goal: each uniformly, by a chi-square."""
    replay = replay_of(capacity=8, relabelling="arrivals", arrival_share=1.0)
    rng = np.random.default_rng(episodes)
    for _ in range(episodes):
        replay.add(random_episodes(rng, 1))
    by_hand = arrivals_by_hand(replay)
    counts = {divmod(group, N_ARRIVAL_KINDS): count for group, count in enumerate(replay.arrivals.counts) if count}
    assert counts == {pair: len(places) for pair, places in by_hand.items()}
    expected: dict[tuple[int, int, int], float] = {}
    for (goal, _), places in by_hand.items():
        for slot, arrival in places:
            achieved = replay.arrays["achieved_goal"][slot]
            steps = [t for t in range(arrival) if (achieved[t] != GOALS[goal]).any()]
            for t in steps:
                key = slot, t, goal
                expected[key] = expected.get(key, 0.0) + 1 / (len(by_hand) * len(places) * len(steps))
    n = 20_000
    slot, step, desired = draw_arrivals(replay, n, np.random.default_rng(1))
    goal = (desired[:, None] == GOALS).all(-1).argmax(1)
    drawn = Counter(zip(slot.tolist(), step.tolist(), goal.tolist(), strict=True))
    assert drawn.keys() <= expected.keys()
    observed = [drawn[key] for key in expected]
    assert chisquare(observed, [n * share for share in expected.values()]).pvalue > 1e-3


def test_pursued_goals_are_drawn_with_any_step_of_any_episode():
    replay = replay_of(capacity=8, relabelling="arrivals", arrival_share=0.0, pursued_share=1.0)
    replay.add(random_episodes(np.random.default_rng(0), 8))
    slot, step, desired = draw_arrivals(replay, 20_000, np.random.default_rng(1))
    assert (desired == replay.arrays["desired_goal"][slot]).all()
    counts = np.zeros((8, STEPS), int)
    np.add.at(counts, (slot, step), 1)
    assert chisquare(counts.ravel()).pvalue > 1e-3


def test_half_a_batch_comes_from_arrivals_and_the_cap_is_the_batch_s():
    config = {"relabelling": "arrivals", "satisfied_cap": 0.2, "relabel_share": 0.0}
    replay = replay_of(**config)
    base = episodes_of([0], [(1, 1)])
    replay.add(Episodes(base.observation, base.achieved_goal, base.action, np.array([[1, 0]])))
    desired = replay.sample(1000, np.random.default_rng(0))["desired_goal"]
    assert (desired == [1, 1]).all(1).sum() == 500  # the only arrival; the rest keep the goal that was pursued
    still = replay_of(**config)
    still.add(episodes_of([0, 1], [(0, 0)] * 2))  # without any arrival, and every goal holds already
    assert len(still.sample(100, np.random.default_rng(0))["reward"]) == 100
    mixed = replay_of(**config | {"relabel_share": 1.0})
    mixed.add(random_episodes(np.random.default_rng(0), 8))
    batch = mixed.sample(1000, np.random.default_rng(0))
    assert 0.1 < (batch["achieved_goal"] == batch["desired_goal"]).all(1).mean() <= 0.2
    pursued = replay_of(**config | {"pursued_share": 0.4})
    pursued.add(random_episodes(np.random.default_rng(0), 8))
    batch = pursued.sample(1000, np.random.default_rng(0))
    assert 0.05 < (batch["achieved_goal"] == batch["desired_goal"]).all(1).mean() <= 0.2


def test_memory_mapped_replay_is_the_same(tmp_path):
    mapped, plain = replay_of(folder=tmp_path / "arrays"), replay_of()
    for replay in (mapped, plain):
        for k in range(11):
            replay.add(episodes_of([k], [(1, 1)]))
    assert isinstance(mapped.arrays["observation"], np.memmap)
    assert same(mapped.sample(40, np.random.default_rng(3)), plain.sample(40, np.random.default_rng(3)))


@pytest.mark.parametrize("save_every", [1, 3, 5])
@pytest.mark.parametrize("relabelling", ["future", "arrivals"])
def test_saved_replay_continues_to_the_bit(tmp_path, save_every, relabelling):
    original = replay_of(relabelling=relabelling)
    for k in range(23):
        original.add(episodes_of([k, k + 100], [tuple(GOALS[k % 3]), tuple(GOALS[k % 2])]))
        if k % save_every == 0:
            name = original.save(tmp_path)
            restored = replay_of(relabelling=relabelling)
            restored.load(tmp_path, name)
            assert restored.added == original.added
            if k == 12:  # go on with the restored one
                original = restored
            samples = [r.sample(30, np.random.default_rng(k)) for r in (original, restored)]
            assert same(*samples)
    held = sum(path.stat().st_size for path in tmp_path.glob("episodes-*"))
    assert held < 40 * sum(array[0].nbytes for array in original.arrays.values()) + 20_000


def test_a_save_writes_only_what_is_new(tmp_path):
    replay = filled(5)
    replay.save(tmp_path)
    replay.add(episodes_of([5], [(1, 1)]))
    replay.save(tmp_path)
    assert replay.save(tmp_path) == "replay-6.json"
    assert sorted(path.name for path in tmp_path.glob("episodes-*")) == ["episodes-0-5.npz", "episodes-5-6.npz"]


def test_a_kill_at_any_moment_of_a_save_leaves_the_previous_one(tmp_path, monkeypatch):
    """Every rename is a moment; the kill is an exception that the save cannot expect."""
    replace = files.os.replace
    for moment in range(3):
        folder = tmp_path / str(moment)
        replay, calls = filled(7), []
        name = replay.save(folder)
        expected = replay.sample(20, np.random.default_rng(0))
        replay.add(episodes_of([7, 8, 9], [(1, 1)] * 3))

        def dies(path, target, calls=calls, moment=moment):
            calls.append(path)
            if len(calls) > moment:
                raise KeyboardInterrupt
            return replace(path, target)

        with monkeypatch.context() as patch:
            patch.setattr(files.os, "replace", dies)
            if moment < 2:
                with pytest.raises(KeyboardInterrupt):
                    replay.save(folder)
            else:
                replay.save(folder)  # two renames: episodes, manifest
        restored = replay_of()
        restored.load(folder, name)
        assert same(restored.sample(20, np.random.default_rng(0)), expected)
        restored.add(episodes_of([7, 8], [(1, 1)] * 2))  # and it can be saved over what the kill left
        again = replay_of()
        again.load(folder, restored.save(folder))
        assert again.added == 9
        assert not list(folder.glob("*.partial"))


def test_bad_input_is_named(tmp_path):
    replay = replay_of()
    with pytest.raises(ValueError, match="empty"):
        replay.sample(4, np.random.default_rng(0))
    with pytest.raises(ValueError, match="9 episodes do not fit"):
        replay.add(episodes_of(list(range(9)), [(0, 0)] * 9))
    broken = episodes_of([0, 1], [(0, 0)] * 2)
    wrong = Episodes(broken.observation[:, :-1], broken.achieved_goal, broken.action, broken.desired_goal)
    with pytest.raises(ValueError, match=r"observation has shape \(2, 4, 3\); expected \(2, 5, 3\)"):
        replay.add(wrong)
    action = broken.action.copy()
    action[1, 2, 0] = np.nan
    with pytest.raises(ValueError, match="action of episode 1 is not finite"):
        replay.add(Episodes(broken.observation, broken.achieved_goal, action, broken.desired_goal))
    assert len(replay) == 0
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


@pytest.mark.parametrize("method", [MI, RE3])
def test_a_state_of_a_rare_goal_is_more_novel_than_one_of_a_common_goal(method):
    """Batches hold as many of both; among the batch itself the rare one would be the less novel."""
    rng, numbers = np.random.default_rng(0), list(range(200))
    replay = replay_of(capacity=200)
    base = episodes_of(numbers, [tuple(GOALS[2 if k % 40 else 1]) for k in numbers])
    rare = np.arange(200) % 40 == 0
    observation = rng.normal(size=base.observation.shape) + np.where(rare, 3.0, -3.0)[:, None, None]
    replay.add(Episodes(observation.astype(np.float32), base.achieved_goal, base.action, base.desired_goal))
    batch = Batch.from_numpy(replay.sample(400, rng, 512))
    found = method(SIZE, ACTIONS, method.Config(), torch.Generator().manual_seed(0))
    states = batch.observation, batch.action, batch.next_observation
    of_rare = batch.next_observation.mean(1) > 0
    assert 0.4 < of_rare.float().mean() < 0.6
    gaps = []
    for particles in (batch.particles, batch.next_observation):
        reward = found.reward(Transitions(*states, epoch=0, particles=particles))
        gaps.append((reward[of_rare].mean() - reward[~of_rare].mean()) / reward.std())
    assert gaps[0] > 1
    assert gaps[1] < 0  # its few states are drawn again and again, and are their own neighbours


@pytest.mark.parametrize("relabelling", ["future", "arrivals"])
def test_a_curriculum_s_weights_decide_which_goals_are_drawn(relabelling):
    """Of goals 00, 10 and 11 with weights 0, 1/4 and 3/4: by the goal that episodes end in, or arrive at."""
    replay = replay_of(capacity=9, relabelling=relabelling, arrival_share=1.0, relabel_share=1.0)
    base = episodes_of(list(range(9)), [(0, 0)] * 9)
    achieved = base.achieved_goal.copy()
    for slot in range(9):
        achieved[slot, 1:] = GOALS[slot % 3]
    replay.add(Episodes(base.observation, achieved, base.action, base.desired_goal))
    replay.goal_weights = np.array([0.0, 0.25, 0.75])
    goals = replay.sample(8_000, np.random.default_rng(0))["desired_goal"].sum(1)
    assert np.bincount(goals, minlength=3) / 8_000 == pytest.approx([0, 0.25, 0.75], abs=0.02)


def test_a_weighted_goal_that_no_episode_ended_in_gives_any_episode():
    replay = replay_of()
    replay.add(episodes_of([0, 1], [(0, 0), (1, 0)]))
    replay.goal_weights = np.array([0.0, 0.0, 1.0])
    slots = replay.draw_episodes(np.random.default_rng(0).random((2, 4_000)))
    assert np.bincount(slots) / 4_000 == pytest.approx([0.5, 0.5], abs=0.03)
