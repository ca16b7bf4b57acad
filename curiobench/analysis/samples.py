"""What figures are drawn from: the runs of a method on a task, as arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from curiobench.analysis.frames import Results, in_order
from curiobench.analysis.options import scale_of
from curiobench.analysis.summaries import untrained

if TYPE_CHECKING:
    import pandas as pd

MOST_POINTS = 150
"""Points that are drawn of one curve, evenly spread: a panel is no more than a few hundred dots wide."""
LOGGED = ("share_exploitation", "bonus_spread")
"""Columns of progress.csv that figures draw."""
CELL = ["method", "variant"]
"""What the runs of a sample have in common, on one task."""


@dataclass(frozen=True, eq=False)
class Sample:
    """The runs of one method, and variant of it, on one task.

    S seeds, E evaluations that all of them have, L layers of which the first is all goals together, G goals.
    """

    method: str
    variant: str
    epochs: np.ndarray
    """(E,) epochs completed at the evaluations."""
    success: np.ndarray
    """(S, E, L) mean success over goals."""
    learned: np.ndarray
    """(S, E, L) learned goals."""
    last_success: np.ndarray
    """(S, L) as `success`, at each run's own last evaluation; other than `success[:, -1]` for partial runs only."""
    last_learned: np.ndarray
    """(S, L) as `learned`, in the same way."""
    goal_success: np.ndarray
    """(S, G) success of each goal at each run's last evaluation."""
    logged: Mapping[str, tuple[np.ndarray, np.ndarray]]
    """By column of `LOGGED`: the epochs (P,) of which all runs have a value, and the values (S, P)."""

    @property
    def n_seeds(self) -> int:
        """Its number of seeds."""
        return len(self.success)


@dataclass(frozen=True)
class TaskSamples:
    """All samples of a task, in the order that methods have everywhere."""

    task: str
    about: str
    """Task and scale, and a word on partial runs: for captions."""
    untrained: float | None
    """Success over all goals before training, mean over runs; None where they were not tested then."""
    goals: tuple[str, ...]
    """Names of the G goals."""
    goal_layers: np.ndarray
    """(G,) height of each goal's tallest stack, in blocks."""
    layers: tuple[int, ...]
    """The L layers of the samples; 0 is all goals together."""
    sizes: tuple[int, ...]
    """(L) goals of each."""
    steps_per_epoch: float | None
    """Environment steps; None where runs differ in it."""
    samples: tuple[Sample, ...]


def task_samples(results: Results) -> list[TaskSamples]:
    """The samples of each task, tasks by name; runs that were not evaluated yet are left out.

    Raises:
        ValueError: no run that was evaluated, runs of one task with different goals, or runs of one method without a
            common evaluation.
    """
    evaluated = results.runs[results.runs["run"].isin(results.layers["run"].unique())]
    if evaluated.empty:
        raise ValueError("no run to draw" + "".join(f"; {fault}" for fault in results.faults))
    return [_of_task(str(task), runs, results) for task, runs in evaluated.groupby("task")]


