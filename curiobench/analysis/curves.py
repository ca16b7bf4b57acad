"""Figures of lines: success by layer as in the paper's Figures 4 and 7, learned goals, logged columns, profiles."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from curiobench.analysis.lines import Axis, Panel, draw_lines
from curiobench.analysis.samples import Sample, TaskSamples
from curiobench.analysis.statistics import performance_profile
from curiobench.analysis.style import layer_in_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_POINTS = 150  # points that are drawn of one curve, evenly spread: a panel is no more than a few hundred dots wide
THRESHOLDS = np.linspace(0, 1, 101)  # τ of a profile, success from 0 to 1


def draw_success(task: TaskSamples, samples: Sequence[Sample]) -> list["Figure"]:
    """Mean success over epochs: all goals, then the goals of each layer."""
    panels = [
        Panel(f"{layer_in_words(layer)} ({size})", lambda s, place=place: _thinned(s.epochs, s.success[..., place]))
        for place, (layer, size) in enumerate(task.sizes.items())
    ]
    return draw_lines(samples, panels, _epochs(task, "success"))


def draw_learned(task: TaskSamples, samples: Sequence[Sample]) -> list["Figure"]:
    """Learned goals over epochs."""
    panel = Panel("", lambda sample: _thinned(sample.epochs, sample.learned[..., 0]), task.sizes[0])
    return draw_lines(samples, [panel], _epochs(task, f"learned goals, of {task.sizes[0]}"))


def draw_exploitation(task: TaskSamples, samples: Sequence[Sample]) -> list["Figure"]:
    """Share of steps at which the exploitation policy π_d acted, of samples with the hybrid mechanism (Figure 6C)."""
    return _draw_logged(task, samples, "share_exploitation", r"share of $\pi_d$")


def draw_bonus(task: TaskSamples, samples: Sequence[Sample]) -> list["Figure"]:
    """Standard deviation over a batch of what curiosity adds to the reward, of samples with a curiosity method."""
    return _draw_logged(task, samples, "bonus_spread", r"spread of $\tau \cdot n(r_{int})$")


def draw_profile(task: TaskSamples, samples: Sequence[Sample]) -> list["Figure"]:
    """Share of goals and seeds whose final success is above τ, over τ; a seed's goals are resampled together."""

    def profile(sample: Sample) -> tuple[np.ndarray, np.ndarray]:
        return THRESHOLDS, np.stack([performance_profile(seed[None], THRESHOLDS) for seed in sample.goal_success])

    return draw_lines(samples, [Panel("", profile)], Axis("final success τ", "share above τ", integers=False))


def _draw_logged(task: TaskSamples, samples: Sequence[Sample], column: str, name: str) -> list["Figure"]:
    """A column of progress.csv over epochs."""
    return draw_lines(samples, [Panel("", lambda sample: _thinned(*sample.logged[column]))], _epochs(task, name))


def _thinned(epochs: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At most `MOST_POINTS` of the epochs (E,) and values (S, E)."""
    kept = thinned(len(epochs))
    return epochs[kept], values[:, kept]


def thinned(count: int) -> np.ndarray:
    """Positions of at most `MOST_POINTS` of `count` points, evenly spread, first and last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).round().astype(int))


def _epochs(task: TaskSamples, y: str) -> Axis:
    """An x axis of epochs, with environment steps where an epoch has as many in all runs."""
    if task.steps_per_epoch is None:
        return Axis("epoch", y)
    millions = task.steps_per_epoch / 1e6
    return Axis("epoch (million steps)", y, lambda epoch: f"{epoch:.0f}\n({_short(epoch * millions)})")


def _short(number: float) -> str:
    """Three digits, or all before the decimal point."""
    return f"{number:.3g}" if number < 100 else f"{number:.0f}"
