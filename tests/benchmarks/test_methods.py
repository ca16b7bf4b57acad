"""What a curiosity method costs: a full update beside that of `sac`, and with `+hm` beside that without.

    pytest tests/benchmarks/test_methods.py --benchmark-only -s

All agents are updated in turns in one process on the same batch, so that a busy machine slows them alike.
"""

import numpy as np
import pytest
import torch
from curiosity import REWARDS
from layouts import layout_of
from replays import laptop_batch
from side_by_side import ratio, side_by_side

from curiobench.methods.process import tune_process
from curiobench.methods.registry import make_agent

TARGETS = {"icm": 1.4, "rnd": 1.4, "re3": 1.4, "mi": 1.6, "dac": 1.6}
"""Largest cost of an update beside that of `sac`."""
TARGET_OF_HYBRIDS = 2.0
"""Largest cost of an update with `+hm` beside that without."""


@pytest.mark.parametrize("n_blocks", [2, 3])
def test_updates_side_by_side(benchmark, capsys, n_blocks):
    tune_process()
    config, batch = laptop_batch(n_blocks)
    raw = [getattr(batch, name)[:64].numpy() for name in ("observation", "achieved_goal", "desired_goal")]
    specs = ["sac", *(f"{name}{mechanism}" for name in REWARDS for mechanism in ("", "+hm"))]
    settings = layout_of(n_blocks), config.sac
    agents = {spec: make_agent(spec, *settings, torch.Generator().manual_seed(0)) for spec in specs}
    calls = {spec: lambda agent=agent: agent.update(batch, epoch=1) for spec, agent in agents.items()}
    calls |= {f"{spec} acts": lambda agent=agents[spec]: agent.act(*raw) for spec in ("sac", "rnd+hm")}
    seconds = benchmark.pedantic(lambda: side_by_side(calls, rounds=20), rounds=1)
    beside_sac = {spec: ratio(seconds, spec, "sac") for spec in specs[1:]}
    hybrids = {name: ratio(seconds, f"{name}+hm", name) for name in REWARDS}
    acting = ratio(seconds, "rnd+hm acts", "sac acts")
    with capsys.disabled():
        print(f"\n{n_blocks} blocks, batch {config.batch_size}: sac {1e3 * np.median(seconds['sac']):.1f} ms")
        print("  update / sac: " + ", ".join(f"{spec} {value:.2f}" for spec, value in beside_sac.items()))
        print("  hybrid / base: " + ", ".join(f"{name} {value:.2f}" for name, value in hybrids.items()))
        print(f"  rnd+hm acting / sac acting: {acting:.2f}")
    benchmark.extra_info.update(beside_sac, acting=acting)
    assert {spec: value for spec, value in beside_sac.items() if value > TARGETS.get(spec, np.inf)} == {}
    assert {name: value for name, value in hybrids.items() if value > TARGET_OF_HYBRIDS} == {}
