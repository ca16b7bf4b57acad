"""Tables of results: estimates over seeds for each method, and the columns of the tables.

formats.py converts them to text.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
import pandas as pd

from curiobench.analysis.frames import Results
from curiobench.analysis.rows import IDENTITY
from curiobench.analysis.samples import DECIMALS, GOOD_SUCCESS, Sample, TaskSamples
from curiobench.analysis.statistics import (
    ENOUGH_SEEDS,
    curve_interval,
    improvement_interval,
    interquartile_mean,
    probability_of_improvement,
    seed_warnings,
    stratified_bootstrap,
)
from curiobench.analysis.variants import cautions, hour_digits

CLOCK = "hours are of the clock, also where runs shared their machine with other work"
RARE = 100  # probabilities of at most one in 100 get no note


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % bootstrap interval over seeds. Both ends are NaN if there is no interval.

    That is the case with a single seed.
    """

    value: float
    low: float = float("nan")
    high: float = float("nan")


Value = str | int | float | Estimate | None


@dataclass(frozen=True, eq=False)
class Summary:
    """Values of a sample by column; docs/results.md explains the columns."""

    task: TaskSamples
    sample: Sample
    values: dict[str, Value]


@dataclass(frozen=True)
class Column:
    """A column of a table."""

    key: str  # name in csv files
    heading: str  # name in other formats
    digits: int = 2  # decimals, except in csv files
    contest: bool = False  # higher is better; the highest value is bold if its interval lies above all others


@dataclass(frozen=True)
class Table:
    """A table; `None` in a row is printed as a dash."""

    title: str  # what it shows
    columns: tuple[Column, ...]  # its columns, names first
    rows: tuple[dict[str, Value], ...]  # values by column
    notes: tuple[str, ...] = ()  # lines below it

    def best(self, column: Column) -> int | None:
        """Row of the value whose interval lies above all others; None if there is none, or too few seeds."""
        values = [row.get(column.key) for row in self.rows]
        if not column.contest or len(values) < 2:
            return None
        if min(row.get("seeds", ENOUGH_SEEDS) for row in self.rows) < ENOUGH_SEEDS:
            return None  # intervals of so few seeds miss the true value too often
        first = max(range(len(values)), key=lambda i: values[i].value)
        others = [value.high for i, value in enumerate(values) if i != first]
        return first if values[first].low > np.max(others) else None  # not where an end is NaN


def summarise(tasks: Sequence[TaskSamples], baseline: str = "sac") -> list[Summary]:
    """Summaries of all tasks, methods and variants, each compared with the baseline, a method spec.

    For a partial run, the last evaluation counts as the final one.
    """
    pairs = [(task, sample) for task in tasks for sample in task.samples]
    return [Summary(task, sample, _values(task, sample, _baseline(task, sample, baseline))) for task, sample in pairs]


def _baseline(task: TaskSamples, sample: Sample, baseline: str) -> Sample | None:
    """The baseline sample to compare with, or None.

    It has the same variant, or any variant if the baseline lacks that one, and equal epochs, steps and updates. More
    than one such sample gives None.
    """
    if sample.method == baseline:
        return None
    found = [other for other in task.samples if other.method == baseline]
    alike = [other for other in found if other.variant == sample.variant] or found
    as_long = [other for other in alike if _lengths(other) == _lengths(sample)]
    return as_long[0] if len(as_long) == 1 else None


def _lengths(sample: Sample) -> set[tuple[int, ...]]:
    return set(sample.runs[["epoch", "steps", "updates"]].itertuples(index=False, name=None))


def _values(task: TaskSamples, sample: Sample, baseline: Sample | None) -> dict[str, Value]:
    runs, success, reached = sample.runs, _final(sample), sample.reached
    means = np.column_stack([sample.last_learned, success, sample.area])
    *learned, of_success, of_area = map(Estimate, means.mean(axis=0), *curve_interval(means))
    middle = stratified_bootstrap(sample.goal_success[:, None, :], interquartile_mean)
    some = "" if len(reached) in (0, len(runs)) else f" ({len(reached)} of {len(runs)} seeds)"
    return {
        "method": sample.method,
        "variant": sample.variant,
        "seeds": sample.n_seeds,
        **{key_of("learned", layer): value for layer, value in zip(task.sizes, learned, strict=True)},
        "middle_success": Estimate(float(interquartile_mean(sample.goal_success)), *middle),
        "success": of_success,
        "area": of_area,
        "epochs_to_good": f"{reached.mean():.1f}{some}" if len(reached) else None,
        "better": None if baseline is None else _improvement(success, _final(baseline)),
        "better_area": None if baseline is None else _improvement(sample.area, baseline.area),
        "hours": float(runs["hours"].mean()),
        "memory": float(runs["peak_memory_mb"].max()),
        "machine": "; ".join(sorted(set(runs["machine"]) - {""})) or None,
    }


