"""The state of a cell, read from its folder each time, because other grids may change it."""

import csv
from dataclasses import dataclass
from enum import StrEnum
from itertools import groupby
from pathlib import Path

from curiobench.grid.cells import Cell
from curiobench.run_folder import REPLAY, conflict, is_locked, read_config


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
    if why := conflict(cell.path, begun, cell.config):
        return State.CONFLICT, why
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
    size: int = 0
    """Bytes in progress.csv."""


def read_progress(path: Path, known: Progress) -> Progress:
    """Progress of a run; `known` if progress.csv has not changed since, is missing, or is just being written."""
    try:
        file = (path / "progress.csv").stat()
        if (file.st_size, file.st_mtime) == (known.size, known.written):
            return known
        text = (path / "progress.csv").read_text(encoding="utf-8")
        rows = list(csv.DictReader(text[: text.rfind("\n") + 1].splitlines()))  # without an unfinished last row
        if not rows:
            return Progress()
        learned = [int(row["goals_learned"]) for row in rows if row["goals_learned"]] or [None]
        goals = known.goals or _count_goals(path / "evaluations.csv")
        epoch, seconds = int(rows[-1]["epoch"]), float(rows[-1]["seconds"])
        return Progress(epoch, seconds, learned[-1], goals, file.st_mtime, file.st_size)
    except (OSError, ValueError, KeyError, csv.Error):
        return known


def _count_goals(path: Path) -> int | None:
    """Goals in the first evaluation of a run."""
    with open(path, encoding="utf-8", newline="") as file:
        epochs = (row["epoch"] for row in csv.DictReader(file))
        _, of_first = next(groupby(epochs), (None, ()))
        return sum(1 for _ in of_first) or None
