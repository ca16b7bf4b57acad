"""Run folders and published sets as pandas frames. docs/results.md says what each column means."""

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from curiobench.methods.specs import canonical, shown
from curiobench.results.folders import Cell, look
from curiobench.results.published import by_name
from curiobench.results.published_rows import read_published
from curiobench.results.reading import Head, Run, read_head, read_run
from curiobench.results.variants import variants
from curiobench.run_folder import PACKAGES

__all__ = ["METHOD_ORDER", "Results", "in_order", "read_results", "shown"]

METHOD_ORDER = ("sac", "icm", "rnd", "dac", "re3", "mihm", "icm+hm", "rnd+hm", "dac+hm", "re3+hm", "mi")
"""Methods as tables and figures list them; others follow by name."""
IDENTITY = ("run", "task", "method", "variant", "seed")
"""First columns of every frame."""
RUN_COLUMNS = (
    *IDENTITY,
    *("robot", "preset", "epochs", "epoch", "complete", "steps", "updates", "hours", "peak_memory_mb", "machine"),
    *(*PACKAGES, "python", "git_commit", "method_sha256", "created", "finished", "command", "config"),
)
"""Columns of `Results.runs`."""
EVALUATION_COLUMNS = (
    *IDENTITY,
    *("epoch", "steps", "goal", "bits", "layer", "episodes", "success", "episodes_unsatisfied"),
    *("success_unsatisfied", "learned"),
)
"""Columns of `Results.evaluations`."""


@dataclass(frozen=True)
class Results:
    """Runs as pandas frames."""

    runs: pd.DataFrame
    """A row a run."""
    evaluations: pd.DataFrame
    """A row a run, evaluation and goal; with `read_results(every_goal=False)` the last evaluations only."""
    layers: pd.DataFrame
    """A row a run, evaluation and layer, with means over its goals; layer 0 is all goals together."""
    progress: pd.DataFrame
    """A row a run and epoch."""
    config_files: dict[str, Path] = field(default_factory=dict)
    """Where each run's config.json should be; that of a published set may be missing."""
    faults: tuple[str, ...] = ()
    """One line on each folder that is missing, broken, partial, duplicate or foreign, and what was done with it."""
    absent: tuple[str, ...] = ()
    """Those of the faults for which a path that was asked for gave no run at all."""


def in_order(methods: Sequence[str]) -> list[str]:
    """Method specs, as shown, each once, in the order of tables and figures."""
    return sorted(set(methods), key=_place)


def _place(method: str) -> tuple[int, str]:
    return (METHOD_ORDER.index(method) if method in METHOD_ORDER else len(METHOD_ORDER), method)


def read_results(
    paths: Sequence[Path],
    partial: bool = False,
    every_goal: bool = True,
    progress: bool | Sequence[str] = True,
) -> Results:
    """Read runs; imports no method and changes nothing.

    Args:
        paths: run folders, folders of run folders (such as a grid's), published sets; or names of the sets that come
            with this package, such as v1, where there is no such folder.
        partial: also take runs that are not finished.
        every_goal: `evaluations` holds every evaluation; otherwise the last of each run, in half the time. `layers` is
            the same either way.
        progress: read progress.csv; or only these columns of it and those that every run has.

    Returns:
        The runs that can be used, sorted by task, method, variant and seed, and faults about all others.
    """
    reader = _Reader(partial, every_goal, progress)
    for path in map(Path, paths):
        reader.add(path)
    return reader.results()


