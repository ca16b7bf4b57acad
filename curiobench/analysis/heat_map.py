"""Final success of every method on every goal, as colours."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from curiobench.analysis.curves import layer_in_words
from curiobench.analysis.samples import Sample, TaskSamples
from curiobench.analysis.style import SMALL, TEXT, TEXT_WIDTH, labels
from curiobench.canvas import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_NUMBERS = 16
"""Methods up to which there is room for numbers."""
PAGE = 20
"""Methods in one figure."""
DARK = 62
"""Per cent above which the colour is dark."""
COLOURS = "YlGnBu"
"""Darker is better, in grey too."""


def draw_heat_map(task: TaskSamples, samples: Sequence[Sample]) -> list["Figure"]:
    """Success in per cent at the last evaluation, mean over seeds: a column a method, a row a goal, layers apart."""
    return [_page(task, samples[i : i + PAGE]) for i in range(0, len(samples), PAGE)]


def _page(task: TaskSamples, samples: Sequence[Sample]) -> "Figure":
    layers, counts = task.layers[1:], task.sizes[1:]
    row = 0.175 if len(task.goals) > 10 else 0.22
    width = min(TEXT_WIDTH, 3.1 + 0.42 * len(samples))
    figure = new_figure(max(width, 3.6), 1.1 + row * len(task.goals) + 0.25 * len(counts) + _name_height(samples))
    panels = figure.subplots(len(counts), 1, height_ratios=counts, squeeze=False)[:, 0]
    for axes, layer in zip(panels, layers, strict=True):
        _block(axes, task, samples, layer)
    _name_methods(panels[0], samples)
    bar = figure.colorbar(panels[0].collections[0], ax=panels, aspect=30, fraction=0.04, pad=0.02)
    bar.set_label("final success (%)", fontsize=TEXT)
    bar.outline.set_visible(False)
    return figure


def _block(axes: "Axes", task: TaskSamples, samples: Sequence[Sample], layer: int) -> None:
    """The goals of one layer. Drawn here, as seaborn's heat map draws its whole figure once more for each block."""
    goals = np.flatnonzero(task.goal_layers == layer)
    values = 100 * np.stack([sample.goal_success.mean(0)[goals] for sample in samples], axis=1)
    axes.pcolormesh(values, vmin=0, vmax=100, cmap=COLOURS, edgecolors="white", linewidth=0.4)
    if len(samples) <= MOST_NUMBERS:
        _write_numbers(axes, values)
    axes.invert_yaxis()
    axes.set_yticks(np.arange(len(goals)) + 0.5, [task.goals[goal] for goal in goals])
    axes.set_xticks([])
    axes.tick_params(axis="y", length=0)
    axes.spines[:].set_visible(False)
    axes.text(
        1.015, 0.5, layer_in_words(layer).replace(" ", "\n"), transform=axes.transAxes, va="center", fontsize=SMALL
    )


def _write_numbers(axes: "Axes", values: np.ndarray) -> None:
    """Each value (rows, columns) in its field, in white where that is dark."""
    for (row, column), value in np.ndenumerate(values):
        place, colour = (column + 0.5, row + 0.5), "white" if value > DARK else "0.15"
        number = axes.text(*place, f"{value:.0f}", ha="center", va="center", fontsize=SMALL - 1, color=colour)
        number.set_in_layout(False)  # they lie within, and measuring hundreds of them takes long


def _name_methods(axes: "Axes", samples: Sequence[Sample]) -> None:
    """Names of the columns above the first block, upright where they are too long to stand side by side."""
    names = list(labels(samples).values())
    axes.xaxis.tick_top()
    axes.set_xticks(np.arange(len(names)) + 0.5, names, rotation=90 if _upright(names) else 0)
    axes.tick_params(axis="x", length=0)


def _upright(names: Sequence[str]) -> bool:
    return max(map(len, names)) > 4 or len(names) > 9


def _name_height(samples: Sequence[Sample]) -> float:
    """Inches that the names of the columns take."""
    names = list(labels(samples).values())
    return 0.075 * max(map(len, names)) if _upright(names) else 0.15
