"""Relabelling: rewards by hand, and which transitions and goals are drawn how often."""

from collections import Counter

import numpy as np
import pytest
from scipy.stats import chisquare
from small_replay import GOALS, STEPS, episodes_of, filled, replay_of

from curiobench.relabelling import N_ARRIVAL_KINDS, draw_arrivals
from curiobench.replay import EpisodeReplay, Episodes


def random_episodes(rng: np.random.Generator, n: int) -> Episodes:
    """Episodes whose bits flip at random; [0, 1] among them, which is no valid goal."""
    base = episodes_of(list(range(n)), [(0, 0)] * n)
    achieved = rng.integers(0, 2, (n, STEPS + 1, 2)).astype(np.uint8)
    return Episodes(base.observation, achieved, base.action, GOALS[rng.integers(0, 3, n)])


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


def test_relabelled_share():
    base = episodes_of([0], [(1, 1)])
    replay = replay_of(relabel_share=0.8)
    replay.add(Episodes(base.observation, base.achieved_goal, base.action, np.array([[0, 1]])))  # never achieved
    batch = replay.sample(5000, np.random.default_rng(0))
    assert (batch["desired_goal"] != [0, 1]).any(1).mean() == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("cap", [0.0, 0.3, 1.0])
def test_cap_on_transitions_whose_goal_already_holds(cap):
    def share(config: dict) -> float:
        batch = filled(8, **config).sample(500, np.random.default_rng(1))
        return (batch["achieved_goal"] == batch["desired_goal"]).all(1).mean()

    free, capped = share({}), share({"satisfied_cap": cap})
    assert capped <= cap + 1e-9
    assert abs(capped - min(free, cap)) < 0.07


@pytest.mark.parametrize("relabelling", ["future", "arrivals"])
def test_cap_gives_way_when_every_goal_already_holds(relabelling):
    """Nor is there any arrival."""
    replay = replay_of(satisfied_cap=0.1, relabelling=relabelling)
    replay.add(episodes_of([0, 1], [(0, 0), (0, 0)]))
    batch = replay.sample(30, np.random.default_rng(0))
    assert len(batch["reward"]) == 30
    assert batch["reward"].all()


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
    halves = replay_of(relabelling="arrivals", arrival_share=0.5, pursued_share=0.5)
    halves.add(random_episodes(np.random.default_rng(0), 8))
    assert len(halves.sample(255, np.random.default_rng(0))["reward"]) == 255  # though both halves round up


def test_half_a_batch_comes_from_arrivals_and_the_cap_is_the_batch_s():
    config = {"relabelling": "arrivals", "satisfied_cap": 0.2, "relabel_share": 0.0}
    replay = replay_of(**config)
    base = episodes_of([0], [(1, 1)])
    replay.add(Episodes(base.observation, base.achieved_goal, base.action, np.array([[1, 0]])))
    desired = replay.sample(1000, np.random.default_rng(0))["desired_goal"]
    assert (desired == [1, 1]).all(1).sum() == 500  # the only arrival; the rest keep the goal that was pursued
    for least, share in ((0.1, {"relabel_share": 1.0}), (0.05, {"pursued_share": 0.4})):
        mixed = replay_of(**config | share)
        mixed.add(random_episodes(np.random.default_rng(0), 8))
        batch = mixed.sample(1000, np.random.default_rng(0))
        assert least < (batch["achieved_goal"] == batch["desired_goal"]).all(1).mean() <= 0.2


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
