"""What a table says of a method on a task: estimates over its seeds, from the frames of runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from curiobench.analysis.frames import Results, in_order
from curiobench.analysis.statistics import (
    area_under_curve,
    curve_interval,
    improvement_interval,
    interquartile_mean,
    probability_of_improvement,
    stratified_bootstrap,
)

GOOD_SUCCESS = 0.8
"""Mean success over all goals from which a run counts as good; tables tell how soon it is there."""
_DECIMALS = 9
"""Scores are rounded to so many, so that equal successes that were summed in another order are a tie."""


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % bootstrap interval over seeds."""

    value: float
    """The estimate."""
    low: float = float("nan")
    """Low end; NaN where there is no interval, as with one seed."""
    high: float = float("nan")
    """High end."""

    @property
    def has_interval(self) -> bool:
        """Whether both ends are numbers."""
        return bool(np.isfinite(self.low) and np.isfinite(self.high))


@dataclass(frozen=True)
class Summary:
    """The runs of one task, method and variant."""

    task: str
    """Task."""
    method: str
    """Method spec, as shown."""
    variant: str
    """What sets it apart from other runs of the method."""
    seeds: tuple[int, ...]
    """Its sample."""
    epochs: tuple[int, ...]
    """Epochs trained, each number once."""
    goals: dict[int, int]
    """Goals by layer; 0 is all layers together, here and below."""
    learned: dict[int, Estimate]
    """Learned goals by layer, mean over seeds."""
    success: Estimate
    """Success at the end, mean over goals and seeds."""
    middle_success: Estimate
    """Success at the end, interquartile mean of all goals of all seeds."""
    area: Estimate
    """Success over training, mean over goals, epochs and seeds: the normalised area under the curve."""
    reached: int
    """Seeds whose mean success was `GOOD_SUCCESS` at an evaluation."""
    epochs_to: float | None
    """Epochs until the first such evaluation, mean over these seeds; None for no seed."""
    better: Estimate | None
    """Probability that a run has more success at the end than one of the baseline; None without two seeds of both."""
    better_area: Estimate | None
    """The same of success over training."""
    hours: float
    """Wall-clock hours a run, mean over seeds."""
    peak_memory_mb: float
    """Largest memory of a run, in MB."""
    machines: tuple[str, ...]
    """Processors that the runs were made on."""


@dataclass(frozen=True)
class _Scores:
    """Scores of S seeds with L layers and G goals."""

    learned: np.ndarray
    """`(S, L)`"""
    goals: np.ndarray
    """`(S, G)` success at the end."""
    success: np.ndarray
    """`(S,)`"""
    area: np.ndarray
    """`(S,)`"""
    reached: np.ndarray
    """`(S,)` epochs until good success, NaN for never."""


def summarise(results: Results, baseline: str = "sac") -> list[Summary]:
    """A summary of every task, method and variant.

    Args:
        results: complete runs; of partial ones, the last evaluation counts as their end.
        baseline: method that the others are compared with, of the same variant or without any; itself it is not
            compared.

    Returns:
        Sorted by task, method and variant.
    """
    per_run = _scores_by_run(results)
    cells = {
        key: (runs, _stack([per_run[run] for run in runs["run"]]))
        for key, runs in results.runs.groupby(["task", "method", "variant"], sort=False)
    }
    summaries = []
    for (task, method, variant), (runs, scores) in cells.items():
        against = None if method == baseline else _baseline(cells, task, baseline, variant, runs)
        summaries.append(_summary(runs, scores, against, _layers_of(results, runs["run"].iloc[0])))
    order = {method: place for place, method in enumerate(in_order([summary.method for summary in summaries]))}
    return sorted(summaries, key=lambda s: (s.task, order[s.method], s.variant))


def _baseline(cells: dict, task: str, baseline: str, variant: str, runs: pd.DataFrame) -> _Scores | None:
    """Scores of the baseline with the same variant, or of its only one, if its runs are as long as these."""
    found = {key[2]: cell for key, cell in cells.items() if key[:2] == (task, baseline)}
    if variant not in found and len(found) != 1:
        return None
    theirs, scores = found.get(variant) or next(iter(found.values()))
    return scores if _lengths(theirs) == _lengths(runs) else None


def _lengths(runs: pd.DataFrame) -> set[tuple[int, int, int]]:
    return set(runs[["epoch", "steps", "updates"]].itertuples(index=False, name=None))


