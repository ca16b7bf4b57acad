"""Standard output that is closed, full, ASCII only, or that nobody reads any longer."""

import os
import shlex
import subprocess

import pytest
from commands import COMMAND, TRAIN, reading

GONE = {"gone": "| true", "full": ">/dev/full", "closed": ">&- 2>&-"}


def shell(words, output, folder):
    """Exit code and standard error of a command with its output redirected."""
    command = f"set -o pipefail; {shlex.join([*COMMAND, *words])} {output}"
    done = subprocess.run(["bash", "-c", command], cwd=folder, capture_output=True, check=False, timeout=300)
    return done.returncode, done.stderr


@pytest.mark.parametrize("output", GONE)
def test_a_run_that_nobody_can_read_finishes(tmp_path, output):
    code, err = shell((*TRAIN, "--epochs", "1", "--cycles", "1", "--out", "run"), GONE[output], tmp_path)
    assert (tmp_path / "run" / "result.json").exists()
    assert (code, err) == (0, b"")


@pytest.mark.parametrize("command", ["table", "report"])
def test_a_full_disk_is_told_in_one_line(finished, tmp_path, command):
    code, err = shell(reading(finished)[command], ">/dev/full", tmp_path)
    assert (code, err) == (2, b"curiobench: [Errno 28] No space left on device\n")


@pytest.mark.parametrize("command", ["table", "report"])
def test_a_reader_that_goes_away_gets_no_traceback(finished, tmp_path, command):
    """As `curiobench table runs | head -1`."""
    assert shell(reading(finished)[command], "| true", tmp_path) == (141, b"")


def test_nothing_is_amiss_where_a_stream_is_closed(finished, tmp_path):
    assert shell(reading(finished)["table"], ">&-", tmp_path) == (0, b"")
    assert (tmp_path / "tables" / "runs.csv").exists()
    assert shell(("table", "none"), "2>&-", tmp_path) == (2, b"")


def test_characters_that_the_encoding_lacks_are_replaced(tmp_path):
    environment = os.environ | {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"}
    done = subprocess.run([*COMMAND, "--help"], env=environment, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"tasks ? methods ? seeds" in done.stdout
