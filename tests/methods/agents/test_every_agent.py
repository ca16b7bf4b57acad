"""Every kind of agent is a function of its seed and its batches, also across a save.

`curiobench check` examines each method by itself (tests/check).
"""

import io

import numpy as np
import pytest
import torch
from agents import random_batch, raw_of
from layouts import layout_of

from curiobench.check.subject import same as same_state
from curiobench.methods.agents.settings import HybridConfig, SACConfig
from curiobench.methods.registry import make_agent
from curiobench.methods.specs import HYBRID

METHODS = ["icm", "dac", "mi", "ngu"]
"""One whose reward needs a transition only, one that sees the policy, particles, and whole episodes."""
SPECS = ["sac", *METHODS, *(name + HYBRID for name in METHODS)]
CASES = {spec: (spec, {"tune_temperature": True}, {"adaptive_tau": True}) for spec in SPECS} | {
    "zscore": ("rnd+hm", {}, {"q_int_normalisation": "zscore"}),
    "identities": ("sac", {"identities": True}, {}),
    "oriented pairs": ("sac", {"pairs": "oriented"}, {}),
    "attention": ("sac", {"pairs": "roles", "features": "near_field", "network": "pair_attention"}, {}),
}


def agent_of(case: str, seed: int):
    spec, config, hybrid = CASES[case]
    settings = SACConfig(hidden=16, **config), torch.Generator().manual_seed(seed), HybridConfig(**hybrid)
    return make_agent(spec, layout_of(3), *settings)


def play(agent, numbers: range) -> list:
    """Actions and metrics of some rounds; each ends with an action that only the next update counts."""
    found = []
    for k in numbers:
        batch = random_batch(layout_of(3), 8, np.random.default_rng(k))
        agent.observe(*raw_of(batch))
        metrics = {name: float(value) for name, value in agent.update(batch, epoch=k // 2).items()}
        assert np.isfinite(list(metrics.values())).all()
        found.append((agent.act(*raw_of(batch)).tolist(), metrics))
    return found


@pytest.mark.parametrize("case", CASES)
def test_trains_twice_equal_and_resumes_to_the_bit(case):
    first, second, resumed = (agent_of(case, seed) for seed in (0, 0, 1))
    assert play(first, range(3)) == play(second, range(3))
    file = io.BytesIO()
    torch.save(first.state_dict(), file)
    resumed.load_state_dict(torch.load(io.BytesIO(file.getvalue()), weights_only=True))
    histories = [play(agent, range(3, 6)) for agent in (first, second, resumed)]
    assert histories[0] == histories[1] == histories[2]
    assert same_state(first.state_dict(), second.state_dict())
    assert same_state(first.state_dict(), resumed.state_dict())
