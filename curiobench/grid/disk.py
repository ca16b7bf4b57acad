"""The state of a cell, read from its folder each time, because other grids may change it."""

import csv
from dataclasses import dataclass
from enum import StrEnum
from itertools import groupby
from pathlib import Path
from typing import Any

from curiobench.config import obstacles
from curiobench.grid.cells import Cell
from curiobench.run_folder import REPLAY, is_locked, read_config


class State(StrEnum):
    """State of a cell."""

    WAITING = "waiting"
    RUNNING = "running"
    ELSEWHERE = "elsewhere"
    """Another process trains in its folder."""
    FINISHED = "finished"
    BROKEN = "broken"
    CONFLICT = "conflict"
    """Its folder holds something else, which is not changed."""
    STOPPED = "stopped"


def cell_state(cell: Cell) -> tuple[State, str]:
    """State of a cell that this grid does not run, and the reason if it is a conflict."""
    if not (cell.path / "config.json").exists():
        return (State.ELSEWHERE if is_locked(cell.path) else State.WAITING), ""
    try:
        begun = read_config(cell.path, {cell.config.method})
    except ValueError as error:
        return State.CONFLICT, str(error)
    if found := obstacles(begun, cell.config):
        return State.CONFLICT, f"the run in {cell.path} has other options: {'; '.join(found)}"
    if (cell.path / "result.json").exists():
        if begun.epochs == cell.config.epochs:
            return State.FINISHED, ""
        if not (cell.path / REPLAY).is_dir():
            return State.CONFLICT, f"{cell.path} has {begun.epochs} epochs and no replay, so it cannot be lengthened"
    return (State.ELSEWHERE if is_locked(cell.path) else State.WAITING), ""


@dataclass
class Progress:
    """Progress of a run."""

    epoch: int = 0
    """Epochs completed."""
    seconds: float = 0.0
    """Wall-clock time that they took."""
    learned: int | None = None
    """Goals learned at the last evaluation after an epoch."""
    goals: int | None = None
    """All goals."""
    written: float = 0.0
    """When the last row was written, in seconds since 1970."""


class ProgressReader:
    """Follows progress.csv of a run folder; reads it only when it has changed."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stamp: tuple[int, int] | None = None
        self.progress = Progress()

    def update(self) -> Progress:
        """The present progress."""
        try:
            status = (self._path / "progress.csv").stat()
            if (status.st_size, status.st_mtime_ns) != self._stamp:
                self.progress = self._read(status.st_mtime)
                self._stamp = (status.st_size, status.st_mtime_ns)
        except (OSError, ValueError, KeyError, csv.Error):
            pass  # missing, or just being written: read again at the next call
        return self.progress

    def _read(self, written: float) -> Progress:
        rows = _complete_rows(self._path / "progress.csv")
        if not rows:
            return Progress()
        learned = [row["goals_learned"] for row in rows if row["goals_learned"]]
        goals = self.progress.goals or _count_goals(self._path / "evaluations.csv")
        last = rows[-1]
        return Progress(
            int(last["epoch"]), float(last["seconds"]), int(learned[-1]) if learned else None, goals, written
        )


def _complete_rows(path: Path) -> list[dict[str, Any]]:
    """Rows of a csv file that another process may be appending to."""
    text = path.read_text(encoding="utf-8")
    return list(csv.DictReader(text[: text.rfind("\n") + 1].splitlines()))


def _count_goals(path: Path) -> int | None:
    """Goals in the first evaluation of a run."""
    with open(path, encoding="utf-8", newline="") as file:
        epochs = (row["epoch"] for row in csv.DictReader(file))
        _, of_first = next(groupby(epochs), (None, ()))
        return sum(1 for _ in of_first) or None
