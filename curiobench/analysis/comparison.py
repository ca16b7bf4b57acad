"""Where methods end: learned goals, final success and area under the curve, as dots with intervals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from curiobench.analysis.curves import layer_in_words
from curiobench.analysis.lines import number_axis
from curiobench.analysis.samples import Sample, TaskSamples
from curiobench.analysis.statistics import area_under_curve, curve_interval
from curiobench.analysis.style import TEXT, TEXT_WIDTH, labels, styles
from curiobench.canvas import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE = 30
"""Methods in one figure."""
SEED_GAP = 0.08
"""Between the dots of equal seeds, in rows."""


@dataclass(frozen=True)
class Summary:
    """A number that a run is summed up by."""

    title: str
    of: Callable[[Sample], np.ndarray]
    """The number of each seed (S,) of a sample."""
    top: float = 1.0
    """Largest value there can be."""
    untrained: float | None = None
    """Its value before training, where that is drawn."""


def draw_comparison(task: TaskSamples, samples: Sequence[Sample]) -> list["Figure"]:
    """Mean over seeds and its 95 % bootstrap interval of each sample, with its seeds as small dots."""
    return [_page(task, samples[i : i + PAGE]) for i in range(0, len(samples), PAGE)]


def success_over_training(sample: Sample) -> np.ndarray:
    """(S,) success over all goals, averaged over training."""
    return area_under_curve(sample.epochs, sample.success[..., 0])


def _page(task: TaskSamples, samples: Sequence[Sample]) -> "Figure":
    """Learned goals, in all and of each layer, above success."""
    learned = [
        Summary(layer_in_words(layer), _learned(place), size)
        for place, (layer, size) in enumerate(zip(task.layers, task.sizes, strict=True))
    ]
    success = [
        Summary("at the end", lambda sample: sample.last_success[:, 0], untrained=task.untrained),
        Summary("over training (area under the curve)", success_over_training, untrained=task.untrained),
    ]
    rows = {"learned goals": learned, "mean success": success}
    figure = new_figure(TEXT_WIDTH, 1.0 + len(rows) * (0.45 + 0.19 * len(samples)))
    for part, (name, summaries) in zip(figure.subfigures(len(rows), 1), rows.items(), strict=True):
        part.supxlabel(name, fontsize=TEXT)
        for number, (axes, summary) in enumerate(
            zip(part.subplots(1, len(summaries), squeeze=False)[0], summaries, strict=True)
        ):
            _dots(axes, samples, summary)
            axes.tick_params(labelleft=number == 0)
    return figure


def _dots(axes: "Axes", samples: Sequence[Sample], summary: Summary) -> None:
    """A row a sample: its mean and interval, and below them its seeds."""
    names, looks = labels(samples), styles(samples)
    for row, sample in enumerate(samples):
        values, look = summary.of(sample), looks[sample] | {"linestyle": "", "clip_on": False}
        if sample.n_seeds > 1:
            axes.hlines(row, *curve_interval(values), color=look["color"], linewidth=1.6)
        axes.plot([values.mean()], [row], **look, markersize=5, zorder=3)
        below = row + 0.3 + SEED_GAP * _places_among_equals(values)
        axes.plot(values, below, "o", color=look["color"], alpha=0.8, markersize=2, markeredgewidth=0, clip_on=False)
    if summary.untrained is not None:
        axes.axvline(summary.untrained, color="0.45", linewidth=0.9, linestyle=(0, (1, 2)), zorder=0.5)
    axes.set_ylim(len(samples) - 0.5, -0.5)
    axes.set_yticks(range(len(samples)), [names[sample] for sample in samples])
    axes.set_xlim(-0.03 * summary.top, 1.03 * summary.top)
    number_axis(axes.xaxis, summary.top)
    axes.set_title(summary.title)
    axes.grid(axis="y", color="0.92", linewidth=0.6)
    axes.set_axisbelow(True)


def _places_among_equals(values: np.ndarray) -> np.ndarray:
    """(S,) how many of the values before each equal it, so that equal seeds do not hide each other."""
    return np.array([np.sum(values[:i] == value) for i, value in enumerate(values)])


def _learned(place: int) -> Callable[[Sample], np.ndarray]:
    """Learned goals of the layer at a place."""
    return lambda sample: sample.last_learned[:, place]