def key_of(name: str, layer: int) -> str:
    """Column name for the numbers of a layer; layer 0 is all layers together."""
    return f"{name}_{layer}" if layer else name


def _final(sample: Sample) -> np.ndarray:
    """Final success `(S,)` over all goals, rounded so that equal values tie."""
    return np.round(sample.last_success[:, 0], DECIMALS)


def _improvement(scores: np.ndarray, baseline: np.ndarray) -> Estimate | None:
    """Probability that a run scores higher than one of the baseline.

    It is None if either has a single seed. If all runs of one are better than all runs of the other, every resample
    has the same value, and there is no interval.
    """
    if min(len(scores), len(baseline)) < 2:
        return None
    x, y = scores[:, None], baseline[:, None]
    low, high = improvement_interval(x, y)
    return Estimate(probability_of_improvement(x, y), *((low, high) if low < high else ()))


def method_tables(summaries: Sequence[Summary], baseline: str = "sac") -> list[Table]:
    """Three tables per task (learned goals, success, cost), with one row per sample.

    `baseline` is the method that the summaries were compared with.
    """
    groups = groupby(summaries, key=lambda summary: summary.task)
    return [table for _, group in groups for table in _tables_of_task(list(group), baseline)]


def interval_notes(summaries: Sequence[Summary]) -> list[str]:
    """Notes that explain the brackets of intervals, if there are any, and warn about too few seeds."""
    sizes = [(summary.sample.label, summary.sample.n_seeds) for summary in summaries]
    brackets = ["[ ] 95 % bootstrap interval over seeds"] if max(size for _, size in sizes) > 1 else []
    return brackets + seed_warnings(sizes)


def _tables_of_task(summaries: list[Summary], baseline: str) -> list[Table]:
    task = summaries[0].task
    goals, before = task.sizes, task.untrained
    names, rows = name_columns(summaries), tuple(summary.values for summary in summaries)
    layers = [*filter(None, goals), 0]
    learned = [Column(key_of("learned", k), f"{layer_name(k)} (of {goals[k]})", 1, contest=True) for k in layers]
    success = [
        Column("middle_success", "IQM of final success", contest=True),
        Column("success", "final success", contest=True),
        Column("area", "success over training", contest=True),
        Column("epochs_to_good", f"epochs to {GOOD_SUCCESS}"),
    ]
    if any(summary.values["better"] is not None for summary in summaries):
        success.append(Column("better", f"P(final > {baseline})"))
        success.append(Column("better_area", f"P(over training > {baseline})"))
    hours = Column("hours", "hours a run", hour_digits(min(row["hours"] for row in rows)))
    cost = [hours, Column("memory", "peak memory, MB", 0), Column("machine", "machine")]
    brackets = interval_notes(summaries)
    of_learned = [] if before is None else [f"before training: {before.learned:.1f} of {goals[0]} goals"]
    of_success = [] if before is None else [f"before training: success {before.success:.2f}"]
    of_success += [*brackets, *_comparison_notes(summaries, baseline)]
    return [
        Table(f"{task.task}: learned goals", (*names, *learned), rows, (task.scale, *of_learned, *brackets)),
        Table(f"{task.task}: success", (*names, *success), rows, (task.scale, *of_success)),
        Table(f"{task.task}: cost", (*names, *cost), rows, (CLOCK, *cautions(task.runs))),
    ]


