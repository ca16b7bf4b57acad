"""Tables of results: what stands in their rows and columns. How they are written is table_formats.py's business."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from curiobench.analysis.frames import Results
from curiobench.analysis.options import cautions, hour_digits, scale_of
from curiobench.analysis.statistics import ENOUGH_SEEDS, seed_warnings
from curiobench.analysis.summaries import GOOD_SUCCESS, Estimate, Summary, run_rows, untrained

Value = str | int | float | Estimate | None

CLOCK = "hours are of the clock, also where runs shared their machine with other work"
RARE = 100
"""One comparison of equals in so many is let pass without a word."""


@dataclass(frozen=True)
class Column:
    """A column of a table."""

    key: str
    """Name in csv files."""
    heading: str
    """Name elsewhere."""
    digits: int = 2
    """Decimals, except in csv files."""
    contest: bool = False
    """More is better: the best value is set in bold if its interval lies above all others."""


@dataclass(frozen=True)
class Table:
    """A table; `None` in a row is printed as a dash."""

    title: str
    """What it shows."""
    columns: tuple[Column, ...]
    """Its columns, names first."""
    rows: tuple[dict[str, Value], ...]
    """Values by column."""
    notes: tuple[str, ...] = ()
    """Lines below it."""

    def best(self, column: Column) -> int | None:
        """Row of the value that is better than all others beyond doubt; None where there is none, or too few seeds."""
        values = [row.get(column.key) for row in self.rows]
        if not column.contest or len(values) < 2:
            return None
        if min(row.get("seeds", ENOUGH_SEEDS) for row in self.rows) < ENOUGH_SEEDS:
            return None  # intervals of so few seeds miss the truth too often
        if not all(isinstance(value, Estimate) and value.has_interval for value in values):
            return None
        first = max(range(len(values)), key=lambda i: values[i].value)
        others = [value.high for i, value in enumerate(values) if i != first]
        return first if values[first].low > max(others) else None


def method_tables(results: Results, summaries: Sequence[Summary], baseline: str = "sac") -> list[Table]:
    """Three tables a task: learned goals, success and cost, with a row a method and variant.

    Args:
        results: the runs, for what has to be said about all of them.
        summaries: of the runs by `summarise`; at least one.
        baseline: that the summaries were made with.
    """
    tables = []
    for task, group in groupby(summaries, key=lambda summary: summary.task):
        tables += _tables_of_task(results, task, list(group), baseline)
    return tables


def interval_notes(summaries: Sequence[Summary]) -> list[str]:
    """What the brackets are, if there are any, and whether there are too few seeds to conclude from them."""
    brackets = "[ ] 95 % bootstrap interval over seeds"
    sizes = [(", ".join(filter(None, (s.method, s.variant))), len(s.seeds)) for s in summaries]
    return [brackets] * (max(size for _, size in sizes) > 1) + seed_warnings(sizes)


def _tables_of_task(results: Results, task: str, summaries: list[Summary], baseline: str) -> list[Table]:
    layers = sorted({layer for summary in summaries for layer in summary.goals if layer})
    goals = summaries[0].goals
    learned = [Column(f"learned_{k}", f"{layer_name(k)} (of {goals[k]})", 1, contest=True) for k in layers]
    learned.append(Column("learned", f"total (of {goals[0]})", 1, contest=True))
    success = [
        Column("middle_success", "IQM of final success", contest=True),
        Column("success", "final success", contest=True),
        Column("area", "success over training", contest=True),
        Column("epochs_to_good", f"epochs to {GOOD_SUCCESS}"),
    ]
    if any(summary.better is not None for summary in summaries):
        success.append(Column("better", f"P(final > {baseline})"))
        success.append(Column("better_area", f"P(over training > {baseline})"))
    hours = Column("hours", "hours a run", hour_digits(min(summary.hours for summary in summaries)))
    cost = [hours, Column("memory", "peak memory, MB", 0), Column("machine", "machine")]
    names = _name_columns(summaries)
    rows = tuple(_row(summary) for summary in summaries)
    scale, before = scale_of(results.runs[results.runs["task"] == task]), untrained(results, task)
    brackets = interval_notes(summaries)
    of_learned = [] if before is None else [f"before training: {before.learned:.1f} of {goals[0]} goals"]
    of_success = [] if before is None else [f"before training: success {before.success:.2f}"]
    return [
        Table(f"{task}: learned goals", (*names, *learned), rows, (scale, *of_learned, *brackets)),
        Table(
            f"{task}: success",
            (*names, *success),
            rows,
            (scale, *of_success, *brackets, *_comparison_notes(summaries, baseline)),
        ),
        Table(f"{task}: cost", (*names, *cost), rows, (CLOCK, *cautions(results.runs[results.runs["task"] == task]))),
    ]


def _comparison_notes(summaries: Sequence[Summary], baseline: str) -> list[str]:
    """Which methods were not compared with the baseline and why, and how little a probability of 0 or 1 says."""
    others = [summary for summary in summaries if summary.method != baseline]
    notes = []
    missing = [summary.method for summary in others if summary.better is None]
    if missing and len(summaries) > 1:
        which = "" if len(missing) == len(others) else f"{', '.join(dict.fromkeys(missing))} "
        notes.append(f"{which}not compared: that takes two seeds each, and runs of {baseline} of the same length")
    of_baseline = [len(summary.seeds) for summary in summaries if summary.method == baseline]
    sizes = [
        len(s.seeds) for s in others if any(p is not None and p.value in (0, 1) for p in (s.better, s.better_area))
    ]
    if sizes and of_baseline:
        chance = math.comb(min(sizes) + min(of_baseline), min(sizes)) // 2
        if chance < RARE:
            notes.append(
                f"P of 0 or 1 has no interval; with so few seeds, one in {chance} comparisons of equals gives it"
            )
    return notes


def layer_name(layer: int) -> str:
    """Heading of a layer."""
    return "1 layer" if layer == 1 else f"{layer} layers"


def _name_columns(summaries: Sequence[Summary]) -> list[Column]:
    names = [Column("method", "method")]
    if any(summary.variant for summary in summaries):
        names.append(Column("variant", "options"))
    return [*names, Column("seeds", "seeds", 0)]


def _row(summary: Summary) -> dict[str, Value]:
    learned = {f"learned_{layer}": value for layer, value in summary.learned.items() if layer}
    epochs = None if summary.epochs_to is None else f"{summary.epochs_to:.1f}"
    some = "" if summary.reached in (0, len(summary.seeds)) else f" ({summary.reached} of {len(summary.seeds)} seeds)"
    return {
        "method": summary.method,
        "variant": summary.variant,
        "seeds": len(summary.seeds),
        **learned,
        "learned": summary.learned[0],
        "middle_success": summary.middle_success,
        "success": summary.success,
        "area": summary.area,
        "epochs_to_good": None if epochs is None else epochs + some,
        "better": summary.better,
        "better_area": summary.better_area,
        "hours": summary.hours,
        "memory": summary.peak_memory_mb,
        "machine": "; ".join(summary.machines) or None,
    }


def flat_table(summaries: Sequence[Summary], baseline: str = "sac") -> Table:
    """All numbers of `method_tables` in one table for csv files, with one row a task, method and variant."""
    layers = sorted({layer for summary in summaries for layer in summary.goals if layer})
    keys = [
        *("task", "method", "variant", "seeds", "epochs", "goals", "learned"),
        *(f"{part}_{layer}" for layer in layers for part in ("goals", "learned")),
        *("middle_success", "success", "area", "epochs_to_good", "seeds_good", "baseline", "better", "better_area"),
        *("hours", "memory", "machine"),
    ]
    rows = [
        _row(summary)
        | {f"goals_{layer}": number for layer, number in summary.goals.items()}
        | {
            "task": summary.task,
            "epochs": " ".join(map(str, summary.epochs)),
            "goals": summary.goals[0],
            "epochs_to_good": summary.epochs_to,
            "seeds_good": summary.reached,
            "baseline": baseline if summary.better is not None else None,
        }
        for summary in summaries
    ]
    return Table("", tuple(Column(key, key) for key in keys), tuple(rows))


def run_table(results: Results, flat: bool = False) -> Table:
    """A row a run, of which there is at least one: what it is, how far it has come, and its learned goals.

    `flat` gives it the columns for csv files.
    """
    rows = run_rows(results)
    layers = sorted({layer for row in rows for layer in row["learned"] if layer})
    names = ["run", "task", "method", "variant", "seed"]
    if not flat and not any(row["variant"] for row in rows):
        names.remove("variant")
    columns = [Column(name, {"variant": "options"}.get(name, name), 0) for name in names]
    counts = [(f"learned_{layer}", layer_name(layer), layer) for layer in layers] + [("learned", "total", 0)]
    if flat:
        columns += [Column(name, name) for name in ("epoch", "epochs", "complete")]
        columns += [Column(name, name) for key, _, _ in counts for name in (key, key.replace("learned", "goals"))]
        values = [_flat_run(row, counts) for row in rows]
    else:
        columns += [Column("epoch", "epoch"), *(Column(key, heading) for key, heading, _ in counts)]
        values = [_shown_run(row, counts) for row in rows]
    columns.append(Column("success", "success"))
    return Table("learned goals at the last evaluation", tuple(columns), tuple(values))


def _shown_run(row: dict[str, Any], counts: Sequence[tuple[str, str, int]]) -> dict[str, Value]:
    learned = {key: "{}/{}".format(*row["learned"][layer]) for key, _, layer in counts if layer in row["learned"]}
    epoch = str(row["epoch"]) if row["epoch"] == row["epochs"] else f"{row['epoch']} of {row['epochs']}"
    return row | learned | {"epoch": epoch}


def _flat_run(row: dict[str, Any], counts: Sequence[tuple[str, str, int]]) -> dict[str, Value]:
    values = row | {"complete": int(row["complete"])}
    for key, _, layer in counts:
        learned, goals = row["learned"].get(layer, (None, None))
        values |= {key: learned, key.replace("learned", "goals"): goals}
    return values
