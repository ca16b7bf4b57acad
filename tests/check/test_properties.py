"""`curiobench check`: built-in methods keep every rule, and one that breaks a rule fails that line and no other."""

import random
import re

import numpy as np
import pytest
import torch
from curiosity import REWARDS
from torch.nn.modules.module import register_module_forward_hook

from curiobench.build import pair_layout
from curiobench.check import properties
from curiobench.check.properties import PROPERTIES, cost, examine
from curiobench.check.subject import Subject
from curiobench.check.template import NewMethod
from curiobench.tasks.goals import goal_space


@pytest.fixture(autouse=True)
def in_a_hurry(monkeypatch):
    monkeypatch.setattr(properties, "ROUNDS", 2)
    monkeypatch.setattr(properties, "TIMED_BATCH", 32)
    torch.set_num_threads(1)


def failures(method) -> dict[str, str]:
    return {finding.property: finding.detail for finding in examine(method) if finding.verdict == "FAIL"}


@pytest.mark.parametrize("spec", REWARDS)
def test_built_in_methods_pass(spec):
    *findings, _ = examine(REWARDS[spec])  # the last is the cost
    skipped = {finding.property for finding in findings if finding.verdict != "pass"}
    term = "term in the policy's loss is finite and (B,)"
    assert skipped == ({"unchanged when the goal is relabelled"} if spec == "dac" else {term})


class Column(NewMethod):
    def reward(self, transitions):
        return super().reward(transitions)[:, None]


class Double(NewMethod):
    def reward(self, transitions):
        return super().reward(transitions).double()


class NotANumber(NewMethod):
    def reward(self, transitions):
        reward = super().reward(transitions)
        reward[3] = torch.nan
        return reward


class WithGradients(NewMethod):
    def reward(self, transitions):
        return self.error(transitions)


class Learning(NewMethod):
    """Its reward learns."""

    def reward(self, transitions):
        reward = super().reward(transitions)
        with torch.enable_grad():
            self.update(transitions)
        return reward


class Graph(NewMethod):
    def update(self, transitions):
        return super().update(transitions) | {"graph": self.error(transitions).mean()}


class InPlace(NewMethod):
    def update(self, transitions):
        metrics = super().update(transitions)
        transitions.state.clamp_(-1, 1)
        return metrics


class Leaking(NewMethod):
    def policy_loss_term(self, transitions, desired_goal, action):
        if action.requires_grad:
            action.sum().backward(retain_graph=True)


class HoldingASet(NewMethod):
    def state_dict(self):
        return super().state_dict() | {"visited": {1, 2}}


class Forgetful(NewMethod):
    """Its optimiser is not saved."""

    _STATEFUL = ("model",)


class OwnSeed(NewMethod):
    def __init__(self, state_size, action_size, config, generator):
        super().__init__(state_size, action_size, config, torch.Generator().manual_seed(next(SEEDS)))


class GlobalSeed(NewMethod):
    def __init__(self, state_size, action_size, config, generator):
        super().__init__(state_size, action_size, config, generator)
        self.model[0].bias.data.fill_(np.random.rand() + random.random())  # noqa: NPY002 - the mistake


class GoalAware(NewMethod):
    def reward(self, transitions):
        reward = super().reward(transitions)
        return reward if transitions.policy is None else reward + transitions.policy.desired_goal.sum(1)


class Watching(NewMethod):
    """Counts how often the agent's actor is asked, whoever asks."""

    def __init__(self, state_size, action_size, config, generator):
        super().__init__(state_size, action_size, config, generator)
        self.asked = 0
        HOOKS.append(register_module_forward_hook(self._count))

    def _count(self, module, inputs, outputs):
        self.asked += type(module).__name__ == "Actor"

    def state_dict(self):
        return super().state_dict() | {"asked": self.asked}

    def load_state_dict(self, state):
        super().load_state_dict(state)
        self.asked = state["asked"]


