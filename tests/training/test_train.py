"""A run is a function of its config: repeated, stopped, killed or failed, on any number of threads."""

import os
import signal
from dataclasses import replace

import numpy as np
import pytest
import torch
from tiny_runs import TINY, numbers

from curiobench import checkpoint, training
from curiobench.config import MachineConfig
from curiobench.errors import Interrupted, RunFailed, StopRequest
from curiobench.evaluation import Evaluator, last_evaluation
from curiobench.files import read_json, write_json
from curiobench.replay import EpisodeReplay
from curiobench.run_folder import RunFolder, read_rows
from curiobench.saved_agent import load_agent
from curiobench.state import TrainingState
from curiobench.training import Run, train


class Killed(BaseException):
    """Stands for kill -9: nothing in the program catches it."""


def test_trains_twice_alike_and_leaves_global_generators_alone(finished, tmp_path):
    np.random.seed(3)  # noqa: NPY002 - the global one is what must not matter
    torch.manual_seed(3)
    before = torch.get_rng_state()
    train(TINY, tmp_path / "again")
    assert numbers(tmp_path / "again") == numbers(finished)
    assert torch.equal(torch.get_rng_state(), before)


def test_threads_and_memory_mapped_replay_change_no_number(finished, tmp_path):
    machine = MachineConfig(threads=3, replay_on_disk=True, checkpoint_every=2)
    train(replace(TINY, machine=machine), tmp_path / "threads")
    assert numbers(tmp_path / "threads") == numbers(finished)


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


@pytest.mark.parametrize("there", [False, True], ids=["new folder", "folder of a user's files"])
def test_a_refused_run_leaves_nothing_and_takes_nothing(tmp_path, monkeypatch, there):
    def no_memory(*arguments):
        raise MemoryError("Unable to allocate 1 TiB")

    path = tmp_path / "deep" / "run"
    if there:
        (path / "replay").mkdir(parents=True)
        (path / "replay" / "mine.npy").write_text("mine")
    else:
        monkeypatch.setattr(training, "TrainingState", no_memory)
    with pytest.raises(ValueError, match="holds 'replay'" if there else "cannot begin .*1 TiB"):
        train(TINY, path)
    assert sorted(tmp_path.rglob("*")) == (
        [path.parent, path, path / "replay", path / "replay" / "mine.npy"] if there else [path.parent]
    )


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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_stops_at_a_signal_within_an_epoch(finished, tmp_path, monkeypatch, number):
    learn, learned = TrainingState.learn, 0

    def learn_and_signal(self):
        nonlocal learned
        learn(self)
        learned += 1
        if learned == 3:
            os.kill(os.getpid(), number)

    monkeypatch.setattr(TrainingState, "learn", learn_and_signal)
    with pytest.raises(Interrupted, match=r"stopped in epoch 2 .* --resume") as stopped:
        train(TINY, tmp_path / "run")
    assert stopped.value.signal_number == number
    train(TINY, tmp_path / "run", resume=True)
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
    save, saves = Run._save, 0

    def save_on_full_disk(self):
        nonlocal saves
        saves += 1
        if saves == 2:
            raise OSError(28, "No space left on device")
        save(self)

    monkeypatch.setattr(Run, "_save", save_on_full_disk)
    with pytest.raises(RunFailed, match="No space left on device; the last checkpoint is kept"):
        train(TINY, tmp_path / "run")
    train(TINY, tmp_path / "run", resume=True)
    assert numbers(tmp_path / "run") == numbers(finished)


def test_what_cannot_begin_is_bad_input(tmp_path, monkeypatch):
    def no_memory(self, *arguments, **options):
        raise MemoryError("Unable to allocate 9 PiB")

    monkeypatch.setattr(EpisodeReplay, "__init__", no_memory)
    with pytest.raises(ValueError, match=r"cannot begin .*Unable to allocate"):
        train(TINY, tmp_path / "run")
    with pytest.raises(ValueError, match="device 'cuda:99' is not available"):
        train(replace(TINY, device="cuda:99"), tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_other_versions_are_said(tmp_path, capsys):
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
