"""Each kind of method trains in a run, which repeats itself also when it is stopped and resumed.

test_train.py has runs without a method.
"""

import os
import signal
from dataclasses import replace

import pytest
from tiny_runs import TINY, numbers

from curiobench.errors import Interrupted
from curiobench.methods.guard import TAKEN
from curiobench.saved_agent import load_agent
from curiobench.state import TrainingState
from curiobench.training import train

SPECS = {
    "dac+hm": "sees the policy, under the hybrid mechanism",
    "mi": "sees particles",
    "re3+hm": "a bonus factor by epoch, under the hybrid mechanism",
    "ngu": "sees whole episodes",
    "counts": "counts what is collected",
    "decstr": "a curriculum",
    "mcher": "a relabelling",
}
UPDATES = 120


@pytest.mark.parametrize("spec", SPECS)
def test_repeats_itself_and_resumes_to_the_bit(tmp_path, monkeypatch, spec):
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
    assert own <= TAKEN  # which no other method may use for its metrics
    assert int(rows[-1]["updates"]) == UPDATES
    assert (rows, evaluations) == numbers(tmp_path / "stopped")
    assert load_agent(tmp_path / "stopped")[0] == config
