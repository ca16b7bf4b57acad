"""Method specs: what runs, under which names, what is misspelt."""

import numpy as np
import pytest
import torch
from layouts import layout_of
from test_every_method import agent_of, train
from test_sac import same_state

from curiobench.methods.agents.hybrid import HybridAgent
from curiobench.methods.agents.sac import SAC
from curiobench.methods.agents.settings import HybridConfig, SACConfig
from curiobench.methods.registry import GOAL_METHODS, REWARDS, make_agent, parse_spec
from curiobench.methods.specs import ALIASES, BUILT_IN, available_specs

HYBRIDS = [spec for spec in available_specs() if parse_spec(spec).hybrid]


def test_sac_is_available_in_any_case():
    assert "sac" in available_specs()
    assert parse_spec(" SAC ").reward is None
    agent = make_agent("sac", layout_of(2), SACConfig(hidden=8), torch.Generator().manual_seed(0))
    assert type(agent) is SAC


def test_every_curiosity_method_has_a_hybrid():
    assert {*HYBRIDS} == {f"{name}+hm" for name in REWARDS} | {*ALIASES}
    for name, method in REWARDS.items():
        assert parse_spec(f" {name.upper()}+HM ").reward is method
        assert not parse_spec(name).hybrid
        assert type(agent_of(name)) is SAC
        assert type(agent_of(f"{name}+hm")) is HybridAgent


def test_built_in_methods_are_named_as_what_they_are():
    assert list(REWARDS) == [spec for spec, method in BUILT_IN.items() if method.rewards]
    assert list(GOAL_METHODS) == [spec for spec, method in BUILT_IN.items() if not method.rewards]


def test_mihm_is_another_name_and_makes_the_same_config():
    assert parse_spec("mihm") == parse_spec("mi+hm")
    assert parse_spec("MIHM").text == "mi+hm"


def test_settings_of_the_mechanism_arrive():
    config, generator = HybridConfig(q_int_normalisation="zscore", popart_rate=0.5), torch.Generator().manual_seed(0)
    agent = make_agent("rnd+hm", layout_of(2), SACConfig(hidden=8), generator, config)
    assert (agent.intrinsic_values.popart.rate, agent._explores_by) == (0.5, 1)


@pytest.mark.parametrize("spec", HYBRIDS)
def test_hybrids_train_twice_equal_and_resume_equal(spec):
    first, second, resumed = agent_of(spec), agent_of(spec), agent_of(spec, seed=1)
    metrics = train(first, range(4))
    assert metrics == train(second, range(4))
    assert all(np.isfinite(list(row.values())).all() for row in metrics)
    resumed.load_state_dict(first.state_dict())
    assert train(first, range(4, 6)) == train(resumed, range(4, 6))
    assert same_state(first.state_dict(), resumed.state_dict())


def test_the_hybrid_mechanism_needs_a_curiosity_method():
    with pytest.raises(
        ValueError, match=r"'sac\+hm': the hybrid mechanism needs a curiosity method; available: sac, icm"
    ):
        parse_spec("sac+hm")


@pytest.mark.parametrize(
    ("spec", "nearest"),
    [
        ("sacc", "sac"),
        ("", "sac"),
        ("icm+xx", "icm+hm"),
        ("mihm+hm", "mi+hm"),
        ("rmd", "rnd"),
        ("icm-hm", "icm+hm"),
        ("re3+mh", "re3+hm"),
    ],
)
def test_unknown_methods_name_the_nearest(spec, nearest):
    with pytest.raises(ValueError, match=r"unknown method .* the nearest is") as refused:
        parse_spec(spec)
    assert f"the nearest is {nearest!r};" in str(refused.value)