def _scores_by_run(results: Results) -> dict[str, _Scores]:
    last = {run: rows["success"].to_numpy() for run, rows in _by_run(results.evaluations) if len(rows)}
    ends = results.runs.set_index("run")["epoch"]
    scores = {}
    for run, rows in _by_run(results.layers):
        layers = rows["layer"].to_numpy()
        n_layers = len(np.unique(layers))
        epochs = rows["epoch"].to_numpy()[layers == 0]
        success = np.round(rows["success"].to_numpy()[layers == 0], _DECIMALS)
        good = epochs[success >= GOOD_SUCCESS]
        scores[run] = _Scores(
            learned=rows["learned"].to_numpy()[-n_layers:],
            goals=last[run][-int(rows["goals"].to_numpy()[0]) :],
            success=success[-1],
            area=np.round(area_under_curve(epochs, success), _DECIMALS),
            reached=np.array(good[0] if len(good) else np.nan),
        )
    if missing := set(ends.index) - set(scores):
        raise ValueError(f"{min(missing)} has no evaluation")
    return scores


def _by_run(frame: pd.DataFrame):
    return frame.groupby("run", observed=True, sort=False)


def _stack(runs: Sequence[_Scores]) -> _Scores:
    names = _Scores.__dataclass_fields__
    return _Scores(**{name: np.array([getattr(run, name) for run in runs], float) for name in names})


def _layers_of(results: Results, run: str) -> dict[int, int]:
    rows = results.layers[results.layers["run"] == run]
    return dict(zip(rows["layer"].tolist(), rows["goals"].tolist(), strict=True))


def _summary(runs: pd.DataFrame, scores: _Scores, baseline: _Scores | None, goals: dict[int, int]) -> Summary:
    means = np.column_stack([scores.learned, scores.success, scores.area])
    *learned, success, area = map(Estimate, means.mean(axis=0), *curve_interval(means))
    middle = stratified_bootstrap(scores.goals[:, None, :], interquartile_mean)
    reached = scores.reached[~np.isnan(scores.reached)]
    first = runs.iloc[0]
    return Summary(
        task=first["task"],
        method=first["method"],
        variant=first["variant"],
        seeds=tuple(runs["seed"].tolist()),
        epochs=tuple(sorted(set(runs["epoch"].tolist()))),
        goals=goals,
        learned=dict(zip(goals, learned, strict=True)),
        success=success,
        middle_success=Estimate(float(interquartile_mean(scores.goals)), *middle),
        area=area,
        reached=len(reached),
        epochs_to=float(reached.mean()) if len(reached) else None,
        better=_improvement(scores.success, None if baseline is None else baseline.success),
        better_area=_improvement(scores.area, None if baseline is None else baseline.area),
        hours=float(runs["hours"].mean()),
        peak_memory_mb=float(runs["peak_memory_mb"].max()),
        machines=tuple(sorted(set(runs["machine"]) - {""})),
    )


def _improvement(scores: np.ndarray, baseline: np.ndarray | None) -> Estimate | None:
    """None also where either has a single seed: the probability would be 0 or 1, whatever the methods.

    Where all runs of one are better than all of the other every resample says the same; that is no interval.
    """
    if baseline is None or min(len(scores), len(baseline)) < 2:
        return None
    x, y = scores[:, None], baseline[:, None]
    low, high = improvement_interval(x, y)
    return Estimate(probability_of_improvement(x, y), *((low, high) if low < high else ()))


@dataclass(frozen=True)
class Untrained:
    """What agents can do before they learn, mean over runs: a goal may hold at most starts."""

    learned: float
    """Goals with success above 80 %."""
    success: float
    """Mean over goals."""


def untrained(results: Results, task: str) -> Untrained | None:
    """What the runs of a task could do before training; None where they were not tested then."""
    layers = results.layers
    rows = layers[(layers["task"] == task) & (layers["epoch"] == 0) & (layers["layer"] == 0)]
    return Untrained(float(rows["learned"].mean()), float(rows["success"].mean())) if len(rows) else None


def run_rows(results: Results) -> list[dict[str, Any]]:
    """A row a run: what it is, how far it has come, and learned goals by layer."""
    ends = {run: rows for run, rows in _by_run(results.layers)}
    rows = []
    for run in results.runs.to_dict("records"):
        layers = ends[run["run"]]
        layers = layers[layers["epoch"] == run["epoch"]]
        learned = {int(layer): (int(n), int(goals)) for layer, n, goals in layers[["layer", "learned", "goals"]].values}
        rows.append(run | {"learned": learned, "success": float(layers["success"].iloc[0])})
    return rows
