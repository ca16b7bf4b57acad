"""Method specs: what runs, what is planned, what is misspelt."""

import pytest
import torch
from layouts import layout_of

from curiobench.methods.registry import PLANNED, available_specs, make_agent, parse_spec
from curiobench.methods.sac import SAC, SACConfig


def test_sac_is_available_in_any_case():
    assert "sac" in available_specs()
    assert parse_spec(" SAC ").reward is None
    agent = make_agent("sac", layout_of(2), SACConfig(hidden=8), torch.Generator().manual_seed(0))
    assert isinstance(agent, SAC)


@pytest.mark.parametrize("spec", [*PLANNED, "icm+hm", "mi+hm"])
def test_planned_methods_say_so(spec):
    assert spec not in available_specs()
    with pytest.raises(ValueError, match="not implemented yet; available: sac"):
        parse_spec(spec)


@pytest.mark.parametrize("spec", ["sacc", "", "icm+xx", "mihm+hm", "ppo"])
def test_unknown_methods_name_the_nearest(spec):
    with pytest.raises(ValueError, match=r"unknown method .* the nearest is 'sac'"):
        parse_spec(spec)
