"""The numbers of the paper, Han et al. (2023), doi 10.3389/fnbot.2023.1089270, and our runs in its Tables 1 to 4."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import pandas as pd

from curiobench.analysis.samples import TaskSamples
from curiobench.analysis.tables import Column, Summary, Table, Value, interval_notes, key_of, layer_name, name_columns
from curiobench.analysis.variants import PAPER_STEPS, cautions, millions, spread

PAPER_TASK = "stack3"
PAPER_GOALS = (8, 21, 6)  # Table 1: goals of one, two and three layers

LEARNED = {
    "sac": (1, 0, 0),
    "icm": (4, 0, 0),
    "rnd": (4, 0, 0),
    "dac": (6, 3, 0),
    "re3": (7, 5, 0),
    "mihm": (8, 21, 2),
    "icm+hm": (7, 6, 0),
    "rnd+hm": (8, 6, 0),
    "mi": (8, 17, 0),
    "decstr": (8, 21, 5),
    "mcher": (3, 0, 0),
}
"""Tables 2 to 4: goals of one, two and three layers with a final success rate above 80 %, by method as we spell it."""

CURIOUS = ("sac", "icm", "rnd", "dac", "re3", "mihm")
ABLATIONS = ("icm+hm", "rnd+hm", "mi", "mihm")  # methods of Figure 7; those of Figure 4 are `CURIOUS`

PAPER_TABLES = {
    2: ("curiosity methods", CURIOUS),
    3: ("ablations", ABLATIONS),
    4: ("other approaches", ("mihm", "decstr", "mcher")),
}
"""Subject and rows of the tables with learned goals, by number."""


def paper_tables(summaries: Sequence[Summary]) -> list[Table]:
    """Tables 1 to 4 for every task that there are runs of.

    Raises ValueError if no summary has a method of the paper's tables.
    """
    ours = [summary for summary in summaries if summary.sample.method in LEARNED]
    if not ours:
        raise ValueError(f"no run has a method of the paper's tables, which are {', '.join(LEARNED)}")
    groups = groupby(ours, key=lambda summary: summary.task)
    return [table for task, group in groups for table in _tables_of_task(task, list(group))]


def _tables_of_task(task: TaskSamples, summaries: list[Summary]) -> list[Table]:
    notes = _shared_notes(task, summaries)
    *tables, last = (_methods_table(task, number, summaries, notes) for number in PAPER_TABLES)
    return [_goals_table(task), *tables, replace(last, notes=(*last.notes, *_closing_notes(task)))]


def _shared_notes(task: TaskSamples, summaries: Sequence[Summary]) -> tuple[str, ...]:
    """The notes under each table of a task, for each may be printed alone."""
    notes, steps = [task.scale, *interval_notes(summaries)], task.runs["steps"]
    if task.task != PAPER_TASK:
        notes.append(f"the paper's numbers are of {PAPER_TASK}, another task than {task.task}")
    if not (steps == PAPER_STEPS).all():
        notes.append(f"the paper trains {millions(PAPER_STEPS)} steps, these runs {spread(steps, millions)}")
    return tuple(notes)


def _closing_notes(task: TaskSamples) -> list[str]:
    notes = ["the paper tells no spread over seeds"]
    if left := [name for name in dict.fromkeys(task.runs["method"]) if name not in LEARNED]:
        notes.append(f"not in the paper's tables, so not here: {', '.join(left)}")
    return notes + cautions(task.runs)


def _paper_columns(task: str) -> list[Column]:
    source = "paper" if task == PAPER_TASK else f"paper, {PAPER_TASK}"
    return [Column(key_of("paper", layer), f"{source}: {layer_name(layer)}", 0) for layer in (1, 2, 3, 0)]


def _paper_values(counts: Sequence[int]) -> dict[str, Value]:
    return {f"paper_{layer}": number for layer, number in enumerate(counts, start=1)} | {"paper": sum(counts)}


def _our_columns(task: TaskSamples, digits: int) -> list[Column]:
    return [Column(key_of("learned", layer), layer_name(layer), digits) for layer in (*filter(None, task.sizes), 0)]


def _goals_table(task: TaskSamples) -> Table:
    columns = (Column("task", "task"), *_our_columns(task, 0), *_paper_columns(task.task))
    goals = {key_of("learned", layer): number for layer, number in task.sizes.items()}
    row = {"table": 1, "task": task.task} | _paper_values(PAPER_GOALS) | goals
    return Table(f"Table 1, {task.task}: goals", columns, (row,))


def _methods_table(task: TaskSamples, number: int, summaries: Sequence[Summary], notes: tuple[str, ...]) -> Table:
    about, methods = PAPER_TABLES[number]
    rows: list[dict[str, Value]] = []
    for method in methods:
        row = {"table": number, "task": task.task, "method": method} | _paper_values(LEARNED[method])
        rows += [row | s.values for s in summaries if s.sample.method == method] or [row]
    names = name_columns([summary for summary in summaries if summary.sample.method in methods])
    columns = (*names, *_our_columns(task, 1), *_paper_columns(task.task))
    return Table(f"Table {number}, {task.task}: learned goals, {about}", columns, tuple(rows), notes)


def flat_paper_table(tables: Sequence[Table]) -> pd.DataFrame:
    """The tables one below the other, for csv files, with their numbers in the paper."""
    keys = ["table", "task", "method", "variant", "seeds"]
    keys += [column.key for table in tables for column in table.columns]
    return pd.DataFrame([row for table in tables for row in table.rows], columns=list(dict.fromkeys(keys)))
