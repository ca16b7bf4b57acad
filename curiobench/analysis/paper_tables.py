"""Our runs in the shape of the paper's Tables 1 to 4, beside the paper's numbers."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

from curiobench.analysis.frames import Results
from curiobench.analysis.options import PAPER_STEPS, cautions, millions, scale_of, spread
from curiobench.analysis.paper import (
    LEARNED,
    PAPER_GOALS,
    PAPER_TABLES,
    PAPER_TASK,
    QUOTED,
    PaperTable,
)
from curiobench.analysis.summaries import Summary, summarise
from curiobench.analysis.tables import Column, Table, Value, interval_notes, layer_name

_METHODS = tuple(dict.fromkeys(method for table in PAPER_TABLES for method in table.methods))


def paper_tables(results: Results) -> list[Table]:
    """Tables 1 to 4 for every task that there are runs of.

    Raises ValueError where none of the runs is of a method in the paper's tables.
    """
    summaries = [summary for summary in summarise(results) if summary.method in _METHODS]
    if not summaries:
        raise ValueError(f"none of the runs is of a method in the paper's tables, which are {', '.join(_METHODS)}")
    tables = []
    for task, group in groupby(summaries, key=lambda summary: summary.task):
        tables += _tables_of_task(results, task, list(group))
    return tables


def _tables_of_task(results: Results, task: str, summaries: list[Summary]) -> list[Table]:
    goals = summaries[0].goals
    layers = [layer for layer in goals if layer]
    shared = _shared_notes(results, task, summaries)
    *tables, last = (_methods_table(task, layers, table, summaries, shared) for table in PAPER_TABLES)
    last = replace(last, notes=(*last.notes, *_closing_notes(results, task)))
    return [_goals_table(task, goals), *tables, last]


def _shared_notes(results: Results, task: str, summaries: Sequence[Summary]) -> tuple[str, ...]:
    """What each table of a task has to tell, for each may be shown alone."""
    runs = results.runs[results.runs["task"] == task]
    notes = [scale_of(runs), *interval_notes(summaries)]
    if task != PAPER_TASK:
        notes.append(f"the paper's numbers are of {PAPER_TASK}, another task than {task}")
    if not (runs["steps"] == PAPER_STEPS).all():
        notes.append(f"the paper trains {millions(PAPER_STEPS)} steps, these runs {spread(runs['steps'], millions)}")
    return tuple(notes)


def _closing_notes(results: Results, task: str) -> list[str]:
    notes = [
        "the paper tells no spread over seeds",
        f"{' and '.join(QUOTED)} are quoted from the paper; curiobench does not have them",
    ]
    of_task = results.runs.loc[results.runs["task"] == task, "method"]
    if left := [name for name in dict.fromkeys(of_task) if name not in _METHODS]:
        notes.append(f"not in the paper's tables, so not here: {', '.join(left)}")
    return notes + cautions(results.runs[results.runs["task"] == task])


def _paper_columns(task: str) -> list[Column]:
    source = "paper" if task == PAPER_TASK else f"paper, {PAPER_TASK}"
    layers = [Column(f"paper_{k}", f"{source}: {layer_name(k)}", 0) for k, _ in enumerate(PAPER_GOALS, start=1)]
    return [*layers, Column("paper", f"{source}: total", 0)]


def _paper_values(counts: Sequence[int]) -> dict[str, Value]:
    return {f"paper_{layer}": number for layer, number in enumerate(counts, start=1)} | {"paper": sum(counts)}


def _goals_table(task: str, goals: dict[int, int]) -> Table:
    layers = [Column(f"learned_{layer}", layer_name(layer), 0) for layer in goals if layer]
    columns = (Column("task", "task"), *layers, Column("learned", "total", 0), *_paper_columns(task))
    row: dict[str, Value] = {"table": 1, "task": task, "learned": goals[0]} | _paper_values(PAPER_GOALS)
    row |= {f"learned_{layer}": number for layer, number in goals.items() if layer}
    return Table(f"Table 1, {task}: goals", columns, (row,))


def _methods_table(
    task: str, layers: Sequence[int], table: PaperTable, summaries: Sequence[Summary], notes: tuple[str, ...]
) -> Table:
    rows: list[dict[str, Value]] = []
    for method in table.methods:
        ours = [summary for summary in summaries if summary.method == method]
        name = f"{method} (quoted)" if method in QUOTED else method
        row = {"table": table.number, "task": task, "method": name} | _paper_values(LEARNED[method])
        rows += [row | _our_values(summary) for summary in ours] or [row]
    names = [Column("method", "method")]
    if any(row.get("variant") for row in rows):
        names.append(Column("variant", "options"))
    ours = [Column(f"learned_{layer}", layer_name(layer), 1) for layer in layers]
    columns = (*names, Column("seeds", "seeds", 0), *ours, Column("learned", "total", 1), *_paper_columns(task))
    return Table(f"Table {table.number}, {task}: learned goals, {table.about}", columns, tuple(rows), notes)


def _our_values(summary: Summary) -> dict[str, Value]:
    learned = {f"learned_{layer}": value for layer, value in summary.learned.items() if layer}
    return learned | {"learned": summary.learned[0], "seeds": len(summary.seeds), "variant": summary.variant}


def flat_paper_table(tables: Sequence[Table]) -> Table:
    """The tables one below the other, for csv files, with their numbers in the paper."""
    first = {key: Column(key, key) for key in ("table", "task", "method", "variant", "seeds")}
    numbers = {column.key: Column(column.key, column.key) for table in tables for column in table.columns}
    rows = tuple(row for table in tables for row in table.rows)
    return Table("", tuple((first | numbers).values()), rows)
