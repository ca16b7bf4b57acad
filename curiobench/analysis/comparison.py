"""Figures of the end of training: methods in numbers with their seeds, and a map of success on every goal."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from curiobench.analysis.canvas import new_figure
from curiobench.analysis.lines import number_axis
from curiobench.analysis.samples import Sample, TaskSamples
from curiobench.analysis.statistics import curve_interval
from curiobench.analysis.style import SMALL, TEXT, TEXT_WIDTH, labels, layer_in_words, styles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROWS, COLUMNS = 30, 20  # methods in one comparison, and in one heat map
SEED_GAP = 0.08  # between the dots of equal seeds, in rows
MOST_NUMBERS = 16  # methods up to which a heat map has room for numbers
DARK = 62  # per cent above which the colour is dark
MAP = "YlGnBu"  # darker is better, in grey too


@dataclass(frozen=True)
class Metric:
    """A number per run, such as final success."""

    title: str
    of: Callable[[Sample], np.ndarray]  # the number of each seed (S,) of a sample
    top: float = 1.0  # largest value there can be
    untrained: float | None = None  # value before training, drawn as a dotted line


def draw_comparison(task: TaskSamples, samples: Sequence[Sample]) -> list["Figure"]:
    """Mean over seeds and its 95 % bootstrap interval of each sample, with its seeds as small dots."""
    return [_compared(task, samples[i : i + ROWS]) for i in range(0, len(samples), ROWS)]


def _compared(task: TaskSamples, samples: Sequence[Sample]) -> "Figure":
    """Learned goals, in all and of each layer, above success."""
    learned = [
        Metric(layer_in_words(layer), lambda sample, place=place: sample.last_learned[:, place], size)
        for place, (layer, size) in enumerate(task.sizes.items())
    ]
    before = task.untrained and task.untrained.success
    success = [
        Metric("at the end", lambda sample: sample.last_success[:, 0], untrained=before),
        Metric("over training", lambda sample: sample.area, untrained=before),
    ]
    rows = {"learned goals": learned, "mean success": success}
    figure = new_figure(TEXT_WIDTH, 1.0 + len(rows) * (0.45 + 0.19 * len(samples)))
    for part, (name, scores) in zip(figure.subfigures(len(rows), 1), rows.items(), strict=True):
        part.supxlabel(name, fontsize=TEXT)
        panels = part.subplots(1, len(scores), squeeze=False)[0]
        for number, (axes, score) in enumerate(zip(panels, scores, strict=True)):
            _dots(axes, samples, score)
            axes.tick_params(labelleft=number == 0)
    return figure


def _dots(axes: "Axes", samples: Sequence[Sample], score: Metric) -> None:
    """A row per sample: mean and interval, and below them the seeds; equal ones are below each other."""
    names, looks = labels(samples), styles(samples)
    for row, sample in enumerate(samples):
        values, look = score.of(sample), looks[sample] | {"linestyle": "", "clip_on": False}
        if sample.n_seeds > 1:
            axes.hlines(row, *curve_interval(values), color=look["color"], linewidth=1.6)
        axes.plot([values.mean()], [row], **look, markersize=5, zorder=3)
        equals = np.array([np.sum(values[:i] == value) for i, value in enumerate(values)])
        below = row + 0.3 + SEED_GAP * equals
        axes.plot(values, below, "o", color=look["color"], alpha=0.8, markersize=2, markeredgewidth=0, clip_on=False)
    if score.untrained is not None:
        axes.axvline(score.untrained, color="0.45", linewidth=0.9, linestyle=(0, (1, 2)), zorder=0.5)
    axes.set_ylim(len(samples) - 0.5, -0.5)
    axes.set_yticks(range(len(samples)), [names[sample] for sample in samples])
    axes.set_xlim(-0.03 * score.top, 1.03 * score.top)
    number_axis(axes.xaxis, score.top)
    axes.set_title(score.title)
    axes.grid(axis="y", color="0.92", linewidth=0.6)
    axes.set_axisbelow(True)


def draw_heat_map(task: TaskSamples, samples: Sequence[Sample]) -> list["Figure"]:
    """Success in per cent at the last evaluation, mean over seeds: a column for each method, a row for each goal."""
    return [_mapped(task, samples[i : i + COLUMNS]) for i in range(0, len(samples), COLUMNS)]


def _mapped(task: TaskSamples, samples: Sequence[Sample]) -> "Figure":
    sizes = {layer: size for layer, size in task.sizes.items() if layer}
    names = list(labels(samples).values())
    upright = max(map(len, names)) > 4 or len(names) > 9  # too long to stand side by side
    row = 0.175 if len(task.goals) > 10 else 0.22
    height = 1.1 + row * len(task.goals) + 0.25 * len(sizes) + (0.075 * max(map(len, names)) if upright else 0.15)
    figure = new_figure(max(min(TEXT_WIDTH, 3.1 + 0.42 * len(samples)), 3.6), height)
    panels = figure.subplots(len(sizes), 1, height_ratios=list(sizes.values()), squeeze=False)[:, 0]
    for axes, layer in zip(panels, sizes, strict=True):
        _block(axes, task, samples, layer)
    panels[0].xaxis.tick_top()
    panels[0].set_xticks(np.arange(len(names)) + 0.5, names, rotation=90 if upright else 0)
    panels[0].tick_params(axis="x", length=0)
    bar = figure.colorbar(panels[0].collections[0], ax=panels, aspect=30, fraction=0.04, pad=0.02)
    bar.set_label("final success (%)", fontsize=TEXT)
    bar.outline.set_visible(False)
    return figure


def _block(axes: "Axes", task: TaskSamples, samples: Sequence[Sample], layer: int) -> None:
    """The goals of one layer."""
    goals = np.flatnonzero(task.goal_layers == layer)
    values = 100 * np.stack([sample.goal_success.mean(0)[goals] for sample in samples], axis=1)
    axes.pcolormesh(values, vmin=0, vmax=100, cmap=MAP, edgecolors="white", linewidth=0.4)
    if len(samples) <= MOST_NUMBERS:
        _write_numbers(axes, values)
    axes.invert_yaxis()
    axes.set_yticks(np.arange(len(goals)) + 0.5, [task.goals[goal] for goal in goals])
    axes.set_xticks([])
    axes.tick_params(axis="y", length=0)
    axes.spines[:].set_visible(False)
    name = layer_in_words(layer).replace(" ", "\n")
    axes.text(1.015, 0.5, name, transform=axes.transAxes, va="center", fontsize=SMALL)


def _write_numbers(axes: "Axes", values: np.ndarray) -> None:
    """Each value (rows, columns) in its field, in white where that is dark."""
    for (row, column), value in np.ndenumerate(values):
        place, colour = (column + 0.5, row + 0.5), "white" if value > DARK else "0.15"
        number = axes.text(*place, f"{value:.0f}", ha="center", va="center", fontsize=SMALL - 1, color=colour)
        number.set_in_layout(False)  # they lie within, and measuring hundreds of them takes long
