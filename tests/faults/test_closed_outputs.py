"""Standard output that is closed, full, ASCII only, or that nobody reads any longer."""

import os
import pty
import shlex
import subprocess

import pytest
from commands import COMMAND, GRID, TRAIN, reading

LONG = {
    "train": ((*TRAIN, "--epochs", "1", "--cycles", "1", "--out", "run"), "run"),
    "grid": (GRID, "grid/stack2-sac-0"),
}
"""Commands that nobody waits for, and their run folders."""
GONE = {"gone": "| true", "full": ">/dev/full", "closed": ">&- 2>&-"}
BUFFERED, UNBUFFERED = "", "1"
"""PYTHONUNBUFFERED: by itself Python writes to a pipe late; containers often tell it not to."""
both = pytest.mark.parametrize("buffering", [BUFFERED, UNBUFFERED], ids=["buffered", "unbuffered"])


def shell(words, output, folder, buffering=BUFFERED):
    """Exit code and standard error of a command with its output redirected."""
    command = f"set -o pipefail; {shlex.join([*COMMAND, *words])} {output}"
    environment = os.environ | {"PYTHONUNBUFFERED": buffering}
    done = subprocess.run(
        ["bash", "-c", command], cwd=folder, env=environment, capture_output=True, check=False, timeout=300
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    ("command", "output", "buffering"),
    [
        *(("train", output, BUFFERED) for output in GONE),
        ("train", "full", UNBUFFERED),
        ("grid", "gone", BUFFERED),
        ("grid", "closed", BUFFERED),
        ("grid", "gone", UNBUFFERED),
    ],
)
def test_what_nobody_can_read_finishes(tmp_path, command, output, buffering):
    words, run = LONG[command]
    code, err = shell(words, GONE[output], tmp_path, buffering)
    assert (tmp_path / run / "result.json").exists()
    assert (code, err) == (0, b"")


def test_a_terminal_that_goes_away_stops_no_run(tmp_path):
    ours, its = pty.openpty()
    words, run = LONG["train"]
    command, environment = [*COMMAND, *words], os.environ | {"TERM": "xterm"}
    with subprocess.Popen(command, cwd=tmp_path, stdout=its, stderr=its, env=environment) as process:
        os.close(its)
        os.read(ours, 1)  # it draws
        os.close(ours)
        assert process.wait(timeout=300) == 0
    assert (tmp_path / run / "result.json").exists()


@both
def test_a_full_disk_is_told_in_one_line(finished, tmp_path, buffering):
    code, err = shell(reading(finished)["table"], ">/dev/full", tmp_path, buffering)
    assert (code, err) == (2, b"curiobench: [Errno 28] No space left on device\n")


@both
def test_a_reader_that_goes_away_gets_no_traceback(finished, tmp_path, buffering):
    """As `curiobench table runs | head -1`."""
    assert shell(reading(finished)["table"], "| true", tmp_path, buffering) == (141, b"")


def test_nothing_is_amiss_where_a_stream_is_closed(finished, tmp_path):
    assert shell(reading(finished)["table"], ">&-", tmp_path) == (0, b"")
    assert (tmp_path / "tables" / "runs.csv").exists()
    assert shell(("table", "none"), "2>&-", tmp_path) == (2, b"")


def test_characters_that_the_encoding_lacks_are_replaced(tmp_path):
    environment = os.environ | {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"}
    done = subprocess.run([*COMMAND, "--help"], env=environment, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"tasks ? methods ? seeds" in done.stdout