class TwoBlocksOnly(NewMethod):
    def reward(self, transitions):
        return super().reward(transitions) + 0 * transitions.state @ torch.ones(40)


class Endless(NewMethod):
    def policy_loss_term(self, transitions, desired_goal, action):
        return action.sum(1) * torch.inf


class LogOfNearest(NewMethod):
    """Fails on batches in which a state is there twice, which noise never shows."""

    def reward(self, transitions):
        distances = torch.cdist(transitions.next_state, transitions.next_state) + torch.eye(len(transitions.state)) * 99
        return distances.min(1).values.log()


SEEDS = iter(range(10**6))
HOOKS = []


@pytest.mark.parametrize(
    ("method", "broken", "message"),
    [
        (Column, "reward has shape (B,)", "expected (64,), found (64, 1)"),
        (Double, "reward is float32", "expected torch.float32, found torch.float64"),
        (NotANumber, "reward is finite", "expected finite numbers, found [nan] among 64"),
        (WithGradients, "reward carries no gradients", "put @torch.no_grad() above reward"),
        (Learning, "reward changes nothing in the method", "expected the same reward when asked again"),
        (Graph, "update returns finite scalars", "graph = a torch.float32 tensor of shape () that carries gradients"),
        (InPlace, "batch is left as it is", "found altered in place: state"),
        (Leaking, "no gradient leaks into the agent", "expected no gradient in the agent's weights, found one in"),
        (Endless, "term in the policy's loss is finite and (B,)", "inf in 64 of 64 transitions"),
        (HoldingASet, "state holds tensors and plain values", "state['visited'] = a set"),
        (Forgetful, "state round-trips to the bit", "expected training to continue to the bit"),
        (OwnSeed, "deterministic under its generator", "expected equal numbers from generators with equal seeds"),
        (GlobalSeed, "global random state is left alone", "found the global one of numpy, random was used"),
        (GoalAware, "unchanged when the goal is relabelled", "found it changes with the goal"),
        (Watching, "does not train while evaluating", "expected the same state after the agent has only acted"),
        (TwoBlocksOnly, "takes 2 and 3 blocks, and other batches", "expected no error, found RuntimeError"),
    ],
)
def test_a_method_that_breaks_a_rule_fails_that_line_alone(method, broken, message):
    try:
        found = failures(method)
    finally:
        while HOOKS:
            HOOKS.pop().remove()
    assert found.keys() == {broken}
    assert message in found[broken]


def test_repeated_transitions_are_tried():
    message = failures(LogOfNearest)["reward is finite"]
    assert re.search(r"found \[-inf\] among 64, transitions of which every other is repeated", message)


def test_every_rule_has_a_method_that_breaks_it():
    (cases,) = (mark for mark in test_a_method_that_breaks_a_rule_fails_that_line_alone.pytestmark)
    assert [broken for _, broken, _ in cases.args[1]] == [*PROPERTIES]


def test_a_method_that_does_not_run_is_not_examined_further():
    class Raising(NewMethod):
        def update(self, transitions):
            raise KeyError("blocks")

    first, *others = examine(Raising)
    assert str(first) == "FAIL  is built, rewards and learns\n      expected no error, found KeyError: 'blocks'"
    assert {finding.verdict for finding in others} == {"skip"}
    assert len(others) == len(PROPERTIES) + 1


def test_a_costly_method_gets_a_warning():
    class Costly(NewMethod):
        def update(self, transitions):
            for _ in range(60):
                metrics = super().update(transitions)
            return metrics

    assert cost(Subject(Costly, pair_layout(goal_space(2)))).verdict == "warn"


def test_examining_leaves_global_random_state_alone():
    before = torch.get_rng_state(), np.random.get_state()[1].tolist(), random.getstate()  # noqa: NPY002
    examine(GlobalSeed)
    assert torch.equal(torch.get_rng_state(), before[0])
    assert (np.random.get_state()[1].tolist(), random.getstate()) == before[1:]  # noqa: NPY002
