"""Working folders with files that are called like our imports, and run folders with names that nobody expects."""

import errno
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from commands import GRID, call, files, reading
from tiny_runs import TINY, numbers

from curiobench import video
from curiobench.run_folder import read_record
from curiobench.training import train

SHADOWS = (
    "torch",
    "yaml",
    "numpy",
    "curiobench",
    "tasks",
    "methods",
    "matplotlib",
    "json",
    "conftest",
    "sitecustomize",
)
ODD = os.fsdecode(b"-out\xff\xfe") + "two\nlines \x1b[31mred  [a]*?$x <b>&amp;|` "


@pytest.fixture
def shadowed(tmp_path):
    """A folder that takes the place of modules, if it is searched for them."""
    for name in SHADOWS:
        (tmp_path / f"{name}.py").write_text("raise SystemExit('a file of the working folder was imported')")
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise SystemExit('a file of the working folder was imported')")
    (tmp_path / "pyproject.toml").write_text("[[")
    return tmp_path


@pytest.mark.parametrize("command", ["list", "report"])
def test_files_called_like_modules_are_not_imported(finished, shadowed, command):
    done = call(reading(finished)[command], shadowed)
    assert (done.returncode, done.stderr) == (0, b"")


def test_nor_by_the_processes_of_a_grid(finished, shadowed):
    done = call(GRID, shadowed)
    assert done.returncode == 0, done.stdout
    assert numbers(shadowed / "grid" / "stack2-sac-0") == numbers(finished)


@pytest.mark.parametrize("name", [ODD, "n" * 255], ids=["odd", "long"])
def test_a_run_folder_of_any_name_is_read(cli, finished, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    run = Path("runs") / name
    shutil.copytree(finished, run)
    before, (_, *commands) = files(run), reading(run).values()  # `list` reads none
    for words in (*commands, ("table", "--format", "latex", str(run))):
        code, out, err = cli(*words)
        assert (code, err) == ((1, err) if words[0] == "submit-check" else (0, "")), words
        assert "\x1b" not in out
    assert files(run) == before
    table = (tmp_path / "tables" / "runs.csv").read_text("utf-8").splitlines()
    assert len(table) == 2  # no name makes another line
    (tmp_path / "report.html").read_text("utf-8")


def test_a_run_in_a_folder_of_any_name_is_trained_and_recorded(finished, tmp_path):
    path = tmp_path / ODD
    command = ["curiobench", "train", "--out", str(path)]
    train(TINY, path, command=command)
    assert read_record(path)["command"] == command
    assert numbers(path) == numbers(finished)


def test_a_name_that_begins_with_a_dash_is_a_grids_too(cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = cli("grid", "--tasks", "stack2", "--methods", "sac", "--out=-g", "--seeds", "1", "--dry-run")
    assert (code, err) == (0, "")
    assert "--out=-g/stack2-sac-0" in out


@pytest.mark.parametrize("command", ["table", "report", "submit-check", "evaluate"])
def test_what_cannot_be_read_takes_one_line(cli, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    Path("loop").symlink_to("loop")
    Path("stray").mkdir()
    Path("stray", "thesis.tex").touch()
    for name in ("loop", "stray", "n" * 256, "none\nsuch"):
        code, _, err = cli(*reading(Path(name))[command])
        assert (code > 0, err.count("\n")) == (True, 1), (name, err)
        assert err.startswith("curiobench: ")


@pytest.mark.parametrize("out", ["loop/run", "/proc/run", "n" * 256])
def test_what_cannot_be_written_takes_one_line(cli, finished, tmp_path, monkeypatch, out):
    monkeypatch.chdir(tmp_path)
    Path("loop").symlink_to("loop")
    for words in (("train", "--preset", "smoke"), ("report", str(finished)), ("table", str(finished))):
        code, _, err = cli(*words, "--out", out)
        assert (code, err.count("\n")) == (2, 1), (words, err)
    assert not os.path.exists(out)


def test_a_file_system_that_cannot_sync_stops_no_run(finished, tmp_path, monkeypatch):
    def refuse(descriptor):
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    monkeypatch.setattr(os, "fsync", refuse)
    train(TINY, tmp_path / "run")
    assert numbers(tmp_path / "run") == numbers(finished)


def test_a_disk_that_is_full_keeps_no_half_of_a_video(tmp_path, monkeypatch):
    film = tmp_path / "films" / "film.mp4"

    def full(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ValueError, match=r"cannot write .*: No space left on device$"):
        video._write(film, np.zeros((4, 32, 32, 3), np.uint8))
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
