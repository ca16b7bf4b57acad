"""What a worker of a cluster does with a cell's process."""

import signal
from pathlib import Path

import pytest

from curiobench.grid import launcher
from curiobench.grid.launcher import train_in_worker


class Process:
    """A cell's process that ends at the first signal."""

    def __init__(self, command, log, folder):
        self.code = None
        signal.raise_signal(signal.SIGINT)  # the task is cancelled just now

    def poll(self):
        return self.code

    def signal(self, number):
        self.code = 128 + number


def test_a_task_that_is_cancelled_while_its_process_starts_passes_that_on(monkeypatch):
    monkeypatch.setattr(launcher, "LocalJob", Process)
    before = signal.getsignal(signal.SIGINT)
    assert train_in_worker((), (), "log", "") == 128 + signal.SIGINT
    assert signal.getsignal(signal.SIGINT) == before


def test_a_process_that_cannot_start_is_an_error(monkeypatch):
    monkeypatch.setattr(launcher, "LocalJob", lambda *_: Path("/nowhere/log").touch())
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(OSError, match="No such file"):
        train_in_worker((), (), "log", "")
    assert signal.getsignal(signal.SIGINT) == before
