"""What holds for every curiosity method of the registry, alone and inside SAC."""

import inspect
import io
import re
from dataclasses import FrozenInstanceError, fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from curiosity import collected, fresh, random_transitions
from layouts import SMALL, layout_of
from test_sac import random_batch, same_state

from curiobench.methods.agents.sac import SAC
from curiobench.methods.agents.settings import HybridConfig, SACConfig
from curiobench.methods.registry import REWARDS, make_agent
from curiobench.methods.reward import Transitions
from curiobench.methods.specs import BUILT_IN

every_method = pytest.mark.parametrize("spec", REWARDS)


def trained(spec: str, seed: int = 0):
    """A method after three batches."""
    method = fresh(REWARDS[spec], seed)
    for k in range(3):
        method.observe(collected(10 + k))
        method.update(random_transitions(seed=10 + k))
    return method


@every_method
def test_reward_is_raw_finite_and_without_gradients(spec):
    reward = trained(spec).reward(random_transitions())
    assert reward.shape == (8,)
    assert reward.dtype == torch.float32
    assert reward.isfinite().all()
    assert not reward.requires_grad
    assert reward.std() > 0


@pytest.mark.parametrize("spec", ["counts", "dac", "e3b", "ngu", "ride"])
def test_a_part_that_a_method_needs_and_is_not_given_is_named(spec):
    bare = replace(random_transitions(), next_achieved_goal=None, step=None, policy=None)
    with pytest.raises(ValueError, match=r"needs `Transitions\.(next_achieved_goal|policy|step)`"):
        trained(spec).reward(bare)


@every_method
def test_reward_changes_nothing(spec):
    method, batch = trained(spec), random_transitions()
    before, first = method.state_dict(), method.reward(batch)
    method.reward(random_transitions(seed=5))
    assert torch.equal(method.reward(batch), first)
    assert same_state(method.state_dict(), before)


@every_method
def test_update_gives_scalars_and_learns_nothing_but_its_own_networks(spec):
    method, batch = trained(spec), random_transitions()
    leaves = [batch.state, batch.action, batch.next_state]
    for leaf in leaves:
        leaf.requires_grad_()
    metrics = method.update(batch)
    method.reward(batch)
    assert all(leaf.grad is None for leaf in leaves)
    assert all(value.shape == () and not value.requires_grad for value in metrics.values())
    assert all(np.isfinite(float(value)) for value in metrics.values())


@every_method
def test_saved_method_continues_to_the_bit(spec):
    first, second = trained(spec), fresh(REWARDS[spec], seed=1)
    file = io.BytesIO()
    torch.save(first.state_dict(), file)
    file.seek(0)
    second.load_state_dict(torch.load(file, weights_only=True))
    for k in range(3):
        batch = random_transitions(seed=20 + k)
        assert torch.equal(first.reward(batch), second.reward(batch))
        assert same_state(first.update(batch), second.update(batch))
    assert same_state(first.state_dict(), second.state_dict())


@every_method
def test_saved_state_is_a_copy(spec):
    method = trained(spec)
    state = method.state_dict()
    other = fresh(REWARDS[spec], seed=1)
    other.load_state_dict(state)
    before = other.state_dict()
    method.update(random_transitions())
    other.update(random_transitions())
    assert same_state(state, before)


@every_method
def test_all_randomness_comes_from_the_generator(spec):
    torch.manual_seed(0)
    before = torch.get_rng_state()
    first = trained(spec).state_dict()
    assert torch.equal(torch.get_rng_state(), before)
    torch.manual_seed(1)
    assert same_state(trained(spec).state_dict(), first)
    has_networks = any(isinstance(part, torch.nn.Module) for part in vars(fresh(REWARDS[spec])).values())
    assert same_state(trained(spec, seed=1).state_dict(), first) is not has_networks


@every_method
def test_goals_matter_to_those_that_use_the_policy_alone(spec):
    method, batch = trained(spec), random_transitions()
    relabelled = replace(batch, policy=replace(batch.policy, desired_goal=1 - batch.policy.desired_goal))
    unchanged = torch.equal(method.reward(batch), method.reward(relabelled))
    assert unchanged is not method.uses_policy


@every_method
def test_method_and_settings_are_described(spec):
    cls = REWARDS[spec]
    assert re.fullmatch(r"rewards [^()]+ \([A-Z].+ 20\d\d, (arXiv|doi) \S+\)", BUILT_IN[spec].line)
    assert is_dataclass(cls.Config)
    with pytest.raises(FrozenInstanceError):
        cls.Config().hidden = 3


def agent_of(spec: str, seed: int = 0) -> SAC:
    return make_agent(spec, SMALL, SACConfig(hidden=16), torch.Generator().manual_seed(seed))


