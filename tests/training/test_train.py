"""A run is a function of its config: repeated, stopped, killed or failed, on any number of threads."""

import os
import signal
from dataclasses import replace

import numpy as np
import pytest
import torch
from commands import TRAIN
from tiny_runs import TINY, numbers

from curiobench import checkpoint, training
from curiobench.config import MachineConfig
from curiobench.errors import RunFailed, StopRequest
from curiobench.evaluation import Evaluator, last_evaluation
from curiobench.files import read_json, write_json
from curiobench.run_folder import RunFolder, read_rows
from curiobench.saved_agent import load_agent
from curiobench.state import TrainingState
from curiobench.training import TrainingRun, train


class Killed(BaseException):
    """In place of kill -9: nothing in the program catches it."""


def test_repeats_itself_on_more_threads_with_a_memory_mapped_replay(finished, tmp_path):
    """Global random generators neither matter nor change."""
    np.random.seed(3)  # noqa: NPY002
    torch.manual_seed(3)
    before = torch.get_rng_state()
    machine = MachineConfig(threads=3, replay_on_disk=True, checkpoint_every=2)
    train(replace(TINY, machine=machine), tmp_path / "threads")
    assert numbers(tmp_path / "threads") == numbers(finished)
    assert torch.equal(torch.get_rng_state(), before)


def test_other_seed_gives_other_numbers(finished, tmp_path):
    train(replace(TINY, seed=1), tmp_path / "seed")
    assert numbers(tmp_path / "seed") != numbers(finished)


def test_leaves_rows_result_and_picture(finished):
    progress, evaluations = read_rows(finished / "progress.csv"), read_rows(finished / "evaluations.csv")
    assert [row["epoch"] for row in progress] == ["1", "2", "3"]
    assert [row["success"] == "" for row in progress] == [True, False, False]
    assert [row["epoch"] for row in evaluations[::4]] == ["0", "2", "3"]
    steps = TINY.epochs * TINY.cycles * TINY.worlds * 50
    assert int(progress[-1]["steps"]) == read_json(finished / "result.json")["steps"] == steps
    assert (finished / "learning_curve.png").read_bytes().startswith(b"\x89PNG")
    assert not (finished / "checkpoint" / "replay").exists()


@pytest.mark.parametrize("kind", [MemoryError, RuntimeError])  # of NumPy, of torch
def test_a_run_that_cannot_begin_leaves_nothing(tmp_path, monkeypatch, kind):
    def no_memory(*arguments):
        raise kind("Unable to allocate 1 TiB")

    monkeypatch.setattr(training, "TrainingState", no_memory)
    with pytest.raises(ValueError, match=r"cannot begin .*1 TiB"):
        train(TINY, tmp_path / "deep" / "run")
    assert [*tmp_path.rglob("*")] == [tmp_path / "deep"]


def test_a_folder_of_other_files_is_refused_and_kept(tmp_path):
    (tmp_path / "replay").mkdir()
    (tmp_path / "replay" / "mine.npy").write_text("mine")
    with pytest.raises(ValueError, match="holds 'replay'"):
        train(TINY, tmp_path)
    assert [*tmp_path.rglob("*")] == [tmp_path / "replay", tmp_path / "replay" / "mine.npy"]


