"""The runs that paths stand for, each once, and faults about all that cannot be used."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from curiobench.analysis.folders import Cell, look
from curiobench.analysis.published import by_name
from curiobench.analysis.published_rows import read_published
from curiobench.analysis.reading import Head, Run, read_head, read_run
from curiobench.methods.specs import canonical
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
class _Folder:
    """A run folder, before it is read."""

    path: Path
    """Where it is."""
    cell: Cell | None
    """The cell of a grid that it should hold."""


@dataclass(frozen=True)
class _Loaded:
    """What reading a run gave: with neither `run` nor `fault` it is not finished."""

    head: Head | None = None
    """What the run is; None where that cannot be read."""
    run: Run | None = None
    """The run with its rows."""
    fault: str = ""
    """Why it cannot be used."""


class Collector:
    """Collects runs, and faults about all that cannot be used."""

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

    def collect(self, paths: Sequence[Path], unfinished: bool, meanwhile: Callable[[], object]) -> None:
        """Read what the paths stand for; `read_results` tells of `meanwhile`."""
        found = [one for path in paths for one in self._look(by_name(path))]
        folders = [what for what, _ in found if isinstance(what, _Folder)]
        loaded = iter(parallel_map(partial(_load, self._wanted), folders, self._processes, FEWEST, meanwhile))
        for what, faults in found:
            self._take(next(loaded) if isinstance(what, _Folder) else what, faults)
        if unfinished:
            self._take_unfinished()
        else:
            for head, faults in self._unfinished:
                faults.append(f"{head.path} is partial: it has no result.json; left out")

    def _look(self, path: Path) -> Iterator[tuple[_Folder | _Loaded, list[str]]]:
        """What a path stands for, each with the list that a fault of it belongs to."""
        try:
            found = look(path)
            published = read_published(path, self._wanted.every_goal) if found.published else []
        except (ValueError, OSError) as error:
            yield _Loaded(fault=str(error)), self.absent
            return
        for fault in found.faults:
            yield _Loaded(fault=fault), self.faults
        if found.published and self._is_unseen(path):
            for run in published:
                yield _Loaded(run.head, run), self.faults
        for folder, cell in found.runs.items():
            if self._is_unseen(folder):
                yield _Folder(folder, cell), self.absent if folder == path else self.faults

    def _is_unseen(self, path: Path) -> bool:
        """Whether no path before stood for this folder, which is seen from now on."""
        path = path.resolve()
        unseen = path not in self._seen
        self._seen.add(path)
        return unseen

    def _take(self, loaded: _Loaded, faults: list[str]) -> None:
        """Keep a run that can be used and is no duplicate; a fault in the rows of a duplicate does not matter."""
        head, run = loaded.head, loaded.run
        identity = "" if head is None else head.identity()
        if head is not None and run is None and not loaded.fault:
            self._unfinished.append((head, faults))
        elif head is not None and (first := self._kept.get(identity)):
            faults.append(f"{head.path} is a duplicate of {first.head.path}: the same config; left out")
        elif run is None:
            faults.append(loaded.fault)
        else:
            self.faults += run.notes
            self._kept[identity] = run

    def _take_unfinished(self) -> None:
        """Read those, too; after all others, so that none takes the place of a finished one."""
        heads = [head for head, _ in self._unfinished]
        all_loaded = parallel_map(partial(_load_rows, self._wanted), heads, self._processes, FEWEST)
        for loaded, (_, faults) in zip(all_loaded, self._unfinished, strict=True):
            self._take(loaded, faults)


def _load(wanted: Wanted, folder: _Folder) -> _Loaded:
    """Read a run folder, but not the rows of a run that is not finished."""
    try:
        head = read_head(folder.path)
        if folder.cell is not None:
            _check_cell(head, folder.cell)
    except (ValueError, OSError) as error:
        return _Loaded(fault=_left_out(error))
    return _Loaded(head) if head.result is None else _load_rows(wanted, head)


def _load_rows(wanted: Wanted, head: Head) -> _Loaded:
    try:
        return _Loaded(head, read_run(head, wanted.every_goal, wanted.progress))
    except (ValueError, OSError) as error:
        return _Loaded(head, fault=_left_out(error))


def _left_out(error: Exception) -> str:
    """An error in words."""
    told = f"cannot read {error.filename}: {error.strerror}" if isinstance(error, OSError) else str(error)
    return f"{told}; left out"


def _check_cell(head: Head, cell: Cell) -> None:
    """Raises ValueError where a run is not the one that the grid has in its folder."""
    found = tuple(head.config[name] for name in ("task", "method", "seed"))
    if found != (cell.task, canonical(cell.method), cell.seed):
        told = "{} {} seed {}".format(*found)
        raise ValueError(
            f"{head.path} is foreign: it is {told}, not the grid's {cell.task} {cell.method} seed {cell.seed}"
        )
