"""Which run folders a path stands for, and which of them a grid expects there."""

from dataclasses import dataclass, field
from os.path import isfile  # which raises nothing, where Path.exists may
from pathlib import Path, PurePosixPath
from typing import Any

from curiobench.files import read_json

GRID_FORMAT = "curiobench grid"
PUBLISHED_FILES = ("runs.csv", "evaluations.csv.gz", "progress.csv.gz")
"""What a published set holds, `Results` as files."""
CONFIGS = "configs"
"""Folder of a published set with each run's config.json, named after the run."""
_MAX_GRID_BYTES = 1 << 24


@dataclass(frozen=True)
class Cell:
    """A run that a grid expects."""

    task: str
    """Task."""
    method: str
    """Method spec."""
    seed: int
    """Seed."""


@dataclass(frozen=True)
class Found:
    """What a path stands for."""

    runs: dict[Path, Cell | None] = field(default_factory=dict)
    """Run folders, with the cell of the grid that each should be."""
    published: bool = False
    """The path is a published set."""
    faults: tuple[str, ...] = ()
    """One line on each folder that is missing, or is none of a grid's."""


def look(path: Path) -> Found:
    """What a path stands for: one run folder, a folder of run folders, or a published set.

    Raises ValueError where it is none of these, or a grid's list of cells cannot be read.
    """
    if not path.is_dir():
        raise ValueError(f"{path} is no run folder: {'it is no folder' if isfile(path) else 'it does not exist'}")
    if isfile(path / "config.json"):
        return Found({path: None})
    if all(isfile(path / name) for name in PUBLISHED_FILES):
        return Found(published=True)
    inside = sorted(child for child in path.iterdir() if child.is_dir() and not child.name.startswith("."))
    if isfile(path / "grid.json"):
        return _look_at_grid(path, inside)
    runs = [child for child in inside if isfile(child / "config.json")]
    if not runs:
        raise ValueError(f"{path} is no run folder: it has no config.json, nor has a folder in it")
    foreign = tuple(f"{child} is no run folder: it has no config.json" for child in inside if child not in runs)
    return Found(dict.fromkeys(runs), faults=foreign)


def _look_at_grid(path: Path, inside: list[Path]) -> Found:
    cells = read_cells(path / "grid.json")
    runs, faults = {}, []
    for folder, cell in cells.items():
        if isfile(path / folder / "config.json"):
            runs[path / folder] = cell
        else:
            faults.append(f"{path / folder} is missing: the grid's {cell.task} {cell.method} seed {cell.seed}")
    expected = {path / PurePosixPath(folder).parts[0] for folder in cells}
    for child in inside:
        if child not in expected:
            kind = "a run, but not one of the grid's" if isfile(child / "config.json") else "no run folder"
            faults.append(f"{child} is foreign: it is {kind}; left out")
    return Found(runs, faults=tuple(faults))


def read_cells(path: Path) -> dict[str, Cell]:
    """The cells of a grid by folder, from its grid.json; raises ValueError where it is damaged."""
    if not path.is_file() or path.stat().st_size > _MAX_GRID_BYTES:
        raise ValueError(f"{path} is no list of cells")
    grid = read_json(path)
    if grid.get("format") != GRID_FORMAT:
        raise ValueError(f"{path} is not a grid's: its format is {grid.get('format')!r:.80}")
    if not isinstance(grid.get("cells"), list):
        raise ValueError(f"{path} has no list of cells")
    return {_folder(path, cell): Cell(cell["task"], cell["method"], cell["seed"]) for cell in grid["cells"]}


def _folder(path: Path, cell: Any) -> str:
    """Folder of a cell, checked: it lies below the grid's."""
    kinds = {"folder": str, "task": str, "method": str, "seed": int}
    sound = isinstance(cell, dict) and all(type(cell.get(name)) is kind for name, kind in kinds.items())
    if not sound or not (cell["task"] + cell["method"]).isprintable():
        raise ValueError(f"{path} has a damaged cell: {str(cell)[:80]!r}")
    folder = PurePosixPath(cell["folder"])
    if folder.is_absolute() or ".." in folder.parts or not folder.parts or not cell["folder"].isprintable():
        raise ValueError(f"{path} has the cell {cell['folder']!r}; a cell is a folder below the grid's")
    return cell["folder"]