def train(agent: SAC, batches: range) -> list[dict]:
    return [
        {name: float(value) for name, value in agent.update(batch, epoch=k // 3).items()}
        for k, batch in ((k, random_batch(SMALL, 16, np.random.default_rng(k))) for k in batches)
    ]


@every_method
def test_agent_trains_twice_equal_and_resumes_equal(spec):
    first, second = agent_of(spec), agent_of(spec)
    metrics = train(first, range(12))
    assert metrics == train(second, range(12))
    assert same_state(first.state_dict(), second.state_dict())
    assert all(np.isfinite(list(row.values())).all() for row in metrics)
    assert {"intrinsic_raw", "intrinsic_normalised"} < metrics[0].keys()
    halfway, resumed = agent_of(spec), agent_of(spec, seed=1)
    train(halfway, range(6))
    file = io.BytesIO()
    torch.save(halfway.state_dict(), file)
    file.seek(0)
    resumed.load_state_dict(torch.load(file, weights_only=True))
    assert train(resumed, range(6, 12)) == metrics[6:]
    assert same_state(resumed.state_dict(), first.state_dict())


@pytest.mark.parametrize("spec", [spec for spec, cls in REWARDS.items() if not cls.uses_policy])
def test_agent_with_weight_zero_trains_as_without_the_method(spec):
    """The method leaks into the agent through its reward alone. (DAC also has its term in the policy's loss.)"""
    config = SACConfig(hidden=16, tau=0.0)
    with_method, without = (make_agent(s, SMALL, config, torch.Generator().manual_seed(0)) for s in (spec, "sac"))
    for name in ("actor", "critics", "target_critics"):  # built after the method, so drawn from a later generator
        getattr(with_method.learner, name).load_state_dict(getattr(without.learner, name).state_dict())
    with_method.learner.generator.set_state(without.learner.generator.get_state())
    train(with_method, range(4))
    train(without, range(4))
    for name in ("actor", "critics"):
        assert same_state(with_method.state_dict()[name], without.state_dict()[name])


def test_every_field_has_its_docstring():
    """The docstring under a field is the command line's help."""
    for cls in REWARDS.values():
        source = inspect.getsource(cls.Config)
        assert source.count('"""') == 2 * (1 + len(fields(cls.Config)))


PAGES = Path(__file__).parents[2] / "docs" / "methods"
SETTING = re.compile(r"^\| `(\w+)` \| ([^|]+) \| [^|]+ \|$", re.MULTILINE)


@pytest.mark.parametrize(("name", "config"), [("sac", SACConfig), ("hm", HybridConfig)])
def test_pages_of_agent_and_mechanism_give_the_defaults(name, config):
    settings = dict(SETTING.findall((PAGES / f"{name}.md").read_text()))
    assert settings == {field.name: str(field.default) for field in fields(config)}


@every_method
def test_page_gives_the_defaults_and_the_logged_names(spec):
    """The tables of docs/methods cannot fall behind the code."""
    page = (PAGES / f"{spec}.md").read_text()
    settings = dict(SETTING.findall(page))
    assert settings == {field.name: str(field.default) for field in fields(REWARDS[spec].Config)}
    logged = set(re.findall(rf"^\| `({spec}_\w+)` \| [^|]+ \|$", page, re.MULTILINE))
    adapted = {"adapt_alpha": True} if spec == "dac" else {}
    assert logged == fresh(REWARDS[spec], **adapted).update(random_transitions()).keys()
    assert BUILT_IN[spec].line.split()[-1].rstrip(")") in page


SEEN = {"positions": [0, 1, 2, 10, 11, 12, 25, 26, 27], "blocks": [10, 11, 12, 25, 26, 27]}
"""Columns of a stack2 observation."""


@pytest.mark.parametrize("spec", ["rnd", "re3", "mi", "re3+hm"])
@pytest.mark.parametrize("sees", SEEN)
def test_a_method_sees_nothing_but_what_it_is_set_to(spec, sees):
    """Numbers in other columns change no reward; those in each of its own do."""
    layout, rng = layout_of(2), np.random.default_rng(0)
    settings = REWARDS[spec.partition("+")[0]].Config(sees=sees)
    agent = make_agent(spec, layout, SACConfig(hidden=16), torch.Generator().manual_seed(0), settings=settings)
    for _ in range(3):
        agent.update(random_batch(layout, 16, rng))

    def rewards(states: torch.Tensor) -> torch.Tensor:
        seen = agent.learner.curiosity.visible(states)
        return agent.learner.curiosity.method.reward(
            Transitions(seen, torch.zeros(16, 4), seen, 200, particles=agent.learner.curiosity.visible(others))
        )

    states, others = torch.from_numpy(rng.normal(size=(2, 16, layout.observation_size))).float()
    before = rewards(states)
    for column in range(layout.observation_size):
        changed = states.clone()
        changed[:, column] += torch.linspace(-1, 1, 16)
        assert torch.equal(rewards(changed), before) == (column not in SEEN[sees])
