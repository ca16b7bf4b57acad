"""grid.json: the cells that a grid's folder is to hold, so that tables can name those that are missing."""

import fcntl
import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from curiobench.analysis.folders import GRID_FORMAT
from curiobench.files import read_json, write_json
from curiobench.grid.cells import Cell

NAME = "grid.json"


def write_record(out: Path, cells: Sequence[Cell], command: Sequence[str]) -> None:
    """Add cells to the folder's grid.json, which is created with the folder if there is none.

    Args:
        out: folder of the grid.
        cells: to add; one that has begun already keeps the command that began it.
        command: the command line of the grid, for the record.

    Raises ValueError where the file is no grid's or the folder cannot be written; one line.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        with _locked(out / ".grid.lock"):
            record = read_record(out)
            entries = {entry["folder"]: entry for entry in record["cells"]}
            for cell in cells:
                if cell.folder not in entries or not (cell.path / "config.json").exists():
                    entries[cell.folder] = _entry(cell)
            this = shlex.join(command)
            commands = [*(known for known in record["commands"] if known != this), this]
            write_json(out / NAME, {"format": GRID_FORMAT, "commands": commands, "cells": [*entries.values()]})
    except OSError as error:
        raise ValueError(f"cannot write to {out}: {error.strerror}") from None


def read_record(out: Path) -> dict[str, Any]:
    """What grid.json holds, an empty grid where there is none; raises ValueError where it is something else."""
    path = out / NAME
    if not path.exists():
        return {"format": GRID_FORMAT, "commands": [], "cells": []}
    record = read_json(path)
    if record.get("format") != GRID_FORMAT:
        raise ValueError(f"{path} is not a grid's: its format is {record.get('format')!r}")
    cells, commands = record.get("cells"), record.get("commands")
    if not isinstance(commands, list) or not isinstance(cells, list) or not all(map(_is_entry, cells)):
        raise ValueError(f"{path} is damaged: it has no list of cells with folders")
    return record


def _is_entry(value: Any) -> bool:
    return isinstance(value, dict) and isinstance(value.get("folder"), str)


def _entry(cell: Cell) -> dict[str, Any]:
    return {
        "folder": cell.folder,
        "task": cell.config.task,
        "method": cell.method,
        "seed": cell.config.seed,
        "variant": cell.variant,
        "command": shlex.join(cell.command),
    }


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Wait for other grids that write the same record; the lock goes with the process."""
    with open(path, "a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
