"""Rows in trackers: whole, in one run after a resume, and nothing of it in the run itself."""

import signal
import sys
from dataclasses import replace

import pytest
from commands import wait_for
from tiny_runs import TINY, numbers

from curiobench import checkpoint, trackers
from curiobench.check.subject import same as same_state
from curiobench.config import MachineConfig, RunConfig
from curiobench.run_folder import CHECKPOINT
from curiobench.training import train


def tracked(name: str | None) -> RunConfig:
    return replace(TINY, machine=MachineConfig(track=name, keep_replay=True))


def train_in_two_parts(config, folder):
    """The first ends between the row of epoch 2 and its checkpoint."""
    save = checkpoint.save

    def once(*arguments):
        checkpoint.save = end
        save(*arguments)

    def end(*arguments):
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checkpoint, "save", once)
        with pytest.raises(KeyboardInterrupt):
            train(config, folder)
    train(config, folder, resume=True)


@pytest.fixture(scope="module")
def untracked(tmp_path_factory):
    folder = tmp_path_factory.mktemp("untracked") / "run"
    train_in_two_parts(tracked(None), folder)
    return folder


def read_tensorboard(folder):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator  # seconds to import

    events = EventAccumulator(str(folder / "tensorboard")).Reload()
    return {name: [event.step for event in events.Scalars(name)] for name in ("critic_loss", "success")}


def read_wandb(folder):
    from wandb.proto.wandb_internal_pb2 import Record

    files = sorted(folder.glob("wandb/offline-run-*/*.wandb"))
    assert len(files) == 2
    assert len({file.name for file in files}) == 1  # the run's id: `wandb sync` makes one run of them
    steps = {"critic_loss": [], "success": []}
    for data in (data for file in files for data in log_entries(file.read_bytes())):
        history = Record.FromString(data).history
        for item in history.item:
            if (name := item.key or ".".join(item.nested_key)) in steps:
                steps[name].append(history.step.num)
    return steps


def log_entries(data):
    """Entries of a file in LevelDB's log format, behind wandb's 7 bytes: parts of blocks of 32 KiB."""
    at, entry = 7, b""
    while at + 7 <= len(data):
        if (left := 32768 - at % 32768) < 7:
            at += left
            continue
        size, kind = int.from_bytes(data[at + 4 : at + 6], "little"), data[at + 6]
        entry += data[at + 7 : at + 7 + size]
        at += 7 + size
        if kind in (1, 4):  # whole, or the last part
            yield entry
            entry = b""


def read_mlflow(folder):
    from mlflow import MlflowClient

    client = MlflowClient(f"sqlite:///{folder}/mlflow.db")
    (run,) = client.search_runs([client.get_experiment_by_name("curiobench").experiment_id])
    assert run.info.status == "FINISHED"
    assert run.data.params["sac.hidden"] == "8"
    found = {name: client.get_metric_history(run.info.run_id, name) for name in ("critic_loss", "success")}
    return {name: [metric.step for metric in metrics] for name, metrics in found.items()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "read", "repeated"),
    [("tensorboard", read_tensorboard, []), ("wandb", read_wandb, [2]), ("mlflow", read_mlflow, [2])],
)
def test_a_tracker_gets_every_row_in_one_run_and_changes_nothing(
    name, read, repeated, untracked, tmp_path, monkeypatch
):
    pytest.importorskip(name)
    for variable in ("WANDB_MODE", "MLFLOW_TRACKING_URI", "MLFLOW_EXPERIMENT_NAME"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.chdir(tmp_path)
    handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    train_in_two_parts(tracked(name), tmp_path / "run")
    steps = {"critic_loss": [1, 2, *repeated, 3], "success": [2, *repeated, 3]}
    # wandb's own process writes its file a moment after the run has closed it
    wait_for(lambda: read(tmp_path / "run") == steps, seconds=30)
    assert numbers(tmp_path / "run") == numbers(untracked)
    first, second = (
        checkpoint.load(path / CHECKPOINT, TINY.fingerprint())[0] for path in (tmp_path / "run", untracked)
    )
    assert same_state(first, second)
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == handlers


@pytest.mark.parametrize("when", ["begin", "log", "close"])
def test_a_tracker_that_fails_is_named_in_a_line_and_left_out(when, tmp_path, monkeypatch):
    class Broken:
        def __init__(self, config, folder, first_epoch):
            self.act("begin")

        def log(self, values, epoch):
            self.act("log")

        def close(self):
            self.act("close")

        def act(self, now):
            if now == when:
                raise RuntimeError("no such\n  server")

    monkeypatch.setitem(trackers.TRACKERS, "tensorboard", Broken)
    lines = []
    tracking = trackers.Trackers(tracked("tensorboard"), tmp_path, 1, lines.append)
    for epoch in (1, 2):
        tracking.log({"epoch": epoch, "success": 0.5})
    tracking.close()
    assert lines == ["tensorboard tracks no longer: no such server"]


def test_without_the_extra_no_run_is_begun(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(ValueError, match=r"--machine.track wandb needs the extra: pip install 'curiobench\[wandb\]'"):
        train(tracked("wandb"), tmp_path / "run")
    assert not (tmp_path / "run").exists()
    with pytest.raises(ValueError, match="unknown tracker 'wandd': did you mean 'wandb'"):
        tracked("mlflow,wandd")


@pytest.mark.parametrize(("before", "now"), [(True, "tensorboard"), (False, None)])
def test_configs_of_before_there_were_other_trackers_are_read(before, now):
    older = TINY.to_json()
    older["machine"] = {"tensorboard": before} | {k: v for k, v in older["machine"].items() if k != "track"}
    assert RunConfig.from_json(older) == replace(TINY, machine=MachineConfig(track=now))
