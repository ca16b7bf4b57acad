"""What a curiosity method costs: a full update of the agent with it, as a multiple of one without.

    pytest tests/benchmarks/test_methods.py --benchmark-only -s

All agents are updated in turns in one process on the same batch, so that a busy machine slows them alike.
"""

import numpy as np
import pytest
import torch
from side_by_side import ratio, side_by_side
from test_learner import laptop_batch, layout_of

from curiobench.methods.process import tune_process
from curiobench.methods.registry import REWARDS, make_agent

TARGETS = {"icm": 1.4, "rnd": 1.4, "re3": 1.4, "mi": 1.6, "dac": 1.6}
"""Largest cost of an update beside `sac`'s."""


@pytest.mark.parametrize("n_blocks", [2, 3])
def test_update_beside_that_of_sac(benchmark, capsys, n_blocks):
    tune_process()
    config, batch = laptop_batch(n_blocks)
    layout = layout_of(n_blocks)
    agents = {
        spec: make_agent(spec, layout, config.sac, torch.Generator().manual_seed(0)) for spec in ("sac", *REWARDS)
    }
    updates = {spec: lambda agent=agent: agent.update(batch, epoch=1) for spec, agent in agents.items()}
    seconds = benchmark.pedantic(lambda: side_by_side(updates, rounds=40), rounds=1)
    ratios = {spec: ratio(seconds, spec, "sac") for spec in REWARDS}
    with capsys.disabled():
        found = ", ".join(f"{spec} {value:.2f}" for spec, value in ratios.items())
        sac_ms = 1e3 * np.median(seconds["sac"])
        print(f"\n{n_blocks} blocks, batch {config.batch_size}: sac {sac_ms:.1f} ms; as multiples of it: {found}")
    benchmark.extra_info.update(ratios)
    assert {spec: value for spec, value in ratios.items() if value > TARGETS.get(spec, np.inf)} == {}
