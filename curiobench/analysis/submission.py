"""Runs that somebody submits, what they are compared with, and how the rules of rules.py are tried on them.

The rules do not lean on each other: runs that break one fail one line. What cannot be read at all fails the first, and
is not examined further.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from curiobench.analysis.folders import available
from curiobench.analysis.frames import Results, load, read_results
from curiobench.analysis.rows import DTYPES
from curiobench.analysis.runs import versions_of
from curiobench.files import read_json
from curiobench.findings import Finding

PRESETS_ONLY = "presets"
"""Name of the reference that is no published set."""
_MOST_FAULTS, _MOST_RUNS = 10, 3
"""Different faults of one property that are named, and runs of each; the others are counted."""

Fault = tuple[str, str]
"""What is wrong, and the run in which it is; no run where it is about several."""


class Skipped(Exception):
    """A rule does not apply; says why."""


@dataclass(frozen=True)
class Submission:
    """Runs to examine."""

    results: Results
    records: Mapping[str, Mapping[str, Any]]
    """What config.json holds, by run."""

    @cached_property
    def configs(self) -> dict[str, dict[str, Any]]:
        """Options by run."""
        runs = self.results.runs
        return {run: json.loads(text) for run, text in zip(runs["run"], runs["config"], strict=True)}

    @cached_property
    def evaluations(self) -> dict[str, pd.DataFrame]:
        """Rows of evaluations.csv by run."""
        return _by_run(self.results.evaluations)

    @cached_property
    def progress(self) -> dict[str, pd.DataFrame]:
        """Rows of progress.csv by run."""
        return _by_run(self.results.progress)

    @cached_property
    def versions(self) -> list[tuple[str, dict[str, str | int]]]:
        """A run and what it says about the software that began it, and once more for each time it was made longer."""
        return [
            (run, {name: value for name, value in versions.items() if isinstance(value, str | int)})
            for run, record in self.records.items()
            for versions in versions_of(record)
        ]


def _by_run(frame: pd.DataFrame) -> dict[str, pd.DataFrame]:
    return {str(run): rows for run, rows in frame.groupby("run", observed=True, sort=False)}


@dataclass(frozen=True)
class Reference:
    """What a submission is compared with."""

    name: str
    runs: Submission | None = None
    """Published runs; None where the presets alone are the reference."""

    def rows(self, task: str) -> pd.DataFrame:
        """Evaluations of a task; none without published runs."""
        rows = self.runs.results.evaluations if self.runs else pd.DataFrame(columns=["task", *DTYPES])
        return rows[rows["task"] == task]


Rule = Callable[[Submission, Reference], Iterable[Fault]]
RULES: list[tuple[str, str, Rule]] = []
"""What holds of a good submission, what a fault comes to (FAIL or warn), and the rule; in the order of the report."""


def rule(property: str, verdict: str = "FAIL") -> Callable[[Rule], Rule]:
    """Adds a function to the rules."""

    def add(function: Rule) -> Rule:
        RULES.append((property, verdict, function))
        return function

    return add


def read_submission(paths: Sequence[Path]) -> Submission:
    """The runs that paths stand for; its faults name those that cannot be used."""
    return _with_records(read_results(paths))


def reference(against: str | None) -> Reference:
    """What runs are compared with; raises ValueError where there is no such set, or it is damaged."""
    name = against or (available() or [PRESETS_ONLY])[-1]
    return Reference("the presets") if name == PRESETS_ONLY else Reference(name, _with_records(load(name)))


def _with_records(results: Results) -> Submission:
    return Submission(results, {run: read_json(file) for run, file in results.checked_config_files().items()})


def examine(runs: Submission, against: Reference) -> list[Finding]:
    """Try every rule; where there is no run, all but the first are skipped."""
    if runs.results.runs.empty:
        others = [Finding(property, "skip", "there is no run to examine") for property, _, _ in RULES[1:]]
        return [_finding(*RULES[0], runs, against), *others]
    return [_finding(*rule, runs, against) for rule in RULES]


def _finding(property: str, verdict: str, rule: Rule, runs: Submission, against: Reference) -> Finding:
    """What one property comes to; runs with the same fault are named together."""
    where: dict[str, list[str]] = {}
    try:
        for fault, run in rule(runs, against):
            where.setdefault(fault, []).append(run)
    except Skipped as reason:
        return Finding(property, "skip", str(reason))
    lines = [fault + _named(names) for fault, names in where.items()]
    if len(lines) > _MOST_FAULTS:
        lines[_MOST_FAULTS:] = [f"and {len(lines) - _MOST_FAULTS} more"]
    return Finding(property, verdict if lines else "pass", "; ".join(lines))


def _named(runs: Iterable[str]) -> str:
    """The runs behind a fault, in brackets."""
    names = list(dict.fromkeys(filter(None, runs)))
    more = f" and {len(names) - _MOST_RUNS} more" if len(names) > _MOST_RUNS else ""
    return f" ({', '.join(names[:_MOST_RUNS])}{more})" if names else ""
