"""Method specs: which agent each makes, and what is said of a misspelt one."""

import pytest
import torch
from curiosity import REWARDS
from layouts import layout_of

from curiobench.methods.agents.hybrid import HybridAgent
from curiobench.methods.agents.sac import SAC
from curiobench.methods.agents.settings import HybridConfig, SACConfig
from curiobench.methods.registry import make_agent, parse_spec
from curiobench.methods.specs import ALIASES, BUILT_IN, available_specs


def make(spec: str, *settings):
    return make_agent(spec, layout_of(2), SACConfig(hidden=8), torch.Generator().manual_seed(0), *settings)


def test_every_curiosity_method_has_a_hybrid():
    hybrids = {spec for spec in available_specs() if parse_spec(spec).hybrid}
    assert hybrids == {f"{name}+hm" for name in REWARDS} | {*ALIASES}
    for name, method in REWARDS.items():
        assert parse_spec(f" {name.upper()}+HM ").reward is method
        assert not parse_spec(name).hybrid
    assert type(make("rnd")) is SAC
    assert type(make("rnd+hm")) is HybridAgent


def test_built_in_methods_are_of_the_kind_that_their_lines_say():
    for spec, method in BUILT_IN.items():
        assert (parse_spec(spec).reward is not None) == method.rewards


def test_settings_of_the_mechanism_reach_the_agent():
    assert make("rnd+hm", HybridConfig(popart_rate=0.5)).intrinsic_values.popart.rate == 0.5


def test_the_hybrid_mechanism_needs_a_curiosity_method():
    for name in ("sac", "decstr"):
        message = rf"'{name}\+hm': \+hm needs .* intrinsic reward, and {name} has none; use one of icm\+hm, rnd\+hm"
        with pytest.raises(ValueError, match=message):
            parse_spec(f"{name}+hm")


@pytest.mark.parametrize(
    ("spec", "nearest"),
    [("", "sac"), ("icm+xx", "icm+hm"), ("mihm+hm", "mi+hm"), ("rmd", "rnd"), ("icm-hm", "icm+hm")],
)
def test_unknown_methods_name_the_nearest(spec, nearest):
    with pytest.raises(ValueError, match=rf"unknown method .* the nearest is '{nearest.replace('+', '[+]')}';"):
        parse_spec(spec)
