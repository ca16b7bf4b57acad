"""A lengthened run has the rows of one that was as long from the start, whenever it was stopped."""

import shutil
from dataclasses import replace

import pytest
from tiny_runs import TINY, numbers

from curiobench.config import MachineConfig
from curiobench.files import read_json
from curiobench.run_folder import RunFolder, read_config, read_record
from curiobench.saved_agent import load_agent
from curiobench.training import train

LONG = replace(TINY, epochs=6, evaluate_every=1)
SHORT = replace(LONG, epochs=3, machine=MachineConfig(keep_replay=True))
LONGER = replace(SHORT, epochs=6)


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """Folder of a run of `LONG`, never stopped; not to be altered."""
    path = tmp_path_factory.mktemp("lengthened") / "long"
    train(LONG, path)
    return path


@pytest.fixture
def short(tmp_path, kept):
    """A copy of a finished run of `SHORT`."""
    return shutil.copytree(kept, tmp_path / "short")


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Folder of a finished run of `SHORT`, whose replay is kept; not to be altered."""
    path = tmp_path_factory.mktemp("lengthened") / "kept"
    train(SHORT, path, command=["curiobench", "train", "--epochs", "3"])
    return path


def test_a_finished_run_continues_as_if_it_had_been_longer_from_the_start(cli, long, short):
    code, _, err = cli("train", "--out", short, "--resume", "--epochs", 6)
    assert (code, err) == (0, "")
    assert numbers(short) == numbers(long)
    assert read_json(short / "result.json")["epochs"] == 6
    assert load_agent(short)[0] == read_config(short) == LONGER
    record = read_record(short)
    assert record["command"] == ["curiobench", "train", "--epochs", "3"]
    (lengthened,) = record["lengthened"]
    assert (lengthened["epochs"], lengthened["command"][-1]) == (3, "6")
    assert lengthened["versions"] == record["versions"]
    assert (short / "checkpoint" / "replay").is_dir()  # the folder's own --machine.keep-replay


def test_an_unfinished_run_can_be_extended_without_a_kept_replay(long, tmp_path, monkeypatch):
    config = replace(SHORT, machine=MachineConfig())
    with monkeypatch.context() as patch:
        patch.setattr("curiobench.training.write_json", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            train(config, tmp_path / "run")
    train(replace(config, epochs=6), tmp_path / "run", resume=True)
    assert numbers(tmp_path / "run") == numbers(long)


def test_killed_before_the_config_is_written_it_only_has_to_be_finished_once_more(long, short, monkeypatch):
    before = numbers(short)
    with monkeypatch.context() as patch:
        patch.setattr(RunFolder, "_write_record", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            RunFolder(short, LONGER, resume=True).lengthen()
    train(SHORT, short, resume=True)
    assert numbers(short) == before
    train(LONGER, short, resume=True)
    assert numbers(short) == numbers(long)


def test_a_finished_run_whose_checkpoint_is_damaged_keeps_its_result(short):
    for path in (short / "checkpoint").glob("agent-*.pt"):
        path.write_bytes(b"")
    before = {path: path.read_bytes() for path in short.glob("*.json")}
    with pytest.raises(ValueError, match="truncated or altered"):
        train(LONGER, short, resume=True)
    assert {path: path.read_bytes() for path in short.glob("*.json")} == before


def test_a_run_that_cannot_be_extended_is_left_unchanged(finished, short, tmp_path):
    gone = "its replay deleted; only runs trained with --machine.keep-replay"
    odd = shutil.copytree(finished, tmp_path / "odd")
    with pytest.raises(ValueError, match=gone):
        RunFolder(odd, replace(TINY, epochs=9), resume=True)
    (odd / "checkpoint" / "replay").mkdir()
    with pytest.raises(ValueError, match="evaluated after epoch 3, where a longer run with evaluate_every 2 is not"):
        RunFolder(odd, replace(TINY, epochs=9), resume=True)
    assert read_config(odd) == TINY
    for config, message in (
        (LONGER, None),
        (replace(LONGER, seed=1), "other options: seed is 0 there, 1 was requested"),
        (replace(SHORT, epochs=2), "is finished"),
    ):
        with pytest.raises(ValueError, match=message or "or --resume with a larger --epochs"):
            RunFolder(short, config, resume=message is not None)
    assert (short / "result.json").exists()
