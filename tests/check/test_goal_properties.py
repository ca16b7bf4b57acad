"""`curiobench check` of curricula and relabellings: built-in ones pass, and one that breaks a rule fails that line."""

import numpy as np
import pytest

from curiobench.check.goal_properties import examine_goals
from curiobench.curriculum import CURRICULA
from curiobench.methods.decstr import DECSTR
from curiobench.methods.mcher import MultiCriteriaHER


def failures(method) -> dict[str, str]:
    return {finding.property: finding.detail for finding in examine_goals(method) if finding.verdict == "FAIL"}


@pytest.mark.parametrize("method", [DECSTR, MultiCriteriaHER, *CURRICULA.values()])
def test_built_in_methods_pass(method):
    assert failures(method) == {}


class Beyond(DECSTR):
    def draw(self, situation, generator):
        goals, tested = super().draw(situation, generator)
        return goals + len(self.goals.bits), tested


class Global(DECSTR):
    def draw(self, situation, generator):
        return np.random.randint(len(self.goals.bits), size=len(situation.start)), np.zeros(len(situation.start), bool)  # noqa: NPY002


class Negative(DECSTR):
    def replay_weights(self):
        return super().replay_weights() - 1


class Forgetful(DECSTR):
    def load_state_dict(self, state):
        pass


class Writes(DECSTR):
    def draw(self, situation, generator):
        situation.start[:] = 0
        return super().draw(situation, generator)


class Nameless(DECSTR):
    def metrics(self):
        return super().metrics() if any(self.tests) else {}


class Late(MultiCriteriaHER):
    def draw(self, replay, size, generator):
        slot, step, desired = super().draw(replay, size, generator)
        return slot, step + 1, desired


class InPlace(MultiCriteriaHER):
    def draw(self, replay, size, generator):
        replay.arrays["achieved_goal"][:] = 0
        return super().draw(replay, size, generator)


@pytest.mark.parametrize(
    ("method", "line", "detail"),
    [
        (Beyond, "draws a goal an episode", "expected 0 to 3"),
        (Global, "global random state is left alone", "numpy"),
        (Negative, "replay weights are legal", "at least 0"),
        (Forgetful, "state round-trips through JSON", "go on alike"),
        (Writes, "situation is left as it is", "start"),
        (Nameless, "metrics are finite, and the same each time", r"the same metrics"),
        (Late, "draws slots, steps and goals", "expected 0 to 11"),
        (InPlace, "replay is left as it is", "achieved_goal"),
    ],
)
def test_a_broken_rule_fails_its_line(method, line, detail):
    assert detail in failures(method)[line]
