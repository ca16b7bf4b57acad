"""Synthetic run folders for the tests of tables, figures, reports and published sets, and the command line."""

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from synthetic import write_runs

from curiobench.cli import main


@pytest.fixture
def make_runs(tmp_path) -> Callable[..., list[Path]]:
    """`write_runs` in the folder tmp_path/runs: `make_runs(methods=("sac", "icm"), seeds=3)` gives run folders."""
    return partial(write_runs, tmp_path / "runs")


@pytest.fixture
def cli(monkeypatch, capsys) -> Callable[..., tuple[int, str, str]]:
    """Runs a command in this process; gives exit code, stdout and stderr."""

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["curiobench", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, *capsys.readouterr()

    return call
