"""The list of runs in a report: what each is, what it cost, and the command that made it."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from curiobench.analysis.options import hour_digits
from curiobench.analysis.report_cells import Cell, cells_of, runs_of
from curiobench.analysis.report_tables import MISSING, Entry, Heading

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class RunRow:
    """A run."""

    name: str
    method: str
    """Method and variant, which the list can be reduced to."""
    entries: tuple[Entry, ...]
    """One for each column but the first."""
    command: str
    facts: tuple[tuple[str, str], ...]
    """What else is known about it: name and value."""


_SHOWN: dict[str, Callable[[Any], str] | None] = {
    "task": None,
    "method": None,
    "seed": "{:d}".format,
    "epoch": "{:,d}".format,
    "steps": "{:,d}".format,
    "hours": lambda hours: f"{hours:.{hour_digits(hours)}f}",
    "peak_memory_mb": "{:,.0f}".format,
}
"""Columns of runs that the list shows, and how numbers are written."""
_HEADS = {"epoch": "epochs", "peak_memory_mb": "memory (MB)"}
RUN_HEADINGS = (Heading("run"), *(Heading(_HEADS.get(name, name), write is not None) for name, write in _SHOWN.items()))
"""Heads of its columns."""
_FACTS = {
    "git_commit": "git commit",
    "curiobench": "curiobench",
    "mujoco": "MuJoCo",
    "dm_control": "dm_control",
    "torch": "PyTorch",
    "numpy": "NumPy",
    "python": "Python",
    "machine": "machine",
    "created": "begun",
    "finished": "finished",
    "preset": "preset",
    "robot": "robot",
    "updates": "updates",
}


def run_rows(runs: "pd.DataFrame") -> list[RunRow]:
    """The runs, by cell and seed."""
    return [
        _row(values, cell)
        for cell in cells_of(runs)
        for values in runs_of(runs, cell).sort_values(["seed", "run"]).to_dict("records")
    ]


def _row(values: dict[str, Any], cell: Cell) -> RunRow:
    shown = values | {"method": cell.label}
    facts = [(title, text) for name, title in _FACTS.items() if (text := _fact(values[name]))]
    if not values["complete"]:
        facts.insert(0, ("state", f"not finished: {values['epoch']} of {values['epochs']} epochs"))
    return RunRow(
        name=values["run"],
        method=cell.label,
        entries=tuple(_entry(shown[name], write) for name, write in _SHOWN.items()),
        command=values["command"] or "not recorded",
        facts=tuple(facts),
    )


def _entry(value: Any, write: Callable[[Any], str] | None) -> Entry:
    if write is None:
        return Entry(value, value)
    if math.isnan(value):
        return Entry(MISSING, "", True)
    return Entry(write(value), repr(float(value)), True)


def _fact(value: Any) -> str:
    """Text of a value, "" where it is not known."""
    if isinstance(value, int):
        return f"{value:,}"
    return "" if value is None or value != value else str(value)
