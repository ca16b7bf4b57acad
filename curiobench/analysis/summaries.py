"""What a table has of a method on a task: estimates over its seeds."""

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
    """A number with its 95 % bootstrap interval over seeds."""

    value: float  # the estimate
    low: float = float("nan")  # low end; NaN where there is no interval, as with one seed
    high: float = float("nan")  # high end

    @property
    def has_interval(self) -> bool:
        """Whether both ends are numbers."""
        return bool(np.isfinite(self.low) and np.isfinite(self.high))


@dataclass(frozen=True)
class Summary:
    """Estimates of a sample."""

    task: TaskSamples
    sample: Sample
    learned: dict[int, Estimate]  # learned goals by layer, 0 for all together, mean over seeds
    success: Estimate  # success at the end, mean over goals and seeds
    middle_success: Estimate  # success at the end, interquartile mean of all goals of all seeds
    area: Estimate  # success over training, mean over goals, epochs and seeds: the normalised area under the curve
    better: Estimate | None
    """Probability that a run has more success at the end than one of the baseline; None without two seeds of both."""
    better_area: Estimate | None  # the same of success over training

    @property
    def compared(self) -> list[Estimate]:
        """The comparisons with the baseline that there are."""
        return [estimate for estimate in (self.better, self.better_area) if estimate is not None]


def summarise(tasks: Sequence[TaskSamples], baseline: str = "sac") -> list[Summary]:
    """A summary of every task, method and variant; of partial runs the last evaluation counts as their end.

    All others are compared with the baseline, a method, of the same variant or without any.
    """
    return [_summary(task, sample, _baseline(task, sample, baseline)) for task in tasks for sample in task.samples]


def _baseline(task: TaskSamples, sample: Sample, baseline: str) -> Sample | None:
    """The baseline of the same variant, or its only one, if its runs are as long as those of the sample."""
    found = {other.variant: other for other in task.samples if other.method == baseline}
    if sample.method == baseline or (sample.variant not in found and len(found) != 1):
        return None
    other = found.get(sample.variant) or next(iter(found.values()))
    return other if _lengths(other) == _lengths(sample) else None


def _lengths(sample: Sample) -> set[tuple[int, int, int]]:
    return set(sample.runs[["epoch", "steps", "updates"]].itertuples(index=False, name=None))


def _summary(task: TaskSamples, sample: Sample, baseline: Sample | None) -> Summary:
    success = _final(sample)
    means = np.column_stack([sample.last_learned, success, sample.area])
    *learned, of_success, of_area = map(Estimate, means.mean(axis=0), *curve_interval(means))
    middle = stratified_bootstrap(sample.goal_success[:, None, :], interquartile_mean)
    return Summary(
        task=task,
        sample=sample,
        learned=dict(zip(task.sizes, learned, strict=True)),
        success=of_success,
        middle_success=Estimate(float(interquartile_mean(sample.goal_success)), *middle),
        area=of_area,
        better=None if baseline is None else _improvement(success, _final(baseline)),
        better_area=None if baseline is None else _improvement(sample.area, baseline.area),
    )


def _final(sample: Sample) -> np.ndarray:
    """(S,) success over all goals at the end, rounded so that equal ones are a tie."""
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
