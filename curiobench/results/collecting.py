"""The runs that paths stand for, each once, and faults about all that cannot be used."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from curiobench.methods.specs import canonical
from curiobench.results.folders import Cell, look
from curiobench.results.published import by_name
from curiobench.results.published_rows import read_published
from curiobench.results.reading import Head, Run, read_head, read_run
from curiobench.workers import parallel_map

FEWEST = 16
"""Run folders a process for which it is worth starting one."""


@dataclass(frozen=True)
class Wanted:
    """How much is read of each run; `read_results` says more."""

    every_goal: bool
    """All details of every evaluation."""
    progress: bool | Sequence[str]
    """Rows of progress.csv, or these columns."""


@dataclass(frozen=True)
class _Loaded:
    """What reading a run folder gave."""

    head: Head | None = None
    """What the run is; None where that cannot be read."""
    run: Run | None = None
    """The run with its rows; None where it is not finished, or they cannot be read."""
    fault: str = ""
    """Why something is None; "" for a run that is not finished."""


class Collector:
    """Collects runs and faults, path after path."""

    def __init__(self, wanted: Wanted, processes: int = 1) -> None:
        self._wanted, self._processes = wanted, processes
        self._seen: set[Path] = set()
        self._kept: dict[str, Run] = {}
        self._unfinished: list[tuple[Head, list[str]]] = []
        self.faults: list[str] = []
        """One line on each folder that gave no run, or not all of it."""
        self.absent: list[str] = []
        """Those for which a path that was asked for gave no run at all."""

    def runs(self) -> list[Run]:
        """Those that can be used."""
        return list(self._kept.values())

    def add(self, path: Path) -> None:
        """Read what a path stands for, but for the rows of runs that are not finished."""
        path = by_name(path)
        try:
            found = look(path)
            published = read_published(path, self._wanted.every_goal) if found.published else []
        except (ValueError, OSError) as error:
            self.absent.append(str(error))
            return
        self.faults += found.faults
        if found.published and self._is_unseen(path):
            for run in published:
                self._keep(run, self.faults)
        folders = [(folder, cell) for folder, cell in found.runs.items() if self._is_unseen(folder)]
        faults = self.absent if path in found.runs else self.faults
        for loaded in parallel_map(partial(_load, self._wanted), folders, self._processes, FEWEST):
            if loaded.head is not None and loaded.head.result is None:
                self._unfinished.append((loaded.head, faults))
            else:
                self._take(loaded, faults)

    def add_unfinished(self) -> None:
        """Read those, too; after all paths, so that none takes the place of a finished one."""
        heads = [head for head, _ in self._unfinished]
        all_loaded = parallel_map(partial(_load_rows, self._wanted), heads, self._processes, FEWEST)
        for loaded, (_, faults) in zip(all_loaded, self._unfinished, strict=True):
            self._take(loaded, faults)
        self._unfinished.clear()

    def leave_out_unfinished(self) -> None:
        """Make each of them a fault."""
        for head, faults in self._unfinished:
            faults.append(f"{head.path} is partial: it has no result.json; left out")
        self._unfinished.clear()

    def _is_unseen(self, path: Path) -> bool:
        """Whether no path before stood for this folder, which is seen from now on."""
        unseen = path.resolve() not in self._seen
        self._seen.add(path.resolve())
        return unseen

    def _take(self, loaded: _Loaded, faults: list[str]) -> None:
        """Keep a run that could be read and is no duplicate; a fault in the rows of a duplicate does not matter."""
        if loaded.head is not None and not self._is_new(loaded.head, faults):
            return
        if loaded.run is None:
            faults.append(f"{loaded.fault}; left out")
            return
        self.faults += loaded.run.notes
        self._kept[loaded.run.head.identity()] = loaded.run

    def _keep(self, run: Run, faults: list[str]) -> None:
        if self._is_new(run.head, faults):
            self._kept[run.head.identity()] = run

    def _is_new(self, head: Head, faults: list[str]) -> bool:
        if first := self._kept.get(head.identity()):
            faults.append(f"{head.path} is a duplicate of {first.head.path}: the same config; left out")
        return first is None


def _load(wanted: Wanted, folder: tuple[Path, Cell | None]) -> _Loaded:
    """Read a run folder, which should hold this cell; not the rows of a run that is not finished."""
    path, cell = folder
    try:
        head = read_head(path)
        if cell is not None:
            _check_cell(head, cell)
    except (ValueError, OSError) as error:
        return _Loaded(fault=_in_words(error))
    return _Loaded(head) if head.result is None else _load_rows(wanted, head)


def _load_rows(wanted: Wanted, head: Head) -> _Loaded:
    try:
        return _Loaded(head, read_run(head, wanted.every_goal, wanted.progress))
    except (ValueError, OSError) as error:
        return _Loaded(head, fault=_in_words(error))


def _in_words(error: Exception) -> str:
    return f"cannot read {error.filename}: {error.strerror}" if isinstance(error, OSError) else str(error)


def _check_cell(head: Head, cell: Cell) -> None:
    """Raises ValueError where a run is not the one that the grid has in its folder."""
    found = tuple(head.config[name] for name in ("task", "method", "seed"))
    if found != (cell.task, canonical(cell.method), cell.seed):
        told = "{} {} seed {}".format(*found)
        raise ValueError(
            f"{head.path} is foreign: it is {told}, not the grid's {cell.task} {cell.method} seed {cell.seed}"
        )
