"""Synthetic run folders for the tests of tables, figures, reports and published sets."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from synthetic import known, write_runs

from curiobench.analysis.frames import Results, read_results
from curiobench.analysis.samples import task_samples
from curiobench.analysis.style import theme


@pytest.fixture
def make_runs(tmp_path) -> Callable[..., list[Path]]:
    """`write_runs` in the folder tmp_path/runs: `make_runs(methods=("sac", "icm"), seeds=3)` gives run folders."""
    return partial(write_runs, tmp_path / "runs")


@pytest.fixture
def results(make_runs) -> Results:
    """Three seeds of sac and mihm, with the success of `known`."""
    return read_results(make_runs(success=known), every_goal=False, progress=False)


@pytest.fixture
def samples(make_runs):
    """Makes runs of one task, and gives its samples."""

    def make(**options):
        (task,) = task_samples(read_results(make_runs(**options), every_goal=False))
        return task

    return make


@pytest.fixture
def drawn(samples):
    """Makes runs of one task, and gives the pages of a kind of figure of all of them."""

    def make(draw, **options):
        task = samples(**options)
        with theme():
            return draw(task, task.samples)

    return make


@pytest.fixture
def undrawn(monkeypatch):
    """Leaves tables, figures and report out of published sets; they take seconds."""
    monkeypatch.setattr("curiobench.analysis.publish.derive", lambda folder: None)


@pytest.fixture
def out(tmp_path) -> Path:
    """Place of a published set."""
    return tmp_path / "sets" / "v1"
