"""The tables of `curiobench table` as a report shows them: the same numbers, with what their columns are sorted by."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from curiobench.analysis.report_cells import look_of
from curiobench.analysis.summaries import Estimate, summarise
from curiobench.analysis.tables import Column, Table, Value, method_tables

if TYPE_CHECKING:
    from curiobench.analysis.frames import Results

MISSING = "–"


class Heading(NamedTuple):
    """The head of a column."""

    name: str
    numeric: bool = False
    """Its values are numbers: the largest come first when it is sorted."""


class Entry(NamedTuple):
    """What stands in a table."""

    text: str
    order: str
    """Text or number that its column is sorted by; "" comes last."""
    numeric: bool = False
    interval: str = ""
    """Ends of the interval around it."""
    best: bool = False
    """It is better than all others of its column beyond doubt."""
    look: str = ""
    """CSS of a sample of its method's bars."""


@dataclass(frozen=True)
class ShownTable:
    """A table of a report."""

    title: str
    headings: tuple[Heading, ...]
    rows: tuple[tuple[Entry, ...], ...]
    """The first entry of each is its name."""
    notes: tuple[str, ...]


def tables(results: "Results", baseline: str, told: Sequence[str] = ()) -> list[ShownTable]:
    """The tables of methods of every task.

    Args:
        results: the runs, of which there is at least one.
        baseline: method that the others are compared with.
        told: notes that the page has elsewhere.
    """
    return [_shown(table, told) for table in method_tables(results, summarise(results, baseline), baseline)]


def _shown(table: Table, told: Sequence[str]) -> ShownTable:
    best = {column.key: table.best(column) for column in table.columns}
    rows = [
        tuple(_entry(row.get(column.key), column, best[column.key] == place) for column in table.columns)
        for place, row in enumerate(table.rows)
    ]
    headings = [
        Heading(column.heading, all(row[i].numeric or row[i].text == MISSING for row in rows))
        for i, column in enumerate(table.columns)
    ]
    return ShownTable(
        table.title, tuple(headings), tuple(rows), tuple(note for note in table.notes if note not in told)
    )


def _entry(value: Value, column: Column, best: bool) -> Entry:
    if value is None or value != value:
        return Entry(MISSING, "")
    if isinstance(value, str):
        return _text_entry(value, column)
    number = value.value if isinstance(value, Estimate) else value
    interval = ""
    if isinstance(value, Estimate) and value.has_interval:
        interval = f"[{value.low:.{column.digits}f}, {value.high:.{column.digits}f}]"
    text = str(number) if isinstance(number, int) else f"{number:.{column.digits}f}"
    return Entry(text, repr(float(number)), True, interval, best)


def _text_entry(text: str, column: Column) -> Entry:
    first = text.partition(" ")[0]
    if column.key == "epochs_to_good":
        return Entry(text, first, True)
    return Entry(text, text, look=look_of(text) if column.key == "method" else "")
