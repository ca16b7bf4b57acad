"""What a report calls the cells of a set of runs, in which order they come, and how they look."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

from curiobench.analysis.frames import in_order
from curiobench.palette import line_style

if TYPE_CHECKING:
    import pandas as pd

INK = "var(--ink)"
"""Colour of the page's text, for a method whose line is black: on a dark page it could not be seen."""


class Cell(NamedTuple):
    """The runs of one method, and variant of it, on one task; its seeds are the sample."""

    task: str
    method: str
    variant: str

    @property
    def label(self) -> str:
        """Method and variant."""
        return f"{self.method}, {self.variant}" if self.variant else self.method

    @property
    def look(self) -> str:
        """CSS of its bars."""
        return look_of(self.method)


def look_of(method: str) -> str:
    """CSS of a method's bars: filled in its colour, hatched where its line is dashed."""
    style = line_style(method)
    colour = INK if style["color"] == "#000000" else style["color"]
    return f"--bar: {colour}" + ("; --gap: 2px" if style["linestyle"] == "--" else "")


def cells_of(runs: "pd.DataFrame") -> list[Cell]:
    """The cells in the order of tables."""
    found = runs[["task", "method", "variant"]].astype(str).drop_duplicates().itertuples(index=False, name=None)
    cells = [Cell(*row) for row in found]
    place = {method: i for i, method in enumerate(in_order([cell.method for cell in cells]))}
    return sorted(cells, key=lambda cell: (cell.task, place[cell.method], cell.variant))


def runs_of(runs: "pd.DataFrame", cell: Cell) -> "pd.DataFrame":
    """Rows of the runs of a cell."""
    return runs[(runs["task"] == cell.task) & (runs["method"] == cell.method) & (runs["variant"] == cell.variant)]


def listed(words: Iterable[object]) -> str:
    """Words as a list in a sentence: "a, b and c"."""
    *first, last = map(str, words)
    return f"{', '.join(first)} and {last}" if first else last


def count(number: int, noun: str) -> str:
    """A number of things: "1 run", "27 runs"."""
    return f"{number:,} {noun}" + "s" * (number != 1)
