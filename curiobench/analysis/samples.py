"""The runs of a method on a task as arrays, the input of tables, figures and reports."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from curiobench.analysis.colours import line_styles
from curiobench.analysis.frames import Results
from curiobench.analysis.statistics import area_under_curve
from curiobench.analysis.variants import scale_of

LOGGED = ("share_exploitation", "bonus_spread")  # columns of progress.csv that figures draw
GOOD_SUCCESS = 0.8  # mean success over all goals; tables have the epochs until it is reached
DECIMALS = 9  # of scores, so that equal successes tie whatever the order of summation


@dataclass(frozen=True, eq=False)
class Sample:
    """The runs of one method, and variant of it, on one task.

    S seeds, E evaluations that all runs have, L layers (the first is all goals together), G goals. The end of a run is
    its last evaluation. That of a partial run may not be among the E.
    """

    task: str
    method: str
    variant: str
    runs: pd.DataFrame  # their rows of `Results.runs`
    epochs: np.ndarray  # (E,) epochs completed at the evaluations
    success: np.ndarray  # (S, E, L) mean success over goals
    learned: np.ndarray  # (S, E, L) learned goals
    last_success: np.ndarray  # (S, L) as `success`, at each run's end
    last_learned: np.ndarray  # (S, L) as `learned`, at each run's end
    area: np.ndarray  # (S,) success over all goals, averaged over all of a run's training
    reached: np.ndarray  # epochs until mean success is `GOOD_SUCCESS`, for seeds that reach it
    goal_success: np.ndarray  # (S, G) success of each goal at each run's end
    goal_learned: np.ndarray  # (S, G) 1 where that goal is learned, 0 elsewhere
    logged: Mapping[str, tuple[np.ndarray, np.ndarray]]
    """By column of `LOGGED`: epochs (P,) with a value of all runs, and the values (S, P)."""
    look: Mapping[str, str]  # its method's colour and line style, as keywords of `Axes.plot`

    @property
    def n_seeds(self) -> int:
        """Its number of seeds."""
        return len(self.runs)

    @property
    def label(self) -> str:
        """Method and variant."""
        return f"{self.method}, {self.variant}" if self.variant else self.method


class Untrained(NamedTuple):
    """Results of untrained agents, mean over runs. They are above 0, because some goals hold at most starts."""

    learned: float  # goals with success above 80 %
    success: float  # mean over goals


@dataclass(frozen=True, eq=False)
class TaskSamples:
    """All samples of a task, in the order of `Results.runs`."""

    task: str
    runs: pd.DataFrame  # the task's rows of `Results.runs`
    scale: str  # robot, preset, epochs and steps
    untrained: Untrained | None  # None if agents were not evaluated before training
    goals: tuple[str, ...]  # names of the G goals
    bits: tuple[str, ...]  # their predicates
    goal_layers: np.ndarray  # (G,) height of each goal's tallest stack, in blocks
    sizes: dict[int, int]  # goals of each of the L layers; layer 0 is all goals together
    steps_per_epoch: float | None  # environment steps; None where runs differ in it
    samples: tuple[Sample, ...]


def task_samples(results: Results) -> list[TaskSamples]:
    """The samples of each task, tasks by name.

    Raises ValueError without a run, or where runs of a task differ in their goals or share no evaluation.
    """
    if results.runs.empty:
        raise ValueError("no run to draw" + "".join(f"; {fault}" for fault in results.faults))
    looks = line_styles(results.runs["method"])
    return [_of_task(str(task), runs, results, looks) for task, runs in results.runs.groupby("task")]


def _of_task(task: str, runs: pd.DataFrame, results: Results, looks: Mapping[str, Mapping[str, str]]) -> TaskSamples:
    evaluations, layers, progress = (
        frame[frame["task"] == task] for frame in (results.evaluations, results.layers, results.progress)
    )
    goals = evaluations[evaluations["run"] == runs["run"].iloc[0]].drop_duplicates("bits")
    sizes = {int(layer): int(size) for layer, size in layers.groupby("layer")["goals"].first().items()}
    samples = []
    for (method, variant), own in runs.groupby(["method", "variant"], sort=False):
        names = list(own["run"])
        curves = _curves(names, layers, list(sizes))
        ends = _ends(names, evaluations, goals)
        logged = {column: _logged(names, progress, column) for column in LOGGED}
        samples.append(Sample(task, method, variant, own, *curves, *ends, logged, looks[method]))
    before = layers[(layers["epoch"] == 0) & (layers["layer"] == 0)]
    return TaskSamples(
        task=task,
        runs=runs,
        scale=scale_of(runs),
        untrained=Untrained(*(float(before[name].mean()) for name in Untrained._fields)) if len(before) else None,
        goals=tuple(map(str, goals["goal"])),
        bits=tuple(map(str, goals["bits"])),
        goal_layers=goals["layer"].to_numpy(int),
        sizes=sizes,
        steps_per_epoch=_steps_per_epoch(runs),
        samples=tuple(samples),
    )


def _curves(runs: Sequence[str], frame: pd.DataFrame, layers: Sequence[int]) -> tuple[np.ndarray, ...]:
    """The fields of a sample from `epochs` to `reached`."""
    rows = frame[frame["run"].isin(runs)].astype({"run": str})
    epochs = np.unique(rows["epoch"].to_numpy(int))
    every = pd.MultiIndex.from_product([runs, epochs, layers])
    values = rows.set_index(["run", "epoch", "layer"])[["success", "learned"]].reindex(every).to_numpy(float)
    grid = values.T.reshape(2, len(runs), len(epochs), len(layers))
    known = ~np.isnan(grid[0]).any(axis=-1)  # (S, E)
    if not (common := known.all(axis=0)).any():
        raise ValueError(f"the runs {', '.join(runs)} have no evaluation of all goals in common")
    last_success, last_learned = grid[:, np.arange(len(runs)), len(epochs) - 1 - known[:, ::-1].argmax(axis=1)]
    area, reached = [], []
    for own, values in zip(known, grid[0], strict=True):
        own_epochs, own_success = epochs[own], np.round(values[own, 0], DECIMALS)
        area.append(np.round(area_under_curve(own_epochs, own_success), DECIMALS))
        reached.extend(own_epochs[own_success >= GOOD_SUCCESS][:1])
    ends = last_success, last_learned
    return epochs[common], *grid[:, :, common], *ends, np.array(area), np.array(reached, float)


def _ends(runs: Sequence[str], evaluations: pd.DataFrame, goals: pd.DataFrame) -> list[np.ndarray]:
    """`goal_success` and `goal_learned` of a sample, for the goals of the task's first run."""
    bits = list(goals["bits"])
    rows = evaluations.loc[evaluations["run"].isin(runs), ["run", "epoch", "bits", "success", "learned"]]
    rows = rows.astype({"run": str, "bits": str})
    rows = rows[rows["epoch"] == rows.groupby("run")["epoch"].transform("max")]
    tables = [rows.pivot(index="run", columns="bits", values=name).reindex(runs) for name in ("success", "learned")]
    if set(tables[0].columns) != set(bits) or tables[0].isna().to_numpy().any():
        first = goals["run"].iloc[0]
        raise ValueError(f"the runs {', '.join(runs)} were not all evaluated on the goals of {first}")
    return [table[bits].to_numpy(float) for table in tables]


def _logged(runs: Sequence[str], progress: pd.DataFrame, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Epochs (P,) with a value of all runs in a column of progress.csv, and the values (S, P)."""
    if column not in progress:
        return np.empty(0, int), np.empty((len(runs), 0))
    rows = progress.loc[progress["run"].isin(runs), ["run", "epoch", column]].astype({"run": str})
    table = rows.pivot(index="run", columns="epoch", values=column).reindex(runs).dropna(axis="columns")
    return table.columns.to_numpy(int), table.to_numpy(float)


def _steps_per_epoch(runs: pd.DataFrame) -> float | None:
    known = runs[runs["epoch"] > 0]
    steps = (known["steps"] / known["epoch"]).to_numpy(float)
    return float(steps[0]) if len(steps) and np.allclose(steps, steps[0], rtol=1e-3) else None
