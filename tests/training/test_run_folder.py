"""The run folder: who may use it, and what it keeps."""

import fcntl
import json
import os
import signal
import subprocess
import sys
import threading
from dataclasses import replace

import pytest
import tiny_runs
from tiny_runs import TINY

from curiobench.config import CONFIG_VERSION
from curiobench.files import replace_file
from curiobench.run_folder import RunFolder, read_config, read_record, read_rows
from curiobench.versions import ENVIRONMENT_VARIABLES


def test_keeps_config_command_and_what_else_decides_numbers(tmp_path, monkeypatch):
    for name in ENVIRONMENT_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("NUMBA_OPT", "2")
    monkeypatch.setenv("ATEN_CPU_CAPABILITY", "default")
    with RunFolder(tmp_path / "a" / "b", TINY, resume=False, command=["curiobench", "train"]) as folder:
        record = read_record(folder.path)
    assert read_config(folder.path) == TINY
    assert record["command"] == ["curiobench", "train"]
    packages = {"python", "mujoco", "dm_control", "torch", "numpy", "numba", "curiobench", "git_commit"}
    assert record["versions"].keys() >= packages
    assert record["versions"]["environment"] == "ATEN_CPU_CAPABILITY=default NUMBA_OPT=2"


def test_a_grid_that_looks_does_not_keep_a_run_from_starting(tmp_path):
    RunFolder(tmp_path, TINY, resume=False).close()
    with open(tmp_path / ".lock") as file:
        fcntl.flock(file, fcntl.LOCK_SH)
        threading.Timer(0.02, fcntl.flock, (file, fcntl.LOCK_UN)).start()
        RunFolder(tmp_path, TINY, resume=True).close()


def test_is_used_by_one_process_at_a_time_until_that_is_killed(tmp_path):
    program = (
        "import sys, time; sys.path.insert(0, sys.argv[2]); from pathlib import Path; from tiny_runs import TINY;"
        "from curiobench.run_folder import RunFolder; f = RunFolder(Path(sys.argv[1]), TINY, False);"
        "print('locked', flush=True); time.sleep(60)"
    )
    command = [sys.executable, "-c", program, str(tmp_path), os.path.dirname(tiny_runs.__file__)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "locked\n"
        with pytest.raises(ValueError, match=f"already running, in process {process.pid}"):
            RunFolder(tmp_path, TINY, resume=True)
        process.send_signal(signal.SIGKILL)
    RunFolder(tmp_path, TINY, resume=True).close()


def test_what_is_there_already_is_named(finished, tmp_path):
    RunFolder(tmp_path, TINY, resume=False).close()
    with pytest.raises(ValueError, match="holds an unfinished run; add --resume"):
        RunFolder(tmp_path, TINY, resume=False)
    with pytest.raises(ValueError, match="other options: epochs is 3 there, 2 was requested"):
        RunFolder(tmp_path, replace(TINY, epochs=2), resume=True)
    for resume in (False, True):
        with pytest.raises(ValueError, match=r"is finished .*; choose another --out$"):  # its replay is gone
            RunFolder(finished, TINY, resume)


def test_a_kill_before_there_is_a_config_leaves_room_for_another_start(tmp_path):
    (tmp_path / ".lock").touch()
    (tmp_path / "config.json.partial").write_text("{")
    RunFolder(tmp_path, TINY, resume=False).close()
    assert read_config(tmp_path) == TINY


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "cannot read"),
        ("[]", "JSON object"),
        ("\udcff", "cannot read"),
        ("{}", "was not written by `curiobench train`: format is None"),
        (json.dumps({"format": "curiobench run"}), "version None"),
        (json.dumps({"format": "curiobench run", "config_version": 0, "config": {}}), "version 0"),
        (json.dumps({"format": "curiobench run", "config_version": CONFIG_VERSION + 1, "config": {}}), "version 2"),
        (json.dumps({"format": "curiobench run", "config_version": "1", "config": {}}), "version '1'"),
        (json.dumps({"format": "curiobench run", "config_version": CONFIG_VERSION, "config": {"x": 1}}), "field x"),
    ],
)
def test_refuses_a_damaged_or_foreign_config(tmp_path, text, message):
    (tmp_path / "config.json").write_text(text, errors="surrogateescape")
    with pytest.raises(ValueError, match=message) as refused:
        read_config(tmp_path)
    assert str(tmp_path / "config.json") in str(refused.value)
    assert "\n" not in str(refused.value)


def test_rows_after_a_checkpoint_are_cut_off(tmp_path):
    with RunFolder(tmp_path, TINY, resume=False) as folder:
        folder.append("progress.csv", [{"epoch": 1, "success": None}, {"epoch": 2, "success": 0.1}])
        sizes = folder.csv_sizes()
        folder.append("progress.csv", [{"epoch": 3, "success": 1 / 3}])
        assert read_rows(tmp_path / "progress.csv")[2] == {"epoch": "3", "success": repr(1 / 3)}
        folder.truncate(sizes)
        assert [row["success"] for row in read_rows(tmp_path / "progress.csv")] == ["", "0.1"]
        with pytest.raises(ValueError, match="columns"):
            folder.append("progress.csv", [{"epoch": 3}])
        (tmp_path / "progress.csv").write_text("epoch\n")
        with pytest.raises(ValueError, match="fewer than"):
            folder.truncate(sizes)


def test_a_full_disk_leaves_the_old_file(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")

    def fill(file):
        file.write(b"new")
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        replace_file(path, fill)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_rows_reach_a_full_disk_as_an_error(tmp_path):
    with RunFolder(tmp_path, TINY, resume=False) as folder:
        (tmp_path / "progress.csv").symlink_to("/dev/full")
        with pytest.raises(OSError, match="No space left"):
            folder.append("progress.csv", [{"epoch": 1}])
