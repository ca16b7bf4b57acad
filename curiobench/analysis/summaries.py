"""Estimates over the seeds of a method on a task, for tables."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from curiobench.analysis.samples import Sample, TaskSamples
from curiobench.analysis.statistics import (
    curve_interval,
    improvement_interval,
    interquartile_mean,
    probability_of_improvement,
    stratified_bootstrap,
)


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % bootstrap interval over seeds; both ends are NaN where there is none, as with one seed."""

    value: float
    low: float = float("nan")
    high: float = float("nan")

    @property
    def has_interval(self) -> bool:
        """Whether both ends are numbers."""
        return bool(np.isfinite(self.low) and np.isfinite(self.high))


Value = str | int | float | Estimate | None


@dataclass(frozen=True, eq=False)
class Summary:
    """Values of a sample by the columns of tables, which docs/results.md explains."""

    task: TaskSamples
    sample: Sample
    values: dict[str, Value]


def summarise(tasks: Sequence[TaskSamples], baseline: str = "sac") -> list[Summary]:
    """A summary of every task, method and variant; the last evaluation of a partial run counts as its end.

    Each is compared with the baseline, a method spec.
    """
    pairs = [(task, sample) for task in tasks for sample in task.samples]
    return [Summary(task, sample, _values(task, sample, _baseline(task, sample, baseline))) for task, sample in pairs]


def _baseline(task: TaskSamples, sample: Sample, baseline: str) -> Sample | None:
    """The baseline of the same variant, or else the only one of as many epochs, steps and updates; None without one."""
    if sample.method == baseline:
        return None
    found = [other for other in task.samples if other.method == baseline]
    alike = [other for other in found if other.variant == sample.variant] or found
    as_long = [other for other in alike if _lengths(other) == _lengths(sample)]
    return as_long[0] if len(as_long) == 1 else None


def _lengths(sample: Sample) -> set[tuple[int, ...]]:
    return set(sample.runs[["epoch", "steps", "updates"]].itertuples(index=False, name=None))


def _values(task: TaskSamples, sample: Sample, baseline: Sample | None) -> dict[str, Value]:
    runs, success, reached = sample.runs, _final(sample), sample.reached
    means = np.column_stack([sample.last_learned, success, sample.area])
    *learned, of_success, of_area = map(Estimate, means.mean(axis=0), *curve_interval(means))
    middle = stratified_bootstrap(sample.goal_success[:, None, :], interquartile_mean)
    some = "" if len(reached) in (0, len(runs)) else f" ({len(reached)} of {len(runs)} seeds)"
    return {
        "method": sample.method,
        "variant": sample.variant,
        "seeds": sample.n_seeds,
        **{key_of("learned", layer): value for layer, value in zip(task.sizes, learned, strict=True)},
        "middle_success": Estimate(float(interquartile_mean(sample.goal_success)), *middle),
        "success": of_success,
        "area": of_area,
        "epochs_to_good": f"{reached.mean():.1f}{some}" if len(reached) else None,
        "better": None if baseline is None else _improvement(success, _final(baseline)),
        "better_area": None if baseline is None else _improvement(sample.area, baseline.area),
        "hours": float(runs["hours"].mean()),
        "memory": float(runs["peak_memory_mb"].max()),
        "machine": "; ".join(sorted(set(runs["machine"]) - {""})) or None,
    }


def key_of(name: str, layer: int) -> str:
    """Name of a column of numbers of a layer; 0 is all layers together."""
    return f"{name}_{layer}" if layer else name


def _final(sample: Sample) -> np.ndarray:
    """(S,) success over all goals at the end, rounded so that equal ones tie."""
    return np.round(sample.last_success[:, 0], 9)


def _improvement(scores: np.ndarray, baseline: np.ndarray) -> Estimate | None:
    """None where either has a single seed: the probability would be 0 or 1, whatever the methods.

    Where all runs of one are better than all of the other every resample has the same value; that is no interval.
    """
    if min(len(scores), len(baseline)) < 2:
        return None
    x, y = scores[:, None], baseline[:, None]
    low, high = improvement_interval(x, y)
    return Estimate(probability_of_improvement(x, y), *((low, high) if low < high else ()))
