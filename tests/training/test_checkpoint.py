"""Damaged, foreign and hostile checkpoints: one clear line, nothing run, nothing lost."""

import hashlib
import io
import os
import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch
from tiny_runs import TINY

from curiobench import checkpoint
from curiobench.files import read_json, write_json
from curiobench.saved_agent import load_agent
from curiobench.training import TrainingRun, train

AGENT = {"weights": {"w": torch.arange(3.0)}, "updates": 7}
VALUES = {"replay": "replay-8.json", "epoch": 2}


class Evil:
    """Unpickling it would make a folder."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return os.mkdir, (self.path,)


@pytest.fixture
def folder(tmp_path):
    """A folder with two checkpoints, written under the fingerprint "f"."""
    for updates in (6, 7):
        checkpoint.save(tmp_path, "f", AGENT | {"updates": updates}, VALUES)
    return tmp_path


def edit(path, **changes):
    write_json(path, read_json(path) | changes)


def test_returns_what_was_saved_last(folder):
    agent, values = checkpoint.load(folder, "f")
    assert agent["updates"] == 7
    assert torch.equal(agent["weights"]["w"], AGENT["weights"]["w"])
    assert values == VALUES
    assert checkpoint.load(folder / "none", "f") is None


def test_keeps_two_and_removes_what_a_kill_left_behind(folder):
    (folder / "checkpoint-1.json").unlink()
    checkpoint.save(folder, "f", AGENT, VALUES)
    assert {path.name for path in folder.iterdir()} == {
        "agent-2.pt", "agent-3.pt", "checkpoint-2.json", "checkpoint-3.json"
    }  # fmt: skip


def test_an_agent_without_its_manifest_does_not_count(folder):
    (folder / "checkpoint-2.json").unlink()
    assert checkpoint.load(folder, "f")[0]["updates"] == 6
    checkpoint.save(folder, "f", AGENT, VALUES)
    assert checkpoint.load(folder, "f")[0]["updates"] == 7


def truncate_agent(folder):
    path = folder / "agent-2.pt"
    path.write_bytes(path.read_bytes()[:-100])


def flip_a_bit(folder):
    content = bytearray((folder / "agent-2.pt").read_bytes())
    content[len(content) // 2] ^= 1
    (folder / "agent-2.pt").write_bytes(content)


def put_a_pickle(folder, content):
    (folder / "agent-2.pt").write_bytes(content)
    edit(folder / "checkpoint-2.json", agent_sha256=hashlib.sha256(content).hexdigest())


def torch_pickle(folder):
    buffer = io.BytesIO()
    torch.save({"weights": Evil(folder / "made by evil")}, buffer)
    put_a_pickle(folder, buffer.getvalue())


def truncate_manifest(folder):
    path = folder / "checkpoint-2.json"
    path.write_bytes(path.read_bytes()[:-30])


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (truncate_agent, "truncated or altered"),
        (flip_a_bit, "truncated or altered"),
        (lambda folder: (folder / "agent-2.pt").unlink(), "agent-2.pt"),
        (lambda folder: put_a_pickle(folder, pickle.dumps(Evil(folder / "made by evil"), protocol=2)), "Unpickling"),
        (torch_pickle, "Unpickling"),
        (truncate_manifest, "cannot read"),
        (lambda folder: (folder / "checkpoint-2.json").write_text("[" * 100_000), "cannot read"),
        (lambda folder: (folder / "checkpoint-2.json").write_text("{}"), "format is None"),
        (lambda folder: edit(folder / "checkpoint-2.json", format="curiobench checkpoint 0"), "checkpoint 0"),
        (lambda folder: edit(folder / "checkpoint-2.json", fingerprint="g"), "another config"),
        (lambda folder: edit(folder / "checkpoint-2.json", values={}), "replay"),
        (lambda folder: edit(folder / "checkpoint-2.json", values={"replay": "../../replay-8.json"}), "not the name"),
        (lambda folder: edit(folder / "checkpoint-2.json", values={"replay": 8}), "expected string"),
    ],
)
def test_damage_is_named_in_one_line_and_no_code_runs(folder, damage, message):
    damage(folder)
    with pytest.raises(ValueError, match=message) as refused:
        checkpoint.load(folder, "f")
    assert "\n" not in str(refused.value)
    assert str(folder / "checkpoint-2.json") in str(refused.value)
    advised = "delete it to go back to checkpoint 1" in str(refused.value)
    assert advised == (message != "checkpoint 0")  # those before it are of that version, too
    assert not (folder / "made by evil").exists()
    (folder / "checkpoint-2.json").unlink()
    assert checkpoint.load(folder, "f")[0]["updates"] == 6


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """Folder of a run of TINY that was killed after its second epoch, at its second checkpoint; not to be altered."""
    path, save, saves = tmp_path_factory.mktemp("runs") / "killed", TrainingRun._save, 0

    def save_and_leave(self):
        nonlocal saves
        save(self)
        saves += 1
        if saves == 2:
            raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TrainingRun, "_save", save_and_leave)
        with pytest.raises(KeyboardInterrupt):
            train(TINY, path)
    return path


@pytest.fixture
def stopped(killed, tmp_path):
    """A copy of it."""
    return shutil.copytree(killed, tmp_path / "stopped")


@pytest.mark.parametrize("name", ["episodes-8-16.npz", "replay-16.json"])
def test_a_damaged_replay(stopped, name):
    path = stopped / "checkpoint" / "replay" / name
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(ValueError, match=r"cannot use .*checkpoint-2\.json"):
        train(TINY, stopped, resume=True)


def test_a_pickle_in_the_replay_does_not_run(stopped, tmp_path):
    path = stopped / "checkpoint" / "replay" / "episodes-8-16.npz"
    with np.load(path) as saved:
        arrays = dict(saved)
    np.savez(path, **arrays | {"action": np.array([Evil(tmp_path / "made by evil")])})
    with pytest.raises(ValueError, match="allow_pickle"):
        train(TINY, stopped, resume=True)
    assert not (tmp_path / "made by evil").exists()


def test_a_damaged_checkpoint_can_be_left_out(stopped, finished):
    (stopped / "checkpoint" / "checkpoint-2.json").unlink()
    train(TINY, stopped, resume=True)
    assert (stopped / "evaluations.csv").read_text() == (finished / "evaluations.csv").read_text()


def test_a_checkpoint_of_another_run(stopped, tmp_path):
    other = replace(TINY, seed=5)
    shutil.copytree(stopped, tmp_path / "other")
    edit(tmp_path / "other" / "config.json", config=other.to_json())
    with pytest.raises(ValueError, match="another config"):
        train(other, tmp_path / "other", resume=True)


def test_an_agent_of_another_shape(stopped):
    agent, values = checkpoint.load(stopped / "checkpoint", TINY.fingerprint())
    agent["critics"] = {name: weights[..., :-1] for name, weights in agent["critics"].items()}
    checkpoint.save(stopped / "checkpoint", TINY.fingerprint(), agent, values)
    with pytest.raises(ValueError, match="RuntimeError"):
        load_agent(stopped)