def thinned(count: int) -> np.ndarray:
    """Positions of at most `MOST_POINTS` of `count` points, evenly spread, first and last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).round().astype(int))


def _of_task(task: str, runs: "pd.DataFrame", results: Results) -> TaskSamples:
    evaluations, layers, progress = (
        frame[frame["task"] == task] for frame in (results.evaluations, results.layers, results.progress)
    )
    goals = evaluations[evaluations["run"] == runs["run"].iloc[0]].drop_duplicates("goal")
    sizes = dict(sorted(layers.groupby("layer")["goals"].first().items()))
    cells = {cell: list(rows["run"]) for cell, rows in runs.groupby(CELL)}
    place = {method: i for i, method in enumerate(in_order([method for method, _ in cells]))}
    samples = []
    for method, variant in sorted(cells, key=lambda cell: (place[cell[0]], cell[1])):
        names = cells[method, variant]
        curves = _curves(names, layers, list(sizes))
        final = _goal_success(names, evaluations, list(goals["goal"]))
        logged = {column: _logged(names, progress, column) for column in LOGGED}
        samples.append(Sample(method, variant, *curves, final, logged))
    return TaskSamples(
        task=task,
        about=_about(task, runs),
        untrained=None if (before := untrained(results, task)) is None else before.success,
        goals=tuple(map(str, goals["goal"])),
        goal_layers=goals["layer"].to_numpy(int),
        layers=tuple(map(int, sizes)),
        sizes=tuple(map(int, sizes.values())),
        steps_per_epoch=_steps_per_epoch(runs),
        samples=tuple(samples),
    )


def _curves(runs: Sequence[str], frame: "pd.DataFrame", layers: Sequence[int]) -> tuple[np.ndarray, ...]:
    """`epochs`, `success`, `learned`, `last_success` and `last_learned` of a sample."""
    import pandas as pd

    names = frame["run"].astype("category").cat
    place = pd.Index(runs).get_indexer(names.categories)  # of each category among the runs, -1 for those of others
    seed = place[names.codes]
    frame, seed = frame[seed >= 0], seed[seed >= 0]
    epoch, layer = frame["epoch"].to_numpy(int), np.searchsorted(layers, frame["layer"].to_numpy(int))
    epochs = np.flatnonzero(np.bincount(epoch))
    grid = np.full((2, len(runs), len(epochs), len(layers)), np.nan)
    grid[:, seed, np.searchsorted(epochs, epoch), layer] = frame[["success", "learned"]].to_numpy(float).T
    known = ~np.isnan(grid[0]).any(axis=-1)  # (S, E)
    if not (common := known.all(axis=0)).any():
        raise ValueError(f"the runs {', '.join(runs)} have no evaluation of all goals in common")
    last = len(epochs) - 1 - known[:, ::-1].argmax(axis=1)
    return epochs[common], *grid[:, :, common], *grid[:, np.arange(len(runs)), last]


def _goal_success(runs: Sequence[str], evaluations: "pd.DataFrame", goals: Sequence[str]) -> np.ndarray:
    """Success (S, G) at each run's last evaluation."""
    rows = evaluations.loc[evaluations["run"].isin(runs), ["run", "epoch", "goal", "success"]].astype({"run": str})
    rows = rows[rows["epoch"] == rows.groupby("run")["epoch"].transform("max")].astype({"goal": str})
    table = rows.pivot(index="run", columns="goal", values="success").reindex(runs)
    if set(table.columns) != set(goals) or table.isna().to_numpy().any():
        raise ValueError(f"the runs {', '.join(runs)} have other goals than the first run of their task")
    return table[list(goals)].to_numpy(float)


def _logged(runs: Sequence[str], progress: "pd.DataFrame", column: str) -> tuple[np.ndarray, np.ndarray]:
    """Epochs (P,) of which all runs have a value in a column of progress.csv, and the values (S, P)."""
    if column not in progress:
        return np.empty(0, int), np.empty((len(runs), 0))
    rows = progress.loc[progress["run"].isin(runs), ["run", "epoch", column]].astype({"run": str})
    table = rows.pivot(index="run", columns="epoch", values=column)
    table = table.reindex(runs).dropna(axis="columns")
    return table.columns.to_numpy(int), table.to_numpy(float)


def _about(task: str, runs: "pd.DataFrame") -> str:
    partial = int((~runs["complete"].astype(bool)).sum())
    note = f"; {partial} of {len(runs)} runs are partial, and curves end where a run of the method does"
    return f"{task}, {scale_of(runs)}{note * (partial > 0)}"


def _steps_per_epoch(runs: "pd.DataFrame") -> float | None:
    known = runs[runs["epoch"] > 0]
    steps = (known["steps"] / known["epoch"]).to_numpy(float)
    return float(steps[0]) if len(steps) and np.allclose(steps, steps[0], rtol=1e-3) else None