def _comparison_notes(summaries: Sequence[Summary], baseline: str) -> list[str]:
    """Notes on methods that were not compared with the baseline, and on probabilities of 0 or 1."""
    others = [summary for summary in summaries if summary.sample.method != baseline]
    notes = []
    missing = [summary.sample.method for summary in others if summary.values["better"] is None]
    if missing and len(summaries) > 1:
        which = "" if len(missing) == len(others) else f"{', '.join(dict.fromkeys(missing))} "
        notes.append(f"{which}not compared: that takes two seeds each, and runs of {baseline} of the same length")
    of_baseline = [summary.sample.n_seeds for summary in summaries if summary.sample.method == baseline]
    compared = [(s.sample.n_seeds, s.values[key]) for s in others for key in ("better", "better_area")]
    sizes = [size for size, estimate in compared if estimate is not None and estimate.value in (0, 1)]
    if sizes and of_baseline:
        chance = math.comb(min(sizes) + min(of_baseline), min(sizes)) // 2
        if chance < RARE:
            notes.append(
                f"P of 0 or 1 has no interval; with so few seeds, one in {chance} comparisons of equals gives it"
            )
    return notes


def layer_name(layer: int) -> str:
    """Heading of a layer; "total" for 0, which is all layers together."""
    return "total" if layer == 0 else "1 layer" if layer == 1 else f"{layer} layers"


def name_columns(summaries: Sequence[Summary]) -> list[Column]:
    """The first columns of a table of methods."""
    variant = [Column("variant", "options")] if any(summary.sample.variant for summary in summaries) else []
    return [Column("method", "method"), *variant, Column("seeds", "seeds", 0)]


def flat_table(summaries: Sequence[Summary], baseline: str = "sac") -> pd.DataFrame:
    """All numbers of `method_tables` in one frame for csv files, with one row per task, method and variant."""
    layers = sorted({layer for summary in summaries for layer in summary.task.sizes if layer})
    keys = [
        *("task", "method", "variant", "seeds", "epochs", "goals", "learned"),
        *(f"{part}_{layer}" for layer in layers for part in ("goals", "learned")),
        *("middle_success", "success", "area", "epochs_to_good", "seeds_good", "baseline", "better", "better_area"),
        *("hours", "memory", "machine"),
    ]
    rows = []
    for summary in summaries:
        reached, epochs = summary.sample.reached, sorted(set(summary.sample.runs["epoch"].tolist()))
        goals = {key_of("goals", layer): number for layer, number in summary.task.sizes.items()}
        flat = {"task": summary.task.task, "epochs": " ".join(map(str, epochs)), "seeds_good": len(reached)}
        flat |= {"epochs_to_good": float(reached.mean()) if len(reached) else None}
        flat |= {"baseline": None if summary.values["better"] is None else baseline}
        rows.append(summary.values | goals | flat)
    return pd.DataFrame(rows, columns=keys)


def run_tables(results: Results) -> tuple[Table, pd.DataFrame]:
    """One or more runs, a line each: identity, progress, learned goals; as a table, and all numbers for csv files."""
    last = results.layers.merge(results.runs[["run", "epoch"]]).astype({"run": str})
    layers = [*sorted(set(last["layer"]) - {0}), 0]
    wide = last.pivot(index="run", columns="layer", values=["learned", "goals", "success"])
    wide.columns = [key_of(name, layer) for name, layer in wide.columns]
    names = [*IDENTITY]
    goals = [key_of(name, layer) for layer in layers for name in ("learned", "goals")]
    flat = results.runs.join(wide, on="run").astype({"complete": int})
    flat = flat[[*names, "epoch", "epochs", "complete", *goals, "success"]]
    if not flat["variant"].any():
        names.remove("variant")
    columns = [Column(name, {"variant": "options"}.get(name, name), 0) for name in [*names, "epoch"]]
    columns += [Column(key_of("learned", layer), layer_name(layer)) for layer in layers]
    rows = tuple(_run_row(row, layers) for row in flat.to_dict("records"))
    return Table("learned goals at the last evaluation", (*columns, Column("success", "success")), rows), flat


def _run_row(row: dict[str, Any], layers: Sequence[int]) -> dict[str, Value]:
    """Numbers of a run as `Table` shows them: "6/8" goals, epoch "4 of 20"."""
    for layer in layers:
        learned, goals = (row[key_of(name, layer)] for name in ("learned", "goals"))
        row[key_of("learned", layer)] = None if np.isnan(goals) else f"{learned:.0f}/{goals:.0f}"
    return row | {"epoch": f"{row['epoch']}" + f" of {row['epochs']}" * (row["epoch"] != row["epochs"])}
