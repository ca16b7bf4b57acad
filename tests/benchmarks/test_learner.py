"""What an update costs beside its matrix products alone, and a sample of the replay beside an update.

    pytest tests/benchmarks/test_learner.py --benchmark-only -s

The floor is every matrix product of an update, forward and backward, of the same shapes, in warm buffers, with nothing
in between: no biases, rectifiers, norms, pooling of pairs, losses, Adam or copies. Update and floor are timed in turns
in one process, so that a busy machine slows both.
"""

import time
from collections.abc import Callable

import numpy as np
import pytest
import torch
from layouts import layout_of
from replays import filled_replay

from curiobench.methods.agents.sac import SAC
from curiobench.methods.process import tune_process
from curiobench.methods.reward import Batch
from curiobench.presets import PRESETS

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
    """Least milliseconds of each, called in turns; other processes only add to it."""
    times: list[list[float]] = [[] for _ in functions]
    for turn in range(rounds + 3):
        for function, spent in zip(functions, times, strict=True):
            start = time.perf_counter()
            function()
            if turn >= 3:
                spent.append(1e3 * (time.perf_counter() - start))
    return [min(spent) for spent in times]


@pytest.mark.parametrize("n_blocks", [2, 3])
def test_update_against_its_floor(benchmark, n_blocks):
    """Two updates, of which the policy takes part in one."""
    tune_process()
    layout, rng, config = layout_of(n_blocks), np.random.default_rng(1), PRESETS["laptop"]
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
        f"\n{n_blocks} blocks: two updates {update_ms:.1f} ms = {update_ms / floor_ms:.2f} × floor"
        f" ({floor_ms:.1f} ms); sample {2 * sample_ms / update_ms:.1%} of an update"
    )
    benchmark.extra_info.update(ratio_to_floor=update_ms / floor_ms, sample_share=2 * sample_ms / update_ms)
    benchmark.pedantic(update, rounds=5)
