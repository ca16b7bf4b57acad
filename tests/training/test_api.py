"""Runs from Python."""

import shutil
from concurrent.futures import ThreadPoolExecutor

import gymnasium as gym
import numpy as np
import pytest

import curiobench

TINY_OPTIONS = {
    **{"epochs": 2, "cycles": 1, "worlds": 4, "updates": 2, "batch-size": 16, "episodes_per_goal": 1},
    **{"replay.capacity": 18, "sac.hidden": 8, "sac.layer-norm": False, "replay.satisfied_cap": None},
}


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> curiobench.Run:
    out = tmp_path_factory.mktemp("api") / "run"
    return curiobench.train("stack2", "rnd", "smoke", seed=3, out=out, options={**TINY_OPTIONS, "method.hidden": 9})


def test_a_run_has_its_config_its_rows_and_its_result(run):
    assert (run.config.task, run.config.seed, run.config.sac.layer_norm) == ("stack2", 3, False)
    assert (run.config.method_config.hidden, run.config.replay.satisfied_cap) == (9, None)
    assert run.progress["epoch"].tolist() == [1, 2]
    assert set(run.evaluations["bits"]) == {"000", "100", "110", "101"}
    assert run.result["epochs"] == 2
    again = curiobench.load_run(run.path)
    assert again.progress.equals(run.progress)


def test_a_run_can_be_trained_in_a_thread(run, tmp_path):
    options = {**TINY_OPTIONS, "method.hidden": 9}
    with ThreadPoolExecutor(1) as pool:
        job = pool.submit(curiobench.train, "stack2", "rnd", "smoke", 3, out=tmp_path / "run", options=options)
        assert job.result().evaluations.equals(run.evaluations)


def test_a_run_without_rows_has_empty_frames(run, tmp_path):
    shutil.copy(run.path / "config.json", tmp_path)
    assert curiobench.load_run(tmp_path).progress.empty
    assert curiobench.load_run(tmp_path).evaluations.empty


def test_an_agent_predicts_for_one_and_for_many(run):
    agent = run.agent()
    environment = gym.make("curiobench/SemanticStack2-v0")
    seen, _ = environment.reset(seed=0)
    one, state = agent.predict(seen)
    assert state is None
    assert environment.action_space.contains(one)
    many, _ = curiobench.load_agent(run.path).predict({name: np.stack([part, part]) for name, part in seen.items()})
    np.testing.assert_allclose(many, [one, one], atol=1e-6)
    assert not np.array_equal(agent.predict(seen, deterministic=False)[0], one)
    with pytest.raises(ValueError, match="lacks 'desired_goal'"):
        agent.predict({name: seen[name] for name in ("observation", "achieved_goal")})
    with pytest.raises(ValueError, match=r"observation has shape \(7,\); expected \(40,\)"):
        agent.predict(seen | {"observation": np.zeros(7)})
    with pytest.raises(ValueError, match="observation has a number that is not finite"):
        agent.predict(seen | {"observation": np.full(40, np.nan)})


def test_wrong_input_is_refused_before_anything_is_made(tmp_path):
    with pytest.raises(ValueError, match=r"sac\.gama"):
        curiobench.train("stack2", out=tmp_path / "run", options={"sac.gama": 0.9})
    with pytest.raises(ValueError, match="unknown task 'stack9'"):
        curiobench.train("stack9", out=tmp_path / "run")
    with pytest.raises(ValueError, match="help is not an option"):
        curiobench.train("stack2", out=tmp_path / "run", options={"help": True})
    assert not (tmp_path / "run").exists()
    with pytest.raises(ValueError, match=r"run"):
        curiobench.load_run(tmp_path / "run")
