"""Run folders and published sets as pandas frames. docs/frames.md explains the columns."""

import functools
import os
import sys
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd
from pandas.api.types import union_categoricals

from curiobench.analysis.folders import GridRun, by_name, find_runs, is_published
from curiobench.analysis.rows import DTYPES, IDENTITY
from curiobench.analysis.runs import RunData, read_head, with_rows, without_beginnings
from curiobench.analysis.sets import read_set
from curiobench.analysis.variants import variants
from curiobench.errors import one_line
from curiobench.methods.specs import BUILT_IN, canonical
from curiobench.versions import PACKAGES
from curiobench.workers import no_collection, parallel_map

_OF_THE_PAPER = ("sac", "icm", "rnd", "dac", "re3", "mihm", "icm+hm", "rnd+hm", "dac+hm", "re3+hm", "mi")
METHOD_ORDER = (*_OF_THE_PAPER, *(spec for spec in BUILT_IN if spec not in _OF_THE_PAPER))
"""Methods as tables and figures list them; others follow by name."""
RUN_COLUMNS = (
    *IDENTITY,
    *("robot", "preset", "epochs", "epoch", "complete", "steps", "updates", "hours", "peak_memory_mb", "machine"),
    *(*PACKAGES, "python", "git_commit", "method_sha256", "created", "finished", "command", "config"),
)
"""Columns of `Results.runs`."""
EVALUATION_COLUMNS = (*IDENTITY, *DTYPES)  # columns of `Results.evaluations`
LAYER_COLUMNS = (*IDENTITY, "epoch", "steps", "layer", "goals", "success", "success_unsatisfied", "learned")
"""Columns of `Results.layers`."""
FEWEST = 16  # run folders per process for which it is worth starting one


@dataclass(frozen=True)
class Results:
    """Runs as pandas frames."""

    runs: pd.DataFrame  # one row per run
    evaluations: pd.DataFrame
    """One row per run, evaluation and goal; with `read_results(every_goal=False)` the last evaluations only."""
    layers: pd.DataFrame  # one row per run, evaluation and layer: means over its goals; layer 0 is all goals together
    progress: pd.DataFrame  # one row per run and epoch
    config_files: dict[str, Path] = field(default_factory=dict)
    """Path of each run's config.json; in a published set the file may be missing."""
    faults: tuple[str, ...] = ()
    """One line on each folder that is missing, damaged, partial, duplicate or foreign."""
    absent: tuple[str, ...] = ()  # faults about paths of `read_results` themselves


def print_faults(results: Results, product: str) -> None:
    """Print a line to stderr on each folder that is left out.

    Raises ValueError, one line, if paths that the user named are not in the product, such as "table".
    """
    for fault in results.faults:
        if fault not in results.absent:
            print(f"curiobench: {one_line(fault)}", file=sys.stderr)
    if results.absent:
        raise ValueError(f"not in the {product}: " + "; ".join(results.absent))


def read_results(
    paths: Sequence[Path],
    partial: bool = False,
    every_goal: bool = True,
    progress: bool | Collection[str] = True,
    processes: int = 1,
    longest: bool = False,
) -> Results:
    """Read runs. Imports no method and writes nothing.

    Args:
        paths: run folders, folders of run folders (such as a grid's), published sets; or names of the sets that come
            with this package, such as v2, where there is no such folder.
        partial: also take runs that are not finished.
        every_goal: whether `evaluations` holds all evaluations; otherwise only the last one of each run.
        progress: whether to read progress.csv. Names of columns read these and those that every run has, of runs that
            have one of them.
        processes: number of processes that read, if there are many folders; the results do not depend on it.
        longest: leave out, without a fault, runs that are the beginning of a longer run.

    Returns the valid runs, sorted by task, method, variant and seed, and faults about the others. Raises ValueError
    without a path.
    """
    if not paths:
        raise ValueError("name at least one run folder, folder of run folders or published set")
    load_folder = functools.partial(_load, partial=partial, every_goal=every_goal, progress=progress)
    with no_collection():
        known: set[Path] = set()
        found = [one for path in paths for one in _at(by_name(Path(path)), every_goal, known)]
        folders = [what for what, _ in found if isinstance(what, tuple)]
        loaded = iter(parallel_map(load_folder, folders, processes, FEWEST))
        read = [(next(loaded) if isinstance(what, tuple) else what, named) for what, named in found]
        runs, faults, absent = _usable(read)
        return _results(without_beginnings(runs) if longest else runs, (*faults, *absent), tuple(absent))


_Folder = tuple[Path, GridRun | None]  # a run folder, and the run that a grid expects in it


