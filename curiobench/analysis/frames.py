"""Run folders and published sets as pandas frames. docs/results.md says what each column means."""

import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from curiobench.analysis import lengthened
from curiobench.analysis.collecting import Collector, Wanted
from curiobench.analysis.reading import Run
from curiobench.analysis.variants import variants
from curiobench.methods.specs import shown
from curiobench.run_folder import PACKAGES
from curiobench.workers import no_collection

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
    processes: int = 1,
    meanwhile: Callable[[], object] = lambda: None,
    longest: bool = False,
) -> Results:
    """Read runs; imports no method and changes nothing.

    Args:
        paths: run folders, folders of run folders (such as a grid's), published sets; or names of the sets that come
            with this package, such as v1, where there is no such folder.
        partial: also take runs that are not finished.
        every_goal: `evaluations` holds every evaluation; otherwise the last of each run, in half the time. `layers` is
            the same either way.
        progress: read progress.csv; or only these columns of it and those that every run has, of the runs that have
            one of these.
        processes: how many read folders side by side, where there are many and the system can fork; what is read does
            not depend on it.
        meanwhile: what this process does first, while others have begun to read, such as a long import.
        longest: leave out, without a word, a run that is the beginning of another one, which was made longer.

    Returns:
        The runs that can be used, sorted by task, method, variant and seed, and faults about all others.
    """
    collector = Collector(Wanted(every_goal, progress), processes)
    with no_collection():
        collector.collect([Path(path) for path in paths], partial, meanwhile)
        return _results(collector, longest)


def _results(collector: Collector, longest: bool) -> Results:
    kept = lengthened.longest(collector.runs()) if longest else collector.runs()
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
        (*collector.faults, *collector.absent),
        tuple(collector.absent),
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
    shapes = [part.episodes.shape for part in parts]  # (E, G) each
    columns = _identity(frame, [n * goals for n, goals in shapes])
    for name in ("epoch", "steps"):
        columns[name] = np.concatenate(
            [np.repeat(getattr(part, name), goals) for part, (_, goals) in zip(parts, shapes, strict=True)]
        )
    for name in ("goal", "bits"):
        columns[name] = _categorical([getattr(part, name) for part in parts], [n for n, _ in shapes])
    columns["layer"] = np.concatenate([np.tile(part.layer, n) for part, (n, _) in zip(parts, shapes, strict=True)])
    for name in ("episodes", "success", "episodes_unsatisfied", "success_unsatisfied", "learned"):
        columns[name] = np.concatenate([getattr(part, name).ravel() for part in parts])
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
    parts = [run.layers for run in runs]
    columns = _identity(frame, [len(part["epoch"]) for part in parts])
    return pd.DataFrame(columns | {name: np.concatenate([part[name] for part in parts]) for name in names}, copy=False)


def _progress_frame(runs: Sequence[Run], frame: pd.DataFrame) -> pd.DataFrame:
    parts = [run.progress for run in runs]
    if not any(map(len, parts)):
        return pd.DataFrame(columns=list(IDENTITY))
    rows = pd.concat([part for part in parts if len(part)], ignore_index=True)
    columns = _identity(frame, [len(part) for part in parts])
    return pd.concat([pd.DataFrame(columns, index=rows.index), rows], axis=1)
