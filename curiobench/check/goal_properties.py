"""`curiobench check` for methods that decide about goals: whether a curriculum or a relabelling keeps its rules.

As in properties.py, each property is a function that raises `Broken`, or what stops a run, with what was expected and
found.
"""

import copy
import json
from collections.abc import Callable
from functools import partial

import numpy as np

from curiobench.build import goals_of
from curiobench.check import Finding
from curiobench.check.properties import expect, expect_untouched, finding, no_global_randomness
from curiobench.check.subject import BATCH, global_generators, same, seeded_globals
from curiobench.methods.curriculum import Curriculum, Situation
from curiobench.methods.goal_guard import curriculum_metrics, goal_weights, goals_drawn
from curiobench.methods.relabelling import Relabelling
from curiobench.replay import EpisodeReplay, Episodes, ReplayConfig
from curiobench.tasks.goals import goal_space

EPISODES, STEPS = 40, 12
"""Episodes in the replay, and their steps."""


def examine_goals(method: type[Curriculum] | type[Relabelling]) -> list[Finding]:
    """Try every property of a curriculum or of a relabelling; global random state is left as it is."""
    properties = CURRICULUM_PROPERTIES if issubclass(method, Curriculum) else RELABELLING_PROPERTIES
    with seeded_globals():
        return [finding(name, partial(tried, method), n_blocks) for name, (tried, n_blocks) in properties.items()]


def _curriculum(method: type[Curriculum], n_blocks: int, epochs: int = 3) -> Curriculum:
    """One that has seen some epochs of random outcomes."""
    goals, rng = goals_of(goal_space(n_blocks)), np.random.default_rng(0)
    curriculum = method(goals, method.Config())
    for epoch in range(epochs):
        drawn, tested = goals_drawn(curriculum, _situation(n_blocks, epoch), rng)
        curriculum.observe(drawn, np.where(rng.random(BATCH) < 0.5, drawn, -1), tested)
        curriculum.end_epoch()
    return curriculum


def _situation(n_blocks: int, seed: int) -> Situation:
    goals, rng = goals_of(goal_space(n_blocks)).bits, np.random.default_rng(seed)
    return Situation(
        rng.random(len(goals)) < 0.3 * seed, goals[rng.integers(len(goals), size=BATCH)].astype(np.float32)
    )


def draws_goals(method: type[Curriculum], n_blocks: int) -> None:
    curriculum = _curriculum(method, n_blocks)
    for seed in range(4):  # among them one in which no goal was reached
        goals_drawn(curriculum, _situation(n_blocks, seed), np.random.default_rng(0))


def same_goals_again(method: type[Curriculum], n_blocks: int) -> None:
    draws = [_curriculum(method, n_blocks).draw(_situation(n_blocks, 1), np.random.default_rng(0)) for _ in range(2)]
    expect(same(*draws), "equal draws from equal generators", "different ones")


def legal_weights(method: type[Curriculum], n_blocks: int) -> None:
    goal_weights(_curriculum(method, n_blocks))


def plain_metrics(method: type[Curriculum], n_blocks: int) -> None:
    found, later = (curriculum_metrics(_curriculum(method, n_blocks, epochs)) for epochs in (0, 3))
    expect(found.keys() == later.keys(), "the same metrics each time", f"{sorted(found)}, then {sorted(later)}")


def curriculum_round_trip(method: type[Curriculum], n_blocks: int) -> None:
    first, second = _curriculum(method, n_blocks), _curriculum(method, n_blocks, epochs=0)
    second.load_state_dict(json.loads(json.dumps(first.state_dict())))
    histories = []
    for curriculum in (first, second):
        drawn = curriculum.draw(_situation(n_blocks, 2), np.random.default_rng(0))
        curriculum.end_epoch()
        histories.append([drawn, curriculum.replay_weights(), dict(curriculum.metrics()), curriculum.state_dict()])
    expect(same(*histories), "training to go on alike in a new one that loads the state", "something else")


def situation_untouched(method: type[Curriculum], n_blocks: int) -> None:
    given, kept = _situation(n_blocks, 2), _situation(n_blocks, 2)
    _curriculum(method, n_blocks).draw(given, np.random.default_rng(0))
    expect_untouched(vars(given), vars(kept), "the situation as it was given")


def _replay(method: type[Relabelling], n_blocks: int, filled: int = EPISODES) -> EpisodeReplay:
    """Of episodes that jump between valid goals."""
    space, rng = goal_space(n_blocks), np.random.default_rng(0)
    goals = goals_of(space)
    own = method(goals, method.Config())
    sizes = {"steps": STEPS, "observation_size": 5, "action_size": 2, "on_bits": space.on_bits}
    replay = EpisodeReplay(ReplayConfig(capacity=EPISODES), space.goals, **sizes, relabelling=own)
    moves = rng.random((filled, STEPS + 1)) < 0.3
    path = np.where(moves, rng.integers(len(space), size=moves.shape), 0)
    replay.add(
        Episodes(
            rng.normal(size=(filled, STEPS + 1, 5)).astype(np.float32),
            goals.bits[path],
            rng.uniform(-1, 1, (filled, STEPS, 2)).astype(np.float32),
            goals.bits[rng.integers(len(space), size=filled)],
        )
    )
    return replay


def draws_transitions(method: type[Relabelling], n_blocks: int) -> None:
    for filled in (1, EPISODES):
        replay = _replay(method, n_blocks, filled)
        for size in (1, BATCH):
            replay.sample(size, np.random.default_rng(0))  # which refuses what is not a draw


def same_transitions_again(method: type[Relabelling], n_blocks: int) -> None:
    draws = [_replay(method, n_blocks).sample(BATCH, np.random.default_rng(0)) for _ in range(2)]
    expect(same(*draws), "equal draws from equal generators", "different ones")


def replay_untouched(method: type[Relabelling], n_blocks: int) -> None:
    replay = _replay(method, n_blocks)
    kept = copy.deepcopy(replay.arrays)
    replay.sample(BATCH, np.random.default_rng(0))
    expect_untouched(replay.arrays, kept, "the replay as it was")


def global_random_state(method: type[Curriculum] | type[Relabelling], n_blocks: int) -> None:
    before = global_generators()
    if issubclass(method, Curriculum):
        _curriculum(method, n_blocks)
    else:
        _replay(method, n_blocks).sample(BATCH, np.random.default_rng(0))
    no_global_randomness(before)


Tried = dict[str, tuple[Callable[..., None], int]]
CURRICULUM_PROPERTIES: Tried = {
    "draws a goal an episode": (draws_goals, 2),
    "takes 4 blocks, too": (draws_goals, 4),
    "deterministic under its generator": (same_goals_again, 3),
    "situation is left as it is": (situation_untouched, 3),
    "replay weights are legal": (legal_weights, 3),
    "metrics are finite, and the same each time": (plain_metrics, 3),
    "state round-trips through JSON": (curriculum_round_trip, 3),
    "global random state is left alone": (global_random_state, 3),
}
"""What is tried of a curriculum, and with how many blocks."""
RELABELLING_PROPERTIES: Tried = {
    "draws slots, steps and goals": (draws_transitions, 2),
    "takes 4 blocks, too": (draws_transitions, 4),
    "deterministic under its generator": (same_transitions_again, 3),
    "replay is left as it is": (replay_untouched, 3),
    "global random state is left alone": (global_random_state, 3),
}
"""What is tried of a relabelling, and with how many blocks."""
