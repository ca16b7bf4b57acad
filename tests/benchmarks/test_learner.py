"""What an update costs beside its matrix products alone, and a sample of the replay beside an update.

    pytest tests/benchmarks/test_learner.py --benchmark-only -s

The floor is every matrix product of one update, forward and backward, of the same shapes, in warm buffers, with nothing
in between: no biases, rectifiers, norms, sums over pairs, losses, Adam or copies. Update and floor are timed in turns
in one process, so that a busy machine slows both.
"""

import time
from collections.abc import Callable
from itertools import combinations

import numpy as np
import pytest
import torch

from curiobench.methods.pairs import PairLayout
from curiobench.methods.process import tune_process
from curiobench.methods.reward import Batch
from curiobench.methods.sac import SAC
from curiobench.methods.settings import SACConfig
from curiobench.replay import EpisodeReplay, Episodes, ReplayConfig

STEPS = 50
SIZES = [(2, 512, 64), (2, 256, 256), (3, 512, 64), (3, 256, 256)]
"""(blocks, batch, hidden units)"""


def layout_of(n_blocks: int) -> PairLayout:
    pairs = list(combinations(range(n_blocks), 2))
    bits = [(k, len(pairs) + 2 * k, len(pairs) + 2 * k + 1) for k in range(len(pairs))]
    return PairLayout(n_blocks, tuple((i, j, *b) for (i, j), b in zip(pairs, bits, strict=True)))


def filled_replay(layout: PairLayout, episodes: int = 400) -> EpisodeReplay:
    """Random episodes whose goal changes once, somewhere; as many goals as three blocks have."""
    rng = np.random.default_rng(0)
    goals = np.unique(rng.integers(0, 2, (60, layout.goal_size), dtype=np.uint8), axis=0)[:35]

    def reward(achieved: np.ndarray, desired: np.ndarray, info: object) -> np.ndarray:
        return (achieved == desired).all(-1)

    config = ReplayConfig(capacity=episodes, satisfied_cap=0.3)
    replay = EpisodeReplay(config, goals, reward, STEPS, layout.observation_size, layout.action_size)
    ends = goals[rng.integers(0, len(goals), (2, episodes))]
    changed = np.arange(STEPS + 1)[None, :, None] >= rng.integers(1, STEPS, (episodes, 1, 1))
    observation = rng.normal(size=(episodes, STEPS + 1, layout.observation_size))
    action = rng.uniform(-1, 1, (episodes, STEPS, layout.action_size))
    replay.add(Episodes(observation, np.where(changed, ends[1][:, None], ends[0][:, None]), action, ends[1]))
    return replay


def products(layout: PairLayout, batch: int, hidden: int, pair_size: int) -> list[tuple[int, int, int, int]]:
    """(members, rows, inner, columns) of every product in one update, symmetric pairs."""
    n_pairs = layout.n_blocks * (layout.n_blocks - 1)

    def forward(members: int, context: int, contexts: int, out: int) -> list[tuple[int, int, int, int]]:
        rows = contexts * batch
        return [
            (members, rows, context, hidden),
            (members, n_pairs * batch, pair_size, hidden),
            (members, n_pairs * rows, hidden, hidden),
            (members, rows, hidden, hidden),
            (members, out, hidden, rows),
        ]

    def to_weights(members: int, context: int, out: int) -> list[tuple[int, int, int, int]]:
        layers = [(m, inner, rows, columns) for m, rows, inner, columns in forward(members, context, 1, out)[:4]]
        return [*layers, (members, out, batch, hidden)]

    def to_inputs(members: int, contexts: int, out: int) -> list[tuple[int, int, int, int]]:
        rows = contexts * batch
        layers = [(members, n_pairs * rows, hidden, hidden), (members, rows, hidden, hidden)]
        return layers if out == 1 else [*layers, (members, rows, out, hidden)]  # with one output: no product

    policy, critic = layout.body_size, layout.body_size + layout.action_size
    done = 2 * forward(1, policy, 1, 2 * layout.action_size)  # at s and s'
    done += forward(2, critic, 1, 1) + forward(2, critic, 2, 1)  # targets; stored and own actions at once
    done += to_weights(1, policy, 2 * layout.action_size) + to_weights(2, critic, 1)
    return done + to_inputs(1, 1, 2 * layout.action_size) + to_inputs(2, 2, 1) + [(2, batch, hidden, critic)]


def floor_of(shapes: list[tuple[int, int, int, int]]) -> Callable[[], None]:
    """A function that does these products and nothing else."""
    buffers = {
        (m, r, k, c): (torch.ones(m, r, k), torch.ones(m, k, c), torch.empty(m, r, c)) for m, r, k, c in set(shapes)
    }
    tasks = [buffers[shape] for shape in shapes]

    def run() -> None:
        for first, second, out in tasks:
            torch.bmm(first, second, out=out)

    return run


def least_ms(*functions: Callable[[], object], rounds: int = 40) -> list[float]:
    """Least milliseconds of each, called in turns: what is above it is other processes' doing."""
    times: list[list[float]] = [[] for _ in functions]
    for turn in range(rounds + 3):
        for function, spent in zip(functions, times, strict=True):
            start = time.perf_counter()
            function()
            if turn >= 3:
                spent.append(1e3 * (time.perf_counter() - start))
    return [min(spent) for spent in times]


@pytest.mark.parametrize("layer_norm", [True, False], ids=["norm", "plain"])
@pytest.mark.parametrize(("n_blocks", "size", "hidden"), SIZES)
def test_update_against_its_floor(benchmark, n_blocks, size, hidden, layer_norm):
    tune_process()
    layout, rng = layout_of(n_blocks), np.random.default_rng(1)
    agent = SAC(layout, SACConfig(hidden=hidden, layer_norm=layer_norm), torch.Generator().manual_seed(0))
    replay = filled_replay(layout)
    batch = Batch.from_numpy(replay.sample(size, rng))
    floor = floor_of(products(layout, size, hidden, agent.encoder.pair_size))
    update_ms, floor_ms, sample_ms = least_ms(lambda: agent.update(batch), floor, lambda: replay.sample(size, rng))
    kind = "norm" if layer_norm else "plain"
    print(
        f"\n{n_blocks} blocks, batch {size}, hidden {hidden}, {kind}: update {update_ms:.1f} ms"
        f" = {update_ms / floor_ms:.2f} × floor ({floor_ms:.1f} ms); sample {sample_ms / update_ms:.1%} of an update"
    )
    benchmark.extra_info.update(ratio_to_floor=update_ms / floor_ms, sample_share=sample_ms / update_ms)
    benchmark.pedantic(lambda: agent.update(batch), rounds=5)