def _at(path: Path, every_goal: bool, known: set[Path]) -> Iterator[tuple[RunData | _Folder | str, bool]]:
    """Runs of a published set, folders to read, and faults; each with whether it is about the path itself.

    A folder in `known` is left out; others are added to it.
    """

    def is_new(folder: Path) -> bool:
        resolved, size = folder.resolve(), len(known)
        known.add(resolved)
        return len(known) > size

    try:
        if path.is_dir() and is_published(path):
            published, folders, faults = read_set(path, every_goal), {}, []
        else:
            published, (folders, faults) = [], find_runs(path)
    except (ValueError, OSError) as error:
        yield str(error), True
        return
    yield from ((fault, False) for fault in faults)
    if published and is_new(path):
        yield from ((run, False) for run in published)
    for folder, expected in folders.items():
        if is_new(folder):
            yield (folder, expected), folder == path


def _usable(read: Iterable[tuple[RunData | str, bool]]) -> tuple[list[RunData], list[str], list[str]]:
    """Valid runs without duplicates, faults about found folders, and faults about paths that the user named.

    Of two runs with the same config the complete one is kept.
    """
    kept: dict[str, RunData] = {}
    faults: tuple[list[str], list[str]] = ([], [])
    for run, named in sorted(read, key=lambda one: isinstance(one[0], RunData) and not one[0].values["complete"]):
        if isinstance(run, str):
            faults[named].append(run)
        elif run.evaluations is None and not run.fault:
            faults[named].append(f"{run.path} is partial: it has no result.json; left out")
        elif first := kept.get(run.identity()):
            why = "all options that affect results are equal"
            faults[named].append(f"{run.path} is a duplicate of {first.path}: {why}; left out")
        elif run.fault:
            faults[named].append(run.fault)
        else:
            faults[False].extend(run.notes)
            kept[run.identity()] = run
    return list(kept.values()), *faults


def _load(folder: _Folder, partial: bool, every_goal: bool, progress: bool | Collection[str]) -> RunData | str:
    """A run with its rows; without rows if it has a fault, or is partial and `partial` is False. A fault if no run."""
    path, expected = folder
    try:
        run = read_head(path)
        found = GridRun(*(run.config[name] for name in GridRun._fields))
        if expected and found != expected._replace(method=canonical(expected.method)):
            raise ValueError(f"{path} is foreign: it holds {found}, but grid.json expects {expected}")
    except (ValueError, OSError) as error:
        return _left_out(error)
    if run.result is None and not partial:
        return run
    try:
        return with_rows(run, every_goal, progress)
    except (ValueError, OSError) as error:
        return replace(run, fault=_left_out(error))


def _left_out(error: Exception) -> str:
    text = f"cannot read {error.filename}: {error.strerror}" if isinstance(error, OSError) else str(error)
    return f"{text}; left out"


def _results(runs: Sequence[RunData], faults: tuple[str, ...], absent: tuple[str, ...]) -> Results:
    def place(named: tuple[str, RunData]) -> tuple[Any, ...]:
        variant, run = named
        method = run.values["method"]
        known = METHOD_ORDER.index(method) if method in METHOD_ORDER else len(METHOD_ORDER)
        return run.config["task"], known, method, variant, run.config["seed"], str(run.path)

    order = sorted(zip(variants([run.decisive() for run in runs]), runs, strict=True), key=place)
    runs = [run for _, run in order]
    names = _names([Path(os.path.abspath(run.path)) for run in runs])
    rows = [run.values | {"run": name, "variant": text} for name, (text, run) in zip(names, order, strict=True)]
    frame = pd.DataFrame(rows, columns=list(RUN_COLUMNS))
    return Results(
        frame,
        _stacked(frame, [run.evaluations for run in runs], EVALUATION_COLUMNS),
        _stacked(frame, [run.layers for run in runs], LAYER_COLUMNS),
        _stacked(frame, [run.progress for run in runs], IDENTITY),
        {name: run.config_file for name, run in zip(names, runs, strict=True)},
        faults,
        absent,
    )


def _names(paths: Sequence[Path]) -> list[str]:
    """Folder names, with as many parent folders as make them unique; each on one line."""
    paths = [Path(one_line(path)) for path in paths]
    names = [path.name for path in paths]
    for depth in range(2, 1 + max((len(path.parts) for path in paths), default=0)):
        often = {name for name, times in Counter(names).items() if times > 1}
        names = [
            "/".join(path.parts[-depth:]) if name in often else name for path, name in zip(paths, names, strict=True)
        ]
    return names


def _stacked(frame: pd.DataFrame, parts: Sequence[pd.DataFrame], names: Sequence[str]) -> pd.DataFrame:
    """The rows of all runs, after their `IDENTITY`; categories are in the order in which they first occur.

    `names` are the columns where there is no row.
    """
    if not any(map(len, parts)):
        return pd.DataFrame(columns=list(names))
    which = frame.index.repeat([len(part) for part in parts])
    runs = frame[list(IDENTITY)].astype({name: pd.CategoricalDtype(frame[name].unique()) for name in IDENTITY[:-1]})
    rows = pd.concat([part for part in parts if len(part)], ignore_index=True)
    for name in rows.columns.intersection(["goal", "bits"]):
        rows[name] = union_categoricals([part[name] for part in parts])
    return pd.concat([runs.loc[which].reset_index(drop=True), rows], axis=1)
