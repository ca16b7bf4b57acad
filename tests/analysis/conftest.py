"""Synthetic run folders for the tests of tables, figures, reports and published sets."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from synthetic import write_runs


@pytest.fixture
def make_runs(tmp_path) -> Callable[..., list[Path]]:
    """`write_runs` in the folder tmp_path/runs: `make_runs(methods=("sac", "icm"), seeds=3)` gives run folders."""
    return partial(write_runs, tmp_path / "runs")
