"""What the hybrid policy mechanism costs: an update beside its base method's and `sac`'s, an action beside `sac`'s.

    pytest tests/benchmarks/test_hybrid_cost.py --benchmark-only -s

Base and hybrid are timed in turns in one process on the same batch, so that a busy machine slows both.
"""

import numpy as np
import pytest
import torch
from side_by_side import ratio, side_by_side
from test_learner import laptop_batch, layout_of

from curiobench.methods.process import tune_process
from curiobench.methods.registry import REWARDS, make_agent

TARGET = 2.0
"""Largest cost of a hybrid's update beside its base's."""


@pytest.mark.parametrize("n_blocks", [2, 3])
def test_hybrids_beside_their_bases(benchmark, capsys, n_blocks):
    tune_process()
    config, batch = laptop_batch(n_blocks)
    layout = layout_of(n_blocks)
    raw = [getattr(batch, name)[:64].numpy() for name in ("observation", "achieved_goal", "desired_goal")]
    specs = ["sac", *(f"{name}{mechanism}" for name in REWARDS for mechanism in ("", "+hm"))]
    agents = {spec: make_agent(spec, layout, config.sac, torch.Generator().manual_seed(0)) for spec in specs}
    calls = {spec: lambda agent=agent: agent.update(batch, epoch=1) for spec, agent in agents.items()}
    calls |= {f"{spec} acts": lambda agent=agents[spec]: agent.act(*raw) for spec in ("sac", "rnd+hm")}
    seconds = benchmark.pedantic(lambda: side_by_side(calls, rounds=12), rounds=1)
    ratios = {name: ratio(seconds, f"{name}+hm", name) for name in REWARDS}
    acting = ratio(seconds, "rnd+hm acts", "sac acts")
    with capsys.disabled():
        found = ", ".join(f"{name} {value:.2f}" for name, value in ratios.items())
        of_sac = ", ".join(f"{spec} {ratio(seconds, spec, 'sac'):.2f}" for spec in specs[1:])
        print(f"\n{n_blocks} blocks, batch {config.batch_size}: sac {1e3 * np.median(seconds['sac']):.1f} ms")
        print(f"  update / sac: {of_sac}\n  hybrid / base: {found}\n  rnd+hm acting / sac acting: {acting:.2f}")
    benchmark.extra_info.update(ratios, acting=acting)
    assert {name: value for name, value in ratios.items() if value > TARGET} == {}