def test_a_device_that_is_not_there_is_refused_before_anything_is_made(tmp_path):
    with pytest.raises(ValueError, match="device 'cuda:99' is not available"):
        train(replace(TINY, device="cuda:99"), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_picture_that_cannot_be_drawn_costs_no_result(tmp_path, monkeypatch, capsys):
    def no_matplotlib(*arguments):
        raise ValueError("'nonsense' is not a valid value for backend")

    monkeypatch.setattr(training, "draw_learning_curve", no_matplotlib)
    train(TINY, tmp_path / "run")
    assert (tmp_path / "run" / "result.json").exists()
    assert "learning curve: not drawn: ValueError: 'nonsense' is not a valid" in capsys.readouterr().out


@pytest.mark.parametrize("between", [7, 11])
def test_killed_at_any_write_and_resumed_gives_the_same(finished, tmp_path, monkeypatch, between):
    """Killed again and again in the middle of a write, each time a few writes later than before."""
    path, fsync, calls, kills = tmp_path / "killed", os.fsync, 0, 0

    def count_and_die(descriptor):
        nonlocal calls
        calls += 1
        if calls == between + 2 * kills:
            raise Killed
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", count_and_die)
    while not (path / "result.json").exists():
        calls = 0
        try:
            train(TINY, path, resume=True)
        except Killed:
            kills += 1
    assert kills >= 2
    assert numbers(path) == numbers(finished)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_stops_at_a_signal_within_an_epoch(cli, finished, tmp_path, monkeypatch, number, code):
    learn, learned, run = TrainingState.learn, 0, ("--out", tmp_path / "run")

    def learn_and_signal(self):
        nonlocal learned
        learn(self)
        learned += 1
        if learned == 3:
            os.kill(os.getpid(), number)

    monkeypatch.setattr(TrainingState, "learn", learn_and_signal)
    ended, _, err = cli(*TRAIN, *run)
    line = f"curiobench: stopped in epoch 2 after a checkpoint; continue {tmp_path / 'run'} with --resume\n"
    assert (ended, err) == (code, line)
    assert cli(*TRAIN, *run, "--resume")[0] == 0
    assert numbers(tmp_path / "run") == numbers(finished)


def test_a_second_signal_does_what_it_did_before_or_is_counted():
    reached = []
    before = signal.signal(signal.SIGINT, lambda *_: reached.append("the former handler"))
    try:
        with StopRequest(once=True) as stop:
            signal.raise_signal(signal.SIGINT)
            assert (stop.count, stop.number, reached) == (1, signal.SIGINT, [])
            signal.raise_signal(signal.SIGINT)
            assert (stop.count, reached) == (1, ["the former handler"])
        with StopRequest() as stop:
            signal.raise_signal(signal.SIGTERM)
            signal.raise_signal(signal.SIGINT)
        assert (stop.count, stop.number, len(reached)) == (2, signal.SIGTERM, 1)
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_loss_that_is_not_finite_stops_the_run(tmp_path, monkeypatch):
    learn = TrainingState.learn

    def poison(self):
        if self.counters.epoch == 1:
            next(self.agent.learner.critics.parameters()).data.fill_(float("nan"))
        learn(self)

    monkeypatch.setattr(TrainingState, "learn", poison)
    with pytest.raises(RunFailed, match=r"epoch 2, cycle 1: .*critics.*nan.*; the last checkpoint is kept"):
        train(TINY, tmp_path / "run")
    assert "Traceback" in (tmp_path / "run" / "error.log").read_text()
    agent, values = checkpoint.load(tmp_path / "run" / "checkpoint", TINY.fingerprint())
    assert values["counters"]["epoch"] == 1
    assert all(torch.isfinite(weights).all() for weights in agent["critics"].values())


def test_a_full_disk_fails_the_run_which_resumes_when_there_is_space(finished, tmp_path, monkeypatch):
    save, saves = TrainingRun._save, 0

    def save_on_full_disk(self):
        nonlocal saves
        saves += 1
        if saves == 2:
            raise OSError(28, "No space left on device")
        save(self)

    monkeypatch.setattr(TrainingRun, "_save", save_on_full_disk)
    with pytest.raises(RunFailed, match="No space left on device; the last checkpoint is kept"):
        train(TINY, tmp_path / "run")
    train(TINY, tmp_path / "run", resume=True)
    assert numbers(tmp_path / "run") == numbers(finished)


def test_other_versions_are_named(tmp_path, capsys):
    RunFolder(tmp_path, TINY, resume=False).close()
    record = read_json(tmp_path / "config.json")
    record["versions"]["torch"] = "1.0"
    del record["versions"]["numba"]  # as in runs of before it was recorded
    write_json(tmp_path / "config.json", record)
    train(TINY, tmp_path, resume=True)
    assert f"numbers may differ: torch {torch.__version__}, was 1.0\n" in capsys.readouterr().out


def test_an_agent_from_a_folder_acts_as_in_the_run(finished, tmp_path):
    config, agent = load_agent(finished)
    assert config == TINY
    rows = Evaluator(config.task, config.robot, config.episodes_per_goal).evaluate(agent).rows()
    assert [str(row["success"]) for row in rows] == [
        row["success"] for row in last_evaluation(read_rows(finished / "evaluations.csv"))
    ]
