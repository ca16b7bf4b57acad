"""Find out what a path is: a run folder, a folder of run folders, a grid or a published set. Does not import pandas."""

import hashlib
import os
import re
from collections.abc import Sequence
from os.path import isfile  # unlike Path.exists, it never raises
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from curiobench.files import read_content, read_json
from curiobench.methods.specs import display_name
from curiobench.tasks.registration import TASKS

GRID_FILE, GRID_FORMAT = "grid.json", "curiobench grid"
PUBLISHED_FILES = ("runs.csv", "evaluations.csv.gz", "progress.csv.gz")
"""Files of the frames `runs`, `evaluations` and `progress` of a published set."""
CONFIGS = "configs"  # folder of a published set with each run's config.json, named after the run
AGENTS = "agents"  # folder of a published set with trained agents; each is a folder TASK-METHOD with two files
WEIGHTS = "agent.safetensors"
AGENT_FILES = ("config.json", WEIGHTS)
SUMS = "SHA256SUMS"  # digests of a set's files, in the format of `sha256sum --check`
_VERSION = re.compile(r"v[1-9]\d*")


class GridRun(NamedTuple):
    """A run that a grid expects in a folder."""

    task: str
    method: str
    seed: int

    def __str__(self) -> str:
        return f"{self.task} {self.method} seed {self.seed}"


def is_published(path: Path) -> bool:
    """Whether a folder is a published set."""
    return not isfile(path / "config.json") and all(isfile(path / name) for name in PUBLISHED_FILES)


def find_runs(path: Path) -> tuple[dict[Path, GridRun | None], list[str]]:
    """Run folders at a path, each with the run that a grid expects in it, and a line on each missing or foreign folder.

    Raises ValueError if the path is not a folder, holds no run, or has a damaged grid.json.
    """
    if not path.is_dir():
        raise ValueError(_why_no_folder(path))
    if isfile(path / "config.json"):
        return {path: None}, []
    inside = sorted(child for child in path.iterdir() if child.is_dir() and not child.name.startswith("."))
    runs = [child for child in inside if isfile(child / "config.json")]
    if isfile(path / GRID_FILE):
        cells = read_grid(path)["cells"]
        expected = {path / cell["folder"]: GridRun(*map(cell.get, GridRun._fields)) for cell in cells}
        found = {folder: run for folder, run in expected.items() if isfile(folder / "config.json")}
        faults = [f"{folder} is missing: the grid's {run}" for folder, run in expected.items() if folder not in found]
        ours = {path / folder.relative_to(path).parts[0] for folder in expected}
        for child in (child for child in inside if child not in ours):
            kind = "a run, but not one of the grid's" if child in runs else "not a run folder"
            faults.append(f"{child} is foreign: it is {kind}; left out")
        return found, faults
    if not runs:
        raise ValueError(f"{path} has no config.json, and neither has any folder in it")
    return dict.fromkeys(runs), [
        f"{child} is not a run folder: it has no config.json" for child in inside if child not in runs
    ]


def _why_no_folder(path: Path) -> str:
    """Why a path, which is not a folder, leads to no run."""
    if isfile(path):
        return f"{path} is a file, not a folder"
    sets = f", neither as a path nor as a published set ({', '.join(available()) or 'there are none'})"
    return f"{path} does not exist{sets if _VERSION.fullmatch(str(path)) else ''}"


def read_grid(path: Path) -> dict[str, Any]:
    """The content of a folder's grid.json. Raises ValueError if it cannot be read or has a damaged cell."""
    file = path / GRID_FILE
    grid = read_json(file)
    if grid.get("format") != GRID_FORMAT:
        found = f"format is {grid.get('format')!r:.80}, expected {GRID_FORMAT!r}"
        raise ValueError(f"{file} was not written by `curiobench grid`: {found}")
    if not isinstance(grid.get("cells"), list) or not isinstance(grid.get("commands", []), list):
        raise ValueError(f"{file} has no list of cells and of commands")
    for cell in grid["cells"]:
        _check_cell(file, cell)
    return grid


def _check_cell(file: Path, cell: Any) -> None:
    """Raises ValueError if a cell of grid.json lacks a field, or its folder is not inside the grid's folder."""
    kinds = {"folder": str, "task": str, "method": str, "seed": int}
    sound = isinstance(cell, dict) and all(type(cell.get(name)) is kind for name, kind in kinds.items())
    if not sound or not (cell["task"] + cell["method"]).isprintable():
        raise ValueError(f"{file} has a damaged cell: {str(cell)[:80]!r}")
    folder = PurePosixPath(cell["folder"])
    if folder.is_absolute() or ".." in folder.parts or not folder.parts or not cell["folder"].isprintable():
        raise ValueError(f"{file} has the cell {cell['folder']!r}; a cell is a folder below the grid's")


