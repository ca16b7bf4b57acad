"""The cells of a grid: config, command and folder of each. grid.json lists them for tables."""

import fcntl
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from curiobench.analysis.folders import GRID_FILE, GRID_FORMAT, read_grid
from curiobench.cli.train_arguments import flags_of, parse_train
from curiobench.config import RunConfig
from curiobench.files import write_json, writing_to
from curiobench.grid.definition import Grid, Options
from curiobench.methods.specs import display_name
from curiobench.options import flatten
from curiobench.tasks.registration import check_name

_AXES = {"task": "tasks", "method": "methods", "seed": "seeds"}
"""Options that are axes of the grid, and the keys that give them."""
_OF_ALL = {"preset": "preset", "robot": "robot"}
"""Options with keys of their own; variants may still change them."""
_METHOD_OPTION = re.compile(r"method\.[a-z0-9-]+")


@dataclass(frozen=True)
class Cell:
    """One run of a grid."""

    out: Path
    """Folder of the grid."""
    folder: str
    """Name of the run folder in it."""
    method: str
    """Method spec for display: `mihm`, not `mi+hm`."""
    variant: str
    """Name of the variant; empty where the grid has none."""
    config: RunConfig
    """Config of the run."""
    arguments: tuple[str, ...]
    """Arguments of `curiobench train`."""

    @property
    def path(self) -> Path:
        """The run folder."""
        return self.out / self.folder

    @property
    def log(self) -> Path:
        """What the training process prints. Not in the run folder, which has to be empty before `train` begins."""
        return self.out / f"{self.folder}.log"

    @property
    def command(self) -> tuple[str, ...]:
        """The command line that trains it."""
        return ("curiobench", "train", *self.arguments)


def cells_of(grid: Grid, out: Path) -> list[Cell]:
    """All cells, ordered by seed, so that methods can be compared before the grid is finished.

    Raises ValueError where a task, method or option is wrong; one line that says which.
    """
    _check_names(grid.options, _AXES | _OF_ALL)
    for options in grid.variants.values():
        _check_names(options, _AXES)
    axes = product(grid.tasks, grid.methods, grid.variants)
    cells = [cell for axis in axes for cell in _seeds_of_one(grid, out, *axis)]
    cells.sort(key=lambda cell: grid.seeds.index(cell.config.seed))
    folders = [cell.folder for cell in cells]
    if doubled := [name for name in folders if folders.count(name) > 1]:
        raise ValueError(f"two cells would share the folder {doubled[0]}; is a method named twice?")
    return cells


def _seeds_of_one(grid: Grid, out: Path, task: str, method: str, variant: str) -> list[Cell]:
    """The cells that differ in their seed alone, whose options are read once."""
    options = {"preset": grid.preset, "robot": grid.robot, **grid.options, **grid.variants[variant]}
    flags = [flag for name, value in options.items() for flag in flags_of(name, value)]
    try:
        config = parse_train(["--task", task, "--method", method, *flags, *flags_of("out", str(out))]).config
    except ValueError as error:
        raise ValueError(f"{' '.join(filter(None, (task, method, variant)))}: {error}") from None
    method = display_name(config.method)
    cells = []
    for seed in grid.seeds:
        folder = "-".join(filter(None, (task, folder_name(method), variant, str(seed))))
        axes = ("--task", task, "--method", method, "--seed", str(seed))
        arguments = (*axes, *flags, *flags_of("out", str(out / folder)), "--resume")
        cells.append(Cell(out, folder, method, variant, replace(config, seed=seed), arguments))
    return cells


def folder_name(method: str) -> str:
    """A method spec as part of a folder's name: `package.module:Class` loses its colon."""
    return re.sub(r"[^\w.+-]", ".", method)


def _check_names(options: Options, keys: Mapping[str, str]) -> None:
    """Check that options exist and have no key of their own. The parser also accepts such flags as --help."""
    own = (*_AXES, *_OF_ALL, "method_config")
    fields = [name for name in flatten(RunConfig().to_json()) if name not in own]
    legal = (*_OF_ALL, *(name.replace("_", "-") for name in fields))
    for name in options:
        if key := keys.get(name):
            raise ValueError(f"{name} cannot be given in options; use --{key}, or the key {key} of the file")
        if not _METHOD_OPTION.fullmatch(name):
            check_name("option", name, legal)


def write_record(out: Path, cells: Sequence[Cell], command: Sequence[str]) -> None:
    """Add cells to the folder's grid.json, which is created with the folder if there is none.

    Args:
        out: folder of the grid.
        cells: to add; one that has begun already keeps the command that began it.
        command: the command line of the grid, for the record.

    Raises ValueError, one line, if the file is not a grid's or the folder cannot be written.
    """
    with writing_to(out):
        out.mkdir(parents=True, exist_ok=True)
        with open(out / ".grid.lock", "a", encoding="utf-8") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # waits for other grids; ends with the process
            record = read_grid(out) if (out / GRID_FILE).exists() else {"cells": []}
            entries = {entry["folder"]: entry for entry in record["cells"]}
            for cell in cells:
                if cell.folder not in entries or not (cell.path / "config.json").exists():
                    entries[cell.folder] = _entry(cell)
            this = shlex.join(command)
            commands = [*(known for known in record.get("commands", []) if known != this), this]
            write_json(out / GRID_FILE, {"format": GRID_FORMAT, "commands": commands, "cells": [*entries.values()]})


def _entry(cell: Cell) -> dict[str, Any]:
    return {
        "folder": cell.folder,
        "task": cell.config.task,
        "method": cell.method,
        "seed": cell.config.seed,
        "variant": cell.variant,
        "command": shlex.join(cell.command),
    }
