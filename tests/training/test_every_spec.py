"""Each spec trains in the harness: twice alike, and alike when it is stopped and resumed."""

import os
import signal
from dataclasses import replace

import pytest
from tiny_runs import TINY, numbers

from curiobench.errors import Interrupted
from curiobench.methods.guard import TAKEN
from curiobench.methods.registry import GOAL_METHODS, REWARDS
from curiobench.methods.specs import HYBRID
from curiobench.saved_agent import load_agent
from curiobench.state import TrainingState
from curiobench.training import train

OF_THE_PAPER = ("icm", "rnd", "dac", "re3", "mi")
SPECS = ["sac", *REWARDS, *GOAL_METHODS, *(method + HYBRID for method in OF_THE_PAPER)]
UPDATES = 300


@pytest.mark.parametrize("spec", SPECS)
def test_trains_three_hundred_updates_twice_alike_and_resumes_alike(tmp_path, monkeypatch, spec):
    config = replace(TINY, method=spec, method_config=None, updates=UPDATES // (TINY.epochs * TINY.cycles))
    train(config, tmp_path / "once")
    learn, calls = TrainingState.learn, 0

    def learn_and_stop_once(state):
        nonlocal calls
        calls += 1
        learn(state)
        if calls == 3:
            os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(TrainingState, "learn", learn_and_stop_once)
    with pytest.raises(Interrupted):
        train(config, tmp_path / "stopped")
    train(config, tmp_path / "stopped", resume=True)
    rows, evaluations = numbers(tmp_path / "once")
    own = {name for name in rows[0] if not name.startswith(f"{spec.partition('+')[0]}_")}
    assert own <= TAKEN  # which no method from outside may use for its metrics
    assert int(rows[-1]["updates"]) == UPDATES
    assert (rows, evaluations) == numbers(tmp_path / "stopped")
    assert load_agent(tmp_path / "stopped")[0] == config