def available() -> list[str]:
    """Names of the published sets in this package, oldest first."""
    paths = _home().iterdir() if _home().is_dir() else ()
    names = [path.name for path in paths if _VERSION.fullmatch(path.name) and is_published(path)]
    return sorted(names, key=lambda name: int(name[1:]))


def locate(name: str | Path) -> Path:
    """Folder of a published set by its name or path. Raises ValueError if there is no such set."""
    if isinstance(name, str) and name in available():
        return _home() / name
    if is_published(Path(name)):
        return Path(name)
    names = ", ".join(available()) or "none yet"
    raise ValueError(
        f"there are no published results {str(name)!r}: available are {names}, and paths of published sets"
    )


def by_name(path: Path) -> Path:
    """Folder of the published set in this package with a name such as v2. Any other path is returned unchanged."""
    name = str(path)
    return _home() / name if _VERSION.fullmatch(name) and not os.path.lexists(path) and name in available() else path


def agent_name(task: str, method: str) -> str:
    """Name of an agent's folder in a set's `agents` folder."""
    return f"{task}-{display_name(method).replace(':', '_')}"


def agents_of(folder: Path) -> list[str]:
    """Sorted names of the agents in a published set; an empty list if it has no agents."""
    found = (folder / AGENTS).glob("*")
    return sorted(path.name for path in found if all(isfile(path / file) for file in AGENT_FILES))


def find_agent(path: Path) -> Path | None:
    """Folder of the agent at a path SET/TASK/METHOD such as v2/stack3/mihm; None for any other path.

    SET is the name or path of a published set. Raises ValueError if the set has no such agent, or the agent's files do
    not have the published digests.
    """
    for part in (path, path.parent):
        if part.name and is_published(by_name(part)):
            raise ValueError(f"{path} is not a published agent; {_told(part, agents_of(by_name(part)))}")
    folder = by_name(path.parent.parent)
    if path.parent.name in ("", "..") or not is_published(folder):
        if _VERSION.fullmatch(str(folder)) and not os.path.lexists(folder):
            locate(str(folder))  # raises
        return None
    task, method, names = path.parent.name, path.name, agents_of(folder)
    name = next((name for name in (agent_name(task, method), f"{task}-{method}") if name in names), None)
    if name is None:
        raise ValueError(f"{path} is not a published agent; {_told(path.parent.parent, names)}")
    check_sums(folder, tuple(f"{AGENTS}/{name}/{file}" for file in AGENT_FILES))
    return folder / AGENTS / name


def named_agent(path: Path, task: str | None, method: str | None) -> Path:
    """For a published set, the path of its agent of a task and method, as `find_agent` reads it.

    Any other path is returned unchanged. Raises ValueError if `task` and `method` do not identify one agent.
    """
    if not is_published(folder := by_name(path)):
        if task is not None:
            raise ValueError(f"--task is only for published sets, and {path} is not one")
        return path
    names = agents_of(folder)
    tasks = [name for name in TASKS if agent_name(name, method or "") in names] if task is None else [task]
    if method is not None and len(tasks) == 1:
        return path / tasks[0] / method
    if method is not None and tasks:
        raise ValueError(f"{method} has agents of several tasks in {path}: add --task {' or --task '.join(tasks)}")
    raise ValueError(f"--method must name an agent of {path}; {_told(path, names)}")


def _told(path: Path, agents: Sequence[str]) -> str:
    """The agents of the set at a path, as `find_agent` reads them."""
    paths = [str(path / name.replace("-", "/", 1)) for name in agents]
    return f"available: {', '.join(paths)}" if paths else f"{path} has only rows and configs of its runs, no agents"


def check_sums(folder: Path, files: tuple[str, ...] = PUBLISHED_FILES) -> None:
    """Raises ValueError if the digest of a file in a published set differs from the one in SHA256SUMS."""
    sums = read_sums(folder)
    for name in files:
        if sums.get(name) != hashlib.sha256(read_content(folder / name)).hexdigest():
            raise ValueError(f"{folder / name} was changed after publishing: its SHA-256 is not the one in {SUMS}")


def read_sums(folder: Path) -> dict[str, str]:
    """Digests by file name, from a set's SHA256SUMS. Raises ValueError if it cannot be read."""
    path = folder / SUMS
    if not isfile(path):  # reading a named pipe would never end
        raise ValueError(f"cannot read {path}: not a regular file")
    lines = read_content(path).decode(errors="replace").splitlines()
    return {file: digest for digest, _, file in (line.partition("  ") for line in lines)}


def _home() -> Path:
    """Folder of the published sets: `results` in a working copy, `curiobench/published` in an installed package."""
    package = Path(__file__).resolve().parents[1]
    working_copy = package.parent / "pyproject.toml"
    return package.parent / "results" if working_copy.exists() else package / "published"
