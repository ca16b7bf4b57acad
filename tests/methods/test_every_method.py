"""What holds for every curiosity method beside the rules that `curiobench check` examines (tests/check)."""

import inspect
import re
from dataclasses import FrozenInstanceError, fields, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from agents import random_batch
from curiosity import REWARDS, fresh, random_transitions, transitions_of
from layouts import SMALL, layout_of

from curiobench.check.subject import same as same_state
from curiobench.methods.agents.settings import HybridConfig, SACConfig
from curiobench.methods.registry import make_agent
from curiobench.methods.reward import Transitions
from curiobench.methods.specs import BUILT_IN

every_method = pytest.mark.parametrize("spec", REWARDS)
PAGES = Path(__file__).parents[2] / "docs" / "methods"
SETTING = re.compile(r"^\| `(\w+)` \| ([^|]+) \| [^|]+ \|$", re.MULTILINE)
SEEN = {"positions": [0, 1, 2, 10, 11, 12, 25, 26, 27], "blocks": [10, 11, 12, 25, 26, 27]}
"""Columns of a stack2 observation."""


@pytest.mark.parametrize("spec", ["counts", "dac", "e3b", "ngu", "ride"])
def test_a_part_that_a_method_needs_and_is_not_given_is_named(spec):
    bare = replace(random_transitions(), next_achieved_goal=None, step=None, policy=None)
    with pytest.raises(ValueError, match=r"needs `Transitions\.(next_achieved_goal|policy|step)`"):
        fresh(REWARDS[spec]).reward(bare)


@pytest.mark.parametrize("spec", ["rnd", "mi", "ngu"])
def test_an_agent_with_weight_zero_trains_as_without_the_method(spec):
    """A method without a term in the policy's loss changes the agent through its reward only."""
    config = SACConfig(hidden=16, tau=0.0)
    with_method, without = (make_agent(s, SMALL, config, torch.Generator().manual_seed(0)) for s in (spec, "sac"))
    for name in ("actor", "critics", "target_critics"):  # built after the method, so drawn from a later generator
        getattr(with_method.learner, name).load_state_dict(getattr(without.learner, name).state_dict())
    with_method.learner.generator.set_state(without.learner.generator.get_state())
    for k in range(4):
        for agent in (with_method, without):
            agent.update(random_batch(SMALL, 16, np.random.default_rng(k)))
    for name in ("actor", "critics"):
        assert same_state(with_method.state_dict()[name], without.state_dict()[name])


@pytest.mark.parametrize(("spec", "config"), [("rnd", {"learning_rate": 1e-3}), ("icm", {})])
def test_a_prediction_error_falls_where_it_has_been_and_less_elsewhere(spec, config):
    method, rng = fresh(REWARDS[spec], hidden=32, **config), np.random.default_rng(0)

    def around(centre: float) -> Transitions:
        state, action = centre + rng.normal(size=(64, 3)), rng.uniform(-1, 1, (64, 2))
        return transitions_of(state, action, state + 0.5 * np.hstack([action, action[:, :1] ** 2]))

    often, never = around(0), around(4)
    before = method.reward(often).mean()
    for _ in range(300):
        method.update(often)
    assert method.reward(often).mean() < 0.1 * before
    assert method.reward(never).mean() > 5 * method.reward(often).mean()


@pytest.mark.parametrize("spec", ["rnd", "re3", "mi", "re3+hm"])
@pytest.mark.parametrize("sees", SEEN)
def test_a_method_sees_only_the_columns_that_it_is_set_to(spec, sees):
    """Numbers in other columns change no reward; those in each of its own do."""
    layout, rng = layout_of(2), np.random.default_rng(0)
    settings = REWARDS[spec.partition("+")[0]].Config(sees=sees)
    agent = make_agent(spec, layout, SACConfig(hidden=16), torch.Generator().manual_seed(0), settings=settings)
    for _ in range(3):
        agent.update(random_batch(layout, 16, rng))
    curiosity = agent.learner.curiosity
    states, others = torch.from_numpy(rng.normal(size=(2, 16, layout.observation_size))).float()

    def rewards(states: torch.Tensor) -> torch.Tensor:
        seen = curiosity.visible(states)
        particles = curiosity.visible(others)
        return curiosity.method.reward(Transitions(seen, torch.zeros(16, 4), seen, 200, particles=particles))

    before = rewards(states)
    for column in range(layout.observation_size):
        changed = states.clone()
        changed[:, column] += torch.linspace(-1, 1, 16)
        assert torch.equal(rewards(changed), before) == (column not in SEEN[sees])


@every_method
def test_method_and_settings_are_described(spec):
    """The line in lists names the paper; the docstring under a field is the help of its flag."""
    config = REWARDS[spec].Config
    assert re.fullmatch(r"rewards [^()]+ \([A-Z].+ 20\d\d, (arXiv|doi) \S+\)", BUILT_IN[spec].line)
    assert inspect.getsource(config).count('"""') == 2 * (1 + len(fields(config)))
    with pytest.raises(FrozenInstanceError):
        config().hidden = 3


@pytest.mark.parametrize(("name", "config"), [("sac", SACConfig), ("hm", HybridConfig)])
def test_pages_of_agent_and_mechanism_give_the_defaults(name, config):
    settings = dict(SETTING.findall((PAGES / f"{name}.md").read_text()))
    assert settings == {field.name: str(field.default) for field in fields(config)}


@every_method
def test_page_gives_the_defaults_and_the_logged_names(spec):
    page = (PAGES / f"{spec}.md").read_text()
    settings = dict(SETTING.findall(page))
    assert settings == {field.name: str(field.default) for field in fields(REWARDS[spec].Config)}
    logged = set(re.findall(rf"^\| `({spec}_\w+)` \| [^|]+ \|$", page, re.MULTILINE))
    adapted = {"adapt_alpha": True} if spec == "dac" else {}
    assert logged == fresh(REWARDS[spec], **adapted).update(random_transitions()).keys()
    assert BUILT_IN[spec].line.split()[-1].rstrip(")") in page
