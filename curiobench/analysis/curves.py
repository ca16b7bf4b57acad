"""Curves over training: success, by layer as in the paper's Figures 4 and 7, learned goals, logged columns."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from curiobench.analysis.lines import Axis, Panel, draw_lines
from curiobench.analysis.samples import Sample, TaskSamples, thinned

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NUMBERS = ("no", "one", "two", "three", "four", "five")
"""Numbers of layers in words, as the paper names its panels."""


def draw_success(task: TaskSamples, samples: Sequence[Sample]) -> list["Figure"]:
    """Mean success over epochs: all goals, then the goals of each layer."""
    panels = [
        Panel(f"{layer_in_words(layer)} ({size})", _of_layer(place, lambda sample: sample.success))
        for place, (layer, size) in enumerate(zip(task.layers, task.sizes, strict=True))
    ]
    return draw_lines(samples, panels, _epochs(task, "success"))


def draw_learned(task: TaskSamples, samples: Sequence[Sample]) -> list["Figure"]:
    """Learned goals over epochs."""
    panel = Panel("", _of_layer(0, lambda sample: sample.learned), task.sizes[0])
    return draw_lines(samples, [panel], _epochs(task, f"learned goals, of {task.sizes[0]}"))


def draw_exploitation(task: TaskSamples, samples: Sequence[Sample]) -> list["Figure"]:
    """Share of steps at which the exploitation policy π_d acted, of samples with the hybrid mechanism (Figure 6C)."""
    return draw_lines(samples, [_of_column("share_exploitation")], _epochs(task, r"share of $\pi_d$"))


def draw_bonus(task: TaskSamples, samples: Sequence[Sample]) -> list["Figure"]:
    """Standard deviation over a batch of what curiosity adds to the reward, of samples with a curiosity method."""
    return draw_lines(samples, [_of_column("bonus_spread")], _epochs(task, r"spread of $\tau \cdot n(r_{int})$"))


def layer_in_words(layer: int) -> str:
    """A layer in words: "two layers"; "all goals" for 0."""
    return f"{NUMBERS[layer]} layer{'s' * (layer > 1)}" if layer else "all goals"


def _of_layer(place: int, read: Callable[[Sample], np.ndarray]) -> Callable[[Sample], tuple[np.ndarray, np.ndarray]]:
    """Reads the curve of the layer at a place."""

    def values(sample: Sample) -> tuple[np.ndarray, np.ndarray]:
        kept = thinned(len(sample.epochs))
        return sample.epochs[kept], read(sample)[:, kept, place]

    return values


def _of_column(column: str) -> Panel:
    """The panel of a column of progress.csv."""

    def values(sample: Sample) -> tuple[np.ndarray, np.ndarray]:
        epochs, rows = sample.logged[column]
        kept = thinned(len(epochs))
        return epochs[kept], rows[:, kept]

    return Panel("", values)


def _epochs(task: TaskSamples, y: str) -> Axis:
    """An x axis of epochs, with environment steps where an epoch has as many in all runs."""
    if task.steps_per_epoch is None:
        return Axis("epoch", y)
    millions = task.steps_per_epoch / 1e6
    return Axis("epoch (million steps)", y, lambda epoch: f"{epoch:.0f}\n({_short(epoch * millions)})")


def _short(number: float) -> str:
    """Three digits, or all of the whole number."""
    return f"{number:.3g}" if number < 100 else f"{number:.0f}"
