"""Runs that somebody submits, and what they are compared with; submit_check.py examines them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from curiobench.analysis.folders import available
from curiobench.analysis.frames import Results, load, read_results
from curiobench.analysis.runs import versions_of
from curiobench.files import read_json

if TYPE_CHECKING:
    import pandas as pd

PRESETS_ONLY = "presets"
"""Name of the reference that is no published set."""

Fault = tuple[str, str]
"""What is wrong, and the run in which it is; no run where it is about several."""


class Skipped(Exception):
    """A rule does not apply; says why."""


@dataclass(frozen=True)
class Submission:
    """Runs to examine."""

    results: Results
    """Their frames."""
    records: Mapping[str, Mapping[str, Any]]
    """What config.json holds, by run."""

    @cached_property
    def configs(self) -> dict[str, dict[str, Any]]:
        """Options by run."""
        runs = self.results.runs
        return {run: json.loads(text) for run, text in zip(runs["run"], runs["config"], strict=True)}

    @cached_property
    def evaluations(self) -> dict[str, "pd.DataFrame"]:
        """Rows of evaluations.csv by run."""
        return _by_run(self.results.evaluations)

    @cached_property
    def progress(self) -> dict[str, "pd.DataFrame"]:
        """Rows of progress.csv by run."""
        return _by_run(self.results.progress)

    def versions(self, run: str) -> list[dict[str, str | int]]:
        """What a run says about the software that began it and that made it longer; empty where it says nothing."""
        return [
            {name: value for name, value in versions.items() if isinstance(value, str | int)}
            for versions in versions_of(self.records[run])
        ]


@dataclass(frozen=True)
class Reference:
    """What a submission is compared with."""

    name: str
    """What to call it."""
    runs: Submission | None = None
    """Published runs; None where the presets alone are the reference."""


def read_submission(paths: Sequence[Path]) -> Submission:
    """The runs in run folders, folders of run folders or published sets; its faults name those that cannot be used."""
    results = read_results(paths)
    return Submission(results, {run: read_json(file) for run, file in results.checked_config_files().items()})


def reference(against: str | None = None) -> Reference:
    """A reference by its name.

    Args:
        against: name or path of a published set, or "presets"; None for the newest set that comes with this package,
            or the presets where there is none.

    Raises:
        ValueError: there is no such set, or it is damaged.
    """
    name = against or (available() or [PRESETS_ONLY])[-1]
    if name == PRESETS_ONLY:
        return Reference("the presets")
    results = load(name)
    return Reference(
        name, Submission(results, {run: read_json(file) for run, file in results.checked_config_files().items()})
    )


def _by_run(frame: "pd.DataFrame") -> dict[str, "pd.DataFrame"]:
    return {str(run): rows for run, rows in frame.groupby("run", observed=True, sort=False)}
