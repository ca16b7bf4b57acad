"""Submitted runs, the reference they are compared with, and the loop that applies the rules of rules.py.

Rules are independent: a run that breaks one rule fails one line. Folders that cannot be read fail the first rule only.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import pandas as pd

from curiobench.analysis import available, load
from curiobench.analysis.frames import EVALUATION_COLUMNS, Results
from curiobench.analysis.runs import versions_of
from curiobench.check import Finding, Skipped
from curiobench.config import with_later_fields
from curiobench.files import read_json
from curiobench.options import flatten
from curiobench.presets import PRESETS, preset
from curiobench.protocol import satisfied_starts
from curiobench.tasks.registration import task_spec

PRESETS_ONLY = "presets"  # name of the reference that is not a published set
_MOST_FAULTS, _MOST_RUNS = 10, 3
"""How many faults of a property are named, and how many runs of each; the others are only counted."""

PERSONAL = frozenset({"method", "method_config", "hybrid", "seed", "machine", "preset", "task", "robot"})
"""Options that may differ: the method's own, those that affect no number, and those that select the reference."""

Fault = tuple[str, str]  # what is wrong, and the run, or "" if it is about several


@dataclass(frozen=True)
class Submission:
    """Runs to check."""

    results: Results

    @cached_property
    def records(self) -> dict[str, dict[str, Any]]:
        """What config.json holds, by run."""
        return {run: read_json(file) for run, file in self.results.config_files.items()}

    @cached_property
    def configs(self) -> dict[str, dict[str, Any]]:
        """Options by run; options that are newer than the run have their default."""
        runs = self.results.runs
        return {run: with_later_fields(json.loads(text)) for run, text in zip(runs["run"], runs["config"], strict=True)}

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
        """A run and its recorded software, for its start and for each lengthening."""
        return [
            (run, {name: value for name, value in versions.items() if isinstance(value, str | int)})
            for run, record in self.records.items()
            for versions in versions_of(record)
        ]


def _by_run(frame: pd.DataFrame) -> dict[str, pd.DataFrame]:
    return {str(run): rows for run, rows in frame.groupby("run", observed=True, sort=False)}


@dataclass(frozen=True)
class Reference:
    """The reference of a submission: published runs, or the presets alone."""

    name: str
    runs: Submission | None = None

    def published(self) -> Submission:
        """The published runs; raises Skipped where there are none."""
        if self.runs is None:
            raise Skipped("no published set to compare with")
        return self.runs

    def rows(self, task: str) -> pd.DataFrame:
        """Evaluations of a task; none without published runs."""
        rows = self.runs.results.evaluations if self.runs else pd.DataFrame(columns=list(EVALUATION_COLUMNS))
        return rows[rows["task"] == task]

    def goals(self, task: str) -> set[tuple[str, str, int]]:
        """Name, bits and layer of each goal of a task; empty if unknown."""
        if task_spec(task).is_slow_to_enumerate:
            return goals_in(self.rows(task).drop_duplicates("bits"))
        space = task_spec(task).goal_space
        return set(zip(space.names, map(space.bit_string, space.goals), map(int, space.layers), strict=True))

    def satisfied_starts(self, task: str, total: int) -> dict[str, int] | None:
        """Number of test episodes in which a goal holds at the start, by the goal's bits; None if unknown."""
        if (counts := satisfied_starts(task, total)) is not None:
            return counts
        rows = self.rows(task)
        rows = rows[rows["episodes"] == total].drop_duplicates("bits")
        counts = dict(zip(rows["bits"], rows["episodes"] - rows["episodes_unsatisfied"], strict=True))
        return counts or None

    def unlike(self, config: Mapping[str, Any]) -> dict[str, str]:
        """Differences by option, in words, from the most similar run of the same task and robot, or from the preset."""
        published = self.runs.configs.values() if self.runs else ()
        alike = [other for other in published if task_and_robot(other) == task_and_robot(config)]
        if not alike and config["preset"] not in PRESETS:
            return {"preset": f"there is no preset {config['preset']!r}, only {', '.join(PRESETS)}"}
        alike = alike or [preset(config["preset"], config["task"]).to_json()]
        return min((_differences(_protocol(config), _protocol(other)) for other in alike), key=len)


def goals_in(rows: pd.DataFrame) -> set[tuple[str, str, int]]:
    """Name, bits and layer of each goal in rows of evaluations."""
    return set(rows[["goal", "bits", "layer"]].itertuples(index=False, name=None))


def task_and_robot(config: Mapping[str, Any]) -> tuple[str, str]:
    """Task and robot, which compared runs share."""
    return config["task"], config["robot"]


def _protocol(config: Mapping[str, Any]) -> dict[str, Any]:
    """The options that a submission may not change, by dotted name."""
    return flatten({name: value for name, value in config.items() if name not in PERSONAL})


def _differences(own: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, str]:
    """What differs, as "epochs is 10, not 20", by option."""
    found = {}
    for name in {**other, **own}:
        if name not in other:
            found[name] = f"{name!r:.60} is not an option"
        elif name not in own or own[name] != other[name]:
            value = f"{own[name]!r:.60}" if name in own else "missing"
            found[name] = f"{name} is {value}, not {other[name]!r}"
    return found


Rule = Callable[[Submission, Reference], Iterable[Fault]]
RULES: list[tuple[str, str, Rule]] = []
"""Property, verdict on a fault (FAIL or warn) and rule, in the order of the report."""


def rule(property: str, verdict: str = "FAIL") -> Callable[[Rule], Rule]:
    """Decorator that adds a function to `RULES`."""

    def add(function: Rule) -> Rule:
        RULES.append((property, verdict, function))
        return function

    return add


def reference(against: str | None) -> Reference:
    """The reference of this name. Raises ValueError if there is no such set, or it is damaged."""
    name = against or (available() or [PRESETS_ONLY])[-1]
    return Reference("the presets") if name == PRESETS_ONLY else Reference(name, Submission(load(name)))


def apply_rules(runs: Submission, against: Reference) -> list[Finding]:
    """Apply every rule; without a run all but the first are skipped."""
    if runs.results.runs.empty:
        others = [Finding(property, "skip", "there is no run to examine") for property, _, _ in RULES[1:]]
        return [_finding(*RULES[0], runs, against), *others]
    return [_finding(*entry, runs, against) for entry in RULES]


def _finding(property: str, verdict: str, rule: Rule, runs: Submission, against: Reference) -> Finding:
    """The finding of one rule; runs with the same fault are named together."""
    where: dict[str, list[str]] = {}
    try:
        for fault, run in dict.fromkeys(rule(runs, against)):
            where.setdefault(fault, []).extend(filter(None, [run]))
    except Skipped as reason:
        return Finding(property, "skip", str(reason))
    lines = [f"{fault} ({first_of(names)})" if names else fault for fault, names in where.items()]
    if len(lines) > _MOST_FAULTS:
        lines[_MOST_FAULTS:] = [f"and {len(lines) - _MOST_FAULTS} more"]
    return Finding(property, verdict if lines else "pass", "\n".join(lines))


def first_of(names: Sequence[str]) -> str:
    """The first few names, and how many more there are."""
    more = f" and {len(names) - _MOST_RUNS} more" if len(names) > _MOST_RUNS else ""
    return ", ".join(names[:_MOST_RUNS]) + more