class _Reader:
    """Collects runs and faults, path after path."""

    def __init__(self, partial: bool, every_goal: bool, progress: bool | Sequence[str]) -> None:
        self._partial, self._every_goal, self._progress = partial, every_goal, progress
        self._seen: set[Path] = set()
        self._kept: dict[str, Run] = {}
        self._unfinished: list[tuple[Head, list[str]]] = []
        self._faults: list[str] = []
        self._absent: list[str] = []

    def add(self, path: Path) -> None:
        """Read what a path stands for."""
        path = by_name(path)
        try:
            found = look(path)
            published = read_published(path, self._every_goal) if found.published else []
        except (ValueError, OSError) as error:
            self._absent.append(str(error))
            return
        named = path in found.runs
        self._faults += found.faults
        if found.published:
            self._add_published(path.resolve(), published)
        for folder, cell in found.runs.items():
            self._add_folder(folder, cell, self._absent if named else self._faults)

    def _add_published(self, path: Path, runs: Sequence[Run]) -> None:
        if path not in self._seen:
            self._seen.add(path)
            for run in runs:
                self._keep(run, self._faults)

    def _add_folder(self, folder: Path, cell: Cell | None, faults: list[str]) -> None:
        if folder.resolve() in self._seen:
            return  # the same folder by two of the paths
        self._seen.add(folder.resolve())
        try:
            head = read_head(folder)
            if cell is not None:
                _check_cell(head, cell)
            if head.result is not None:
                self._keep_folder(head, faults)
            else:
                self._unfinished.append((head, faults))
        except (ValueError, OverflowError) as error:
            faults.append(f"{error}; left out")
        except OSError as error:
            faults.append(f"cannot read {error.filename}: {error.strerror}; left out")

    def _keep_folder(self, head: Head, faults: list[str]) -> None:
        if not self._is_new(head, faults):
            return
        run = read_run(head, self._every_goal, self._progress)
        self._faults += run.notes
        self._keep(run, faults)

    def _is_new(self, head: Head, faults: list[str]) -> bool:
        if first := self._kept.get(head.identity()):
            faults.append(f"{head.path} is a duplicate of {first.head.path}: the same config; left out")
        return first is None

    def _keep(self, run: Run, faults: list[str]) -> None:
        if self._is_new(run.head, faults):
            self._kept[run.head.identity()] = run

    def _take_unfinished(self) -> None:
        """Partial runs come last, so that none takes the place of a complete one."""
        for head, faults in self._unfinished:
            if not self._partial:
                faults.append(f"{head.path} is partial: it has no result.json; left out")
                continue
            try:
                self._keep_folder(head, faults)
            except ValueError as error:
                faults.append(f"{error}; left out")
        self._unfinished.clear()

    def results(self) -> Results:
        """The frames of all that was added."""
        self._take_unfinished()
        kept = list(self._kept.values())
        texts = variants([run.head.decisive() for run in kept])
        order = sorted(range(len(kept)), key=lambda i: _key(kept[i], texts[i]))
        runs = [kept[i] for i in order]
        frame = _runs_frame(runs, [texts[i] for i in order])
        return Results(
            frame,
            _evaluations_frame(runs, frame),
            _layers_frame(runs, frame),
            _progress_frame(runs, frame),
            {name: run.head.config_file for name, run in zip(frame["run"], runs, strict=True)},
            (*self._faults, *self._absent),
            tuple(self._absent),
        )


def _check_cell(head: Head, cell: Cell) -> None:
    """Raises ValueError where a run is not the one that the grid has in its folder."""
    found = tuple(head.config[name] for name in ("task", "method", "seed"))
    if found != (cell.task, canonical(cell.method), cell.seed):
        told = "{} {} seed {}".format(*found)
        raise ValueError(
            f"{head.path} is foreign: it is {told}, not the grid's {cell.task} {cell.method} seed {cell.seed}"
        )


def _key(run: Run, variant: str) -> tuple[Any, ...]:
    values = run.values
    return values["task"], _place(values["method"]), variant, values["seed"], str(run.head.path)


def _names(paths: Sequence[Path]) -> list[str]:
    """Folder names, with as much of the path before them as makes them unique."""
    names = [path.name for path in paths]
    for depth in range(2, 1 + max((len(path.parts) for path in paths), default=0)):
        often = {name for name, times in Counter(names).items() if times > 1}
        names = [
            "/".join(path.parts[-depth:]) if name in often else name for path, name in zip(paths, names, strict=True)
        ]
    return names


