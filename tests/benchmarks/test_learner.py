"""What an update costs beside its matrix products alone, and a sample of the replay beside an update.

    pytest tests/benchmarks/test_learner.py --benchmark-only -s

The floor is every matrix product of an update, forward and backward, of the same shapes, in warm buffers, with nothing
in between: no biases, rectifiers, norms, pooling of pairs, losses, Adam or copies. Update and floor are timed in turns
in one process, so that a busy machine slows both.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import torch

from curiobench.config import RunConfig
from curiobench.methods.agents.pairs import PairLayout
from curiobench.methods.agents.sac import SAC
from curiobench.methods.process import tune_process
from curiobench.methods.reward import Batch
from curiobench.presets import PRESETS, preset
from curiobench.replay import EpisodeReplay, Episodes, ReplayConfig

STEPS = 50
SIZES = [(2, 512, 64), (2, 256, 256), (3, 512, 64), (3, 256, 256)]
"""(blocks, batch, hidden units)"""


def layout_of(n_blocks: int) -> PairLayout:
    pairs = list(combinations(range(n_blocks), 2))
    bits = [(k, len(pairs) + 2 * k, len(pairs) + 2 * k + 1) for k in range(len(pairs))]
    return PairLayout(n_blocks, tuple((i, j, *b) for (i, j), b in zip(pairs, bits, strict=True)))


def filled_replay(
    layout: PairLayout, config: ReplayConfig = PRESETS["short"].replay, episodes: int = 400
) -> EpisodeReplay:
    """Random episodes whose goal changes once, somewhere; as many goals as three blocks have."""
    rng = np.random.default_rng(0)
    goals = np.unique(rng.integers(0, 2, (60, layout.goal_size), dtype=np.uint8), axis=0)[:35]

    def reward(achieved: np.ndarray, desired: np.ndarray, info: object) -> np.ndarray:
        return (achieved == desired).all(-1)

    config = replace(config, capacity=episodes)
    on_bits = np.arange(layout.goal_size) >= len(layout.pairs)
    replay = EpisodeReplay(config, goals, reward, STEPS, layout.observation_size, layout.action_size, on_bits)
    ends = goals[rng.integers(0, len(goals), (2, episodes))]
    changed = np.arange(STEPS + 1)[None, :, None] >= rng.integers(1, STEPS, (episodes, 1, 1))
    observation = rng.normal(size=(episodes, STEPS + 1, layout.observation_size))
    action = rng.uniform(-1, 1, (episodes, STEPS, layout.action_size))
    replay.add(Episodes(observation, np.where(changed, ends[1][:, None], ends[0][:, None]), action, ends[1]))
    return replay


def laptop_batch(n_blocks: int) -> tuple[RunConfig, Batch]:
    """The preset laptop for a task, and a batch of its size with all that methods ask for."""
    config = preset("laptop", f"stack{n_blocks}")
    replay = filled_replay(layout_of(n_blocks), config.replay)
    return config, Batch.from_numpy(replay.sample(config.batch_size, np.random.default_rng(1), 512, episodes=True))


Product = tuple[int, int, int, int]
"""(members, rows, inner, columns)."""


def products(agent: SAC, batch: int, acts: bool) -> list[Product]:
    """Every product in one update, with a step of the policy or without."""
    layout, encoder, hidden = agent.learner.layout, agent.learner.encoder, agent.learner.config.hidden
    wide = 2 * hidden if agent.learner.config.network == "pair_attention" else hidden
    n_pairs = len(encoder.encode_plainly(agent.learner.batch.rows)[2][0])

    def forward(members: int, context: int, contexts: int, out: int) -> list[Product]:
        rows = contexts * batch
        return [
            (members, rows, context, hidden),
            (members, n_pairs * batch, encoder.pair_size, hidden),
            (members, n_pairs * rows, hidden, wide),
            (members, rows, wide, wide),
            (members, out, wide, rows),
        ]

    def to_weights(members: int, context: int, out: int) -> list[Product]:
        layers = [(m, inner, rows, columns) for m, rows, inner, columns in forward(members, context, 1, out)[:4]]
        return [*layers, (members, out, batch, wide)]

    def to_inputs(members: int, contexts: int, out: int) -> list[Product]:
        layers = [(members, n_pairs * contexts * batch, wide, hidden), (members, contexts * batch, wide, wide)]
        return layers if out == 1 else [*layers, (members, contexts * batch, out, wide)]  # with one output: no product

    policy, critic, out = encoder.context_size, encoder.context_size + layout.action_size, 2 * layout.action_size
    done = forward(1, policy, 1, out) + forward(2, critic, 1, 1)  # at s': the policy and the targets
    done += forward(2, critic, 1 + acts, 1) + to_weights(2, critic, 1) + to_inputs(2, 1 + acts, 1)
    if acts:
        done += forward(1, policy, 1, out) + to_weights(1, policy, out) + to_inputs(1, 1, out)
        done += [(2, batch, hidden, critic)]
    return done


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


@pytest.mark.parametrize("name", ["laptop", "short"])
@pytest.mark.parametrize("n_blocks", [2, 3])
def test_update_against_its_floor(benchmark, n_blocks, name):
    """Of the agents of two presets; two updates, of which the policy of the laptop's takes part in one."""
    tune_process()
    layout, rng, config = layout_of(n_blocks), np.random.default_rng(1), PRESETS[name]
    agent, size = SAC(layout, config.sac, torch.Generator().manual_seed(0)), config.batch_size
    replay = filled_replay(layout, config.replay)
    batch = Batch.from_numpy(replay.sample(size, rng))
    agent.update(batch)
    shapes = [products(agent, size, acts=k % config.sac.actor_every == 0) for k in range(2)]
    floor = floor_of(shapes[0] + shapes[1])

    def update() -> None:
        agent.update(batch)
        agent.update(batch)

    update_ms, floor_ms, sample_ms = least_ms(update, floor, lambda: replay.sample(size, rng))
    print(
        f"\n{name}, {n_blocks} blocks: two updates {update_ms:.1f} ms = {update_ms / floor_ms:.2f} × floor"
        f" ({floor_ms:.1f} ms); sample {2 * sample_ms / update_ms:.1%} of an update"
    )
    benchmark.extra_info.update(ratio_to_floor=update_ms / floor_ms, sample_share=2 * sample_ms / update_ms)
    benchmark.pedantic(update, rounds=5)
