"""Grids that are stopped, killed, or two in one folder, as processes of their own with fake cells."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import fake_grid
import pytest
from commands import wait_for
from fake_grid import make_cells, rows, set_up_fakes, undisturbed

from curiobench.grid.launcher import LocalJob
from curiobench.run_folder import is_locked

MANY = ("--methods", "sac,icm,rnd", "--seeds", "2", "--options", "epochs=20")


def epochs(cells) -> int:
    """Rows in all progress files, headers included."""
    return sum(text.count("\n") for text in rows(cells[0].out).values())


def is_free(cells) -> bool:
    return not any(is_locked(cell.path) for cell in cells)


@pytest.fixture
def start():
    """Starts a grid of fakes; none is left running when the test is over."""
    processes = []

    def call(*arguments):
        processes.append(fake_grid.start(*arguments))
        return processes[-1]

    yield call
    for process in processes:
        process.kill()


@pytest.fixture
def cells(tmp_path):
    """Six cells of a second each."""
    cells = make_cells(tmp_path / "grid", *MANY)
    set_up_fakes(cells, pace=0.05)
    return cells


def test_a_signal_ends_every_cell_after_a_checkpoint(cells, start):
    process = start(cells[0].out, 2, *MANY)
    wait_for(lambda: epochs(cells) > 6)
    os.kill(process.pid, signal.SIGINT)
    output = process.communicate(timeout=120)[0]
    assert process.returncode == 130, output
    assert is_free(cells)
    logs = "".join(path.read_text() for path in cells[0].out.glob("*.log"))
    assert logs.count("stopped after a checkpoint") == 2
    assert "0 of 6 cells finished, 2 stopped, 4 waiting" in output
    assert "; the same command continues" in output


def test_a_second_signal_ends_the_cells_at_once(tmp_path, start):
    cells = make_cells(tmp_path / "grid")
    set_up_fakes(cells, pace=90)
    process = start(cells[0].out, 2, "--methods", "sac,icm", "--seeds", "2")
    wait_for(lambda: sum(is_locked(cell.path) for cell in cells) == 2)
    for _ in range(2):
        os.kill(process.pid, signal.SIGINT)
        time.sleep(0.1)
    assert process.wait(timeout=60) == 130
    assert is_free(cells)


def test_cells_end_with_a_grid_that_is_killed_and_a_new_one_continues(cells, start):
    process = start(cells[0].out, 2, *MANY)
    wait_for(lambda: epochs(cells) > 10)
    os.killpg(process.pid, signal.SIGKILL)
    wait_for(lambda: is_free(cells), 60)
    again = start(cells[0].out, 2, *MANY)
    output = again.communicate(timeout=180)[0]
    assert again.returncode == 0, output
    assert rows(cells[0].out) == undisturbed(cells)


def test_two_grids_share_a_folder(cells, start):
    grids = [start(cells[0].out, 2, *MANY) for _ in range(2)]
    outputs = [process.communicate(timeout=180)[0] for process in grids]
    assert [process.returncode for process in grids] == [0, 0], outputs
    assert rows(cells[0].out) == undisturbed(cells)
    assert [len((cell.path / "starts").read_text().splitlines()) for cell in cells] == [1] * 6
    assert all("started" in output for output in outputs)


def test_a_cell_does_not_begin_when_its_parent_is_gone(tmp_path):
    tether = Path(sys.modules[LocalJob.__module__].__file__).with_name("tether.py")
    command = [sys.executable, str(tether), "1" if os.getpid() != 1 else "2", sys.executable, "-c", "print('ran')"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "the grid ended before its cell began\n"