def _runs_frame(runs: Sequence[Run], texts: Sequence[str]) -> pd.DataFrame:
    names = _names([Path(os.path.abspath(run.head.path)) for run in runs])
    rows = [run.values | {"run": name, "variant": text} for run, name, text in zip(runs, names, texts, strict=True)]
    return pd.DataFrame(rows, columns=list(RUN_COLUMNS))


def _identity(frame: pd.DataFrame, sizes: Sequence[int]) -> dict[str, Any]:
    """The first columns of a frame in which the i-th run has `sizes[i]` rows."""
    which = np.repeat(np.arange(len(frame)), sizes)
    columns: dict[str, Any] = {}
    for name in IDENTITY[:-1]:
        categories = list(dict.fromkeys(frame[name]))
        position = {category: i for i, category in enumerate(categories)}
        codes = np.array([position[value] for value in frame[name]], np.int16)
        columns[name] = pd.Categorical.from_codes(codes[which], categories)
    return columns | {"seed": frame["seed"].to_numpy(np.int64)[which]}


def _evaluations_frame(runs: Sequence[Run], frame: pd.DataFrame) -> pd.DataFrame:
    """Row order: run, evaluation, goal."""
    parts = [run.evaluations for run in runs]
    if not parts:
        return pd.DataFrame(columns=list(EVALUATION_COLUMNS))
    shapes = [part.episodes.shape for part in parts]  # (K, G) each
    columns = _identity(frame, [n * goals for n, goals in shapes])
    for name in ("epoch", "steps"):
        columns[name] = np.concatenate(
            [np.repeat(getattr(part, name)[-n:], goals) for part, (n, goals) in zip(parts, shapes, strict=True)]
        )
    for name in ("goal", "bits"):
        columns[name] = _categorical([getattr(part, name) for part in parts], [n for n, _ in shapes])
    columns["layer"] = np.concatenate([np.tile(part.layer, n) for part, (n, _) in zip(parts, shapes, strict=True)])
    for name in ("episodes", "success", "episodes_unsatisfied", "success_unsatisfied", "learned"):
        columns[name] = np.concatenate(
            [getattr(part, name)[-n:].ravel() for part, (n, _) in zip(parts, shapes, strict=True)]
        )
    columns["learned"] = columns["learned"].astype(np.int8)
    return pd.DataFrame(columns, columns=list(EVALUATION_COLUMNS), copy=False)


def _categorical(texts: Sequence[Sequence[str]], repeats: Sequence[int]) -> pd.Categorical:
    """The texts of each run, all of them as often as it has evaluations."""
    position = {text: i for i, text in enumerate(dict.fromkeys(text for part in texts for text in part))}
    codes = [
        np.tile([position[text] for text in part], n).astype(np.int32) for part, n in zip(texts, repeats, strict=True)
    ]
    return pd.Categorical.from_codes(np.concatenate(codes), list(position))


def _layers_frame(runs: Sequence[Run], frame: pd.DataFrame) -> pd.DataFrame:
    names = ("epoch", "steps", "layer", "goals", "success", "success_unsatisfied", "learned")
    if not runs:
        return pd.DataFrame(columns=[*IDENTITY, *names])
    parts = [run.evaluations.layers() for run in runs]
    columns = _identity(frame, [len(part["epoch"]) for part in parts])
    return pd.DataFrame(columns | {name: np.concatenate([part[name] for part in parts]) for name in names}, copy=False)


def _progress_frame(runs: Sequence[Run], frame: pd.DataFrame) -> pd.DataFrame:
    parts = [run.progress for run in runs]
    if not any(map(len, parts)):
        return pd.DataFrame(columns=list(IDENTITY))
    rows = pd.concat(parts, ignore_index=True)
    columns = _identity(frame, [len(part) for part in parts])
    return pd.concat([pd.DataFrame(columns, index=rows.index), rows], axis=1)
