"""Line plots with bands.

A few methods are drawn in the same panels. More methods are drawn as small multiples, with all other methods in grey.
"""

import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from curiobench.analysis.canvas import new_figure
from curiobench.analysis.colours import base
from curiobench.analysis.samples import Sample
from curiobench.analysis.statistics import curve_interval
from curiobench.analysis.style import GREY, SMALL, TEXT, TEXT_WIDTH, method_name, names, styles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import XAxis, YAxis
    from matplotlib.figure import Figure

OVERLAID = 6  # most lines that can be distinguished in one panel
GROUPS = 7  # most rows of small multiples in one figure, as many as fit on a page
COLUMNS = 3  # panels side by side
QUARTERS = (0, 0.25, 0.5, 0.75, 1)  # ticks of shares
CLOSER = (0.1, 0.2, 0.4)  # possible ends of the y axis below 1, so that low curves can be distinguished
STEPS = (1, 2, 2.5, 5, 10)  # distances of ticks of counts, times a power of ten
REFERENCE = "sac"  # method in every panel of small multiples, because the other methods extend it
_WORDS = re.compile("(?<=[a-z0-9])(?=[A-Z])")  # boundaries between the words of a class name


@dataclass(frozen=True)
class Panel:
    """One quantity that is drawn for each sample."""

    title: str
    values: Callable[[Sample], tuple[np.ndarray, np.ndarray]]  # x (X,) and values (S, X) of a sample
    top: float = 1.0  # largest possible value


@dataclass(frozen=True)
class Axis:
    """Axis labels and x ticks of all panels of a figure."""

    x: str
    y: str
    ticks: Callable[[float], str] | None = None  # formats a tick of the x axis; None prints the number
    integers: bool = True  # whether x is an integer


def draw_lines(samples: Sequence[Sample], panels: Sequence[Panel], axis: Axis) -> list["Figure"]:
    """Draw each sample's mean over seeds in each panel, with its 95 % interval as a band; several figures if needed."""
    curves = _Curves(samples, panels)
    panels = _closer(curves, panels)
    if len(samples) <= OVERLAID:
        return [_overlaid(curves, panels, axis)]
    groups = _groups(samples)
    rows = GROUPS if len(panels) > 1 else GROUPS * COLUMNS
    return [_multiples(curves, groups[i : i + rows], panels, axis) for i in range(0, len(groups), rows)]


def _closer(curves: "_Curves", panels: Sequence[Panel]) -> list[Panel]:
    """Panels whose y axes end at the same share of their largest possible values; it is small if all curves are low."""
    tops = {panel.title: panel.top for panel in panels}
    highest = max(max(mean.max(), high.max()) / tops[title] for (_, title), (_, mean, _, high) in curves.known.items())
    share = next((share for share in CLOSER if highest <= 0.9 * share), 1.0)
    least = 2 if panels[0].top > 1 else 0  # an axis of counts has integers
    return [replace(panel, top=max(share * panel.top, least)) for panel in panels]


class _Curves:
    """Draws samples, each in its own style.

    Attributes:
        known: x, mean over seeds, and low and high end of its interval, `(X,)` each, by sample and panel title.
    """

    def __init__(self, samples: Sequence[Sample], panels: Sequence[Panel]) -> None:
        self.samples = samples
        self.names, self.styles = names(samples), styles(samples)
        self.known: dict[tuple[Sample, str], tuple[np.ndarray, ...]] = {}
        for sample in samples:
            for panel in panels:
                x, values = panel.values(sample)
                interval = curve_interval(values) if sample.n_seeds > 1 else (values[0], values[0])
                self.known[sample, panel.title] = (x, values.mean(0), *interval)

    def draw(self, axes: "Axes", sample: Sample, panel: Panel) -> None:
        """Line and band of a sample, with about five markers, shifted against those of the other samples."""
        x, mean, low, high = self.known[sample, panel.title]
        style = self.styles[sample]
        if sample.n_seeds > 1:
            axes.fill_between(x, low, high, color=style["color"], alpha=0.16, linewidth=0)
        gap = max(1, len(x) // 5)
        shift = round(gap * (self.samples.index(sample) + 0.5) / len(self.samples))
        marks = list(range(min(shift, len(x) - 1), len(x), gap))
        # clip_on: markers at the edge are whole
        axes.plot(x, mean, markevery=marks, clip_on=False, **style)

    def looks(self, samples: Sequence[Sample]) -> list[dict]:
        """Labels and styles of `samples` for the legend, in the order of all samples."""
        return [self.styles[sample] for sample in self.samples if sample in samples]


def _overlaid(curves: _Curves, panels: Sequence[Panel], axis: Axis) -> "Figure":
    """All samples in every panel."""
    columns = len(panels) if len(panels) <= COLUMNS else 2 if len(panels) == 4 else COLUMNS
    rows = -(-len(panels) // columns)
    figure = new_figure(TEXT_WIDTH if columns > 1 else 0.7 * TEXT_WIDTH, 1.1 + (1.8 if rows > 1 else 2.0) * rows)
    for number, (axes, panel) in enumerate(zip(_grid(figure, columns, len(panels)), panels, strict=True)):
        for sample in curves.samples:
            curves.draw(axes, sample, panel)
        _finish(axes, panel, axis, bins=5 if columns < COLUMNS else 4, first=number % columns == 0)
        axes.set_title(f"{chr(ord('A') + number)}  {panel.title}" if len(panels) > 1 else panel.title)
    _surround(figure, axis, curves.looks(curves.samples))
    return figure


def _multiples(curves: _Curves, groups: Sequence[Sequence[Sample]], panels: Sequence[Panel], axis: Axis) -> "Figure":
    """One row of panels per group, or one field per group if there is a single panel; the other samples in grey."""
    fields = [(group, panel) for group in groups for panel in panels]
    columns = len(panels) if len(panels) > 1 else COLUMNS
    rows = -(-len(fields) // columns)
    figure = new_figure(TEXT_WIDTH, 1.3 + (1.0 if rows > 4 else 1.2) * rows)
    for number, (axes, (group, panel)) in enumerate(zip(_grid(figure, columns, len(fields)), fields, strict=True)):
        for sample in curves.samples:
            if sample not in group:
                axes.plot(*curves.known[sample, panel.title][:2], **GREY)
        for sample in group:
            curves.draw(axes, sample, panel)
        _finish(axes, panel, axis, bins=4 if columns <= COLUMNS else 3, first=number % columns == 0)
        name = _name_of(curves, group)
        if len(panels) == 1:
            axes.set_title(textwrap.shorten(name, 34))
            continue
        if number < columns:
            axes.set_title(panel.title)
        if number % columns == 0:
            axes.set_ylabel(textwrap.fill(_WORDS.sub(" ", name) if len(name) > 15 else name, 15), fontsize=SMALL)
    drawn = [sample for group in groups for sample in group]
    _surround(figure, axis, [*curves.looks(drawn), {"label": "all others", **GREY}])
    return figure


def _name_of(curves: _Curves, group: Sequence[Sample]) -> str:
    """Title of a group: its curiosity method, or the name of its sample if it has only one of that method.

    The legend has the number of seeds.
    """
    of_method = [sample for sample in group if base(sample.method) == base(group[-1].method)]
    return method_name(base(group[-1].method)) if len(of_method) > 1 else curves.names[group[-1]]


def _grid(figure: "Figure", columns: int, count: int) -> list["Axes"]:
    """The first `count` fields of a grid. The lowest field of each column has tick labels on the x axis."""
    grid = figure.add_gridspec(-(-count // columns), columns)
    found: list[Axes] = []
    for number in range(count):
        axes = figure.add_subplot(grid[divmod(number, columns)], sharex=found[0] if found else None)
        axes.tick_params(labelbottom=number + columns >= count)
        if number + columns >= count and number // columns < (count - 1) // columns:
            axes.xaxis.set_in_layout(False)  # the empty field below has room for its tick labels
            figure.get_layout_engine().set(rect=(0, 0, 0.975, 1), w_pad=0.12)
        found.append(axes)
    return found


def _finish(axes: "Axes", panel: Panel, axis: Axis, bins: int, first: bool) -> None:
    """Set limits and ticks, with at most `bins` intervals on the x axis; y tick labels only on the `first` of a row."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    axes.set_xlim(0, max(line.get_xdata()[-1] for line in axes.lines) or 1)
    axes.set_ylim(-0.04 * panel.top, 1.04 * panel.top)
    axes.xaxis.set_major_locator(MaxNLocator(bins, integer=axis.integers, steps=STEPS))
    number_axis(axes.yaxis, panel.top)
    if axis.ticks is not None:
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: axis.ticks(x)))
    axes.tick_params(labelleft=first)


def number_axis(axis: "XAxis | YAxis", top: float) -> None:
    """Set the ticks of an axis of shares, or of counts if `top` is above 1."""
    from matplotlib.ticker import FixedLocator, MaxNLocator

    axis.set_major_locator(FixedLocator(QUARTERS) if top == 1 else MaxNLocator(5, integer=top > 1, steps=STEPS))
    axis.set_major_formatter("{x:g}")


def _surround(figure: "Figure", axis: Axis, looks: Sequence[dict]) -> None:
    """Add the axis labels and a legend above all panels."""
    from matplotlib.lines import Line2D

    figure.supylabel(axis.y, fontsize=TEXT, parse_math=True)
    for axes in figure.axes:
        if axes.xaxis.get_tick_params()["labelbottom"]:
            axes.set_xlabel(axis.x)
    longest = max(len(look["label"]) for look in looks)
    columns = max(1, min(len(looks), int(figure.get_figwidth() * 15 / (longest + 7))))
    rows = -(-len(looks) // columns)
    full = len(looks) - columns * (rows - 1)
    # matplotlib fills a legend column by column; this order shows the entries row by row
    order = [row * columns + column for column in range(columns) for row in range(rows - (column >= full))]
    handles = [Line2D([], [], **looks[place]) for place in order]
    figure.legend(handles=handles, loc="outside upper center", ncols=columns, handlelength=3)


def _groups(samples: Sequence[Sample]) -> list[list[Sample]]:
    """Groups of the samples of one curiosity method and the reference; of single samples if a method has too many."""
    reference = [sample for sample in samples if sample.method == REFERENCE]
    reference = reference if len(reference) == 1 else []
    others = [sample for sample in samples if sample not in reference]
    groups: dict[str, list[Sample]] = {}
    for sample in others:
        groups.setdefault(base(sample.method), []).append(sample)
    if max(map(len, groups.values())) >= OVERLAID:
        return [[*reference, sample] for sample in others]
    return [[*reference, *group] for group in groups.values()]
