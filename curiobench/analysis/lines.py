"""Lines with bands: a few methods over each other, more of them as small multiples, each against the others in grey."""

import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from curiobench.analysis.samples import Sample
from curiobench.analysis.statistics import curve_interval
from curiobench.analysis.style import OTHERS, SMALL, TEXT, TEXT_WIDTH, base, labels, method_name, styles
from curiobench.canvas import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import XAxis, YAxis
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

OVERLAID = 6
"""Most lines that can still be told apart in one panel."""
GROUPS = 7
"""Most rows of small multiples in one figure: a page holds no more."""
COLUMNS = 3
"""Panels side by side."""
QUARTERS = (0, 0.25, 0.5, 0.75, 1)
"""Ticks of shares."""
CLOSER = (0.1, 0.2, 0.4)
"""Where the y axis may end instead of at 1, so that low curves can be told apart."""
STEPS = (1, 2, 2.5, 5, 10)
"""Distances of ticks of counts, times a power of ten."""
REFERENCE = "sac"
"""Method that stands in every panel of small multiples: what the others add to."""
_WORDS = re.compile("(?<=[a-z0-9])(?=[A-Z])")
"""Where the words of a class name meet."""


@dataclass(frozen=True)
class Panel:
    """One thing that is drawn of each sample."""

    title: str
    values: Callable[[Sample], tuple[np.ndarray, np.ndarray]]
    """x (X,) and values (S, X) of a sample."""
    top: float = 1.0
    """Largest value there can be."""


@dataclass(frozen=True)
class Axis:
    """What the axes of all panels of a figure are called."""

    x: str
    y: str
    ticks: Callable[[float], str] | None = None
    """Text of a tick on the x axis, where it is more than its number."""
    whole: bool = True
    """Whether x is counted."""


def draw_lines(samples: Sequence[Sample], panels: Sequence[Panel], axis: Axis) -> list["Figure"]:
    """Draw the mean over seeds of each sample in each panel, with the 95 % bootstrap interval as a band.

    Returns:
        One figure; several where small multiples need more than a page.
    """
    curves = _Curves(samples)
    panels = _closer(curves, panels)
    if len(samples) <= OVERLAID:
        return [_overlaid(curves, panels, axis)]
    groups = _groups(samples)
    rows = GROUPS if len(panels) > 1 else GROUPS * COLUMNS
    return [_multiples(curves, groups[i : i + rows], panels, axis) for i in range(0, len(groups), rows)]


def _closer(curves: "_Curves", panels: Sequence[Panel]) -> list[Panel]:
    """Panels whose axes end at the same share of their largest values, a smaller one where all curves are low."""
    highest = max(curves.highest(sample, panel) / panel.top for sample in curves.samples for panel in panels)
    share = next((share for share in CLOSER if highest <= 0.9 * share), 1.0)
    least = 2 if panels[0].top > 1 else 0  # counts keep whole numbers
    return [replace(panel, top=max(share * panel.top, least)) for panel in panels]


class _Curves:
    """Draws samples, each in its own look, and computes each mean and band once."""

    def __init__(self, samples: Sequence[Sample]) -> None:
        self.samples = samples
        self.names, self.styles = labels(samples), styles(samples)
        self._known: dict[tuple[Sample, str], tuple[np.ndarray, ...]] = {}

    def draw(self, axes: "Axes", sample: Sample, panel: Panel) -> None:
        """Line and band of a sample, markers where those of the other samples are not."""
        x, mean, low, high = self._curve(sample, panel)
        style = self.styles[sample]
        if sample.n_seeds > 1:
            axes.fill_between(x, low, high, color=style["color"], alpha=0.16, linewidth=0)
        marks = self._marked(sample, len(x))
        axes.plot(x, mean, label=self.names[sample], markevery=marks, clip_on=False, **style)  # markers stay whole

    def draw_grey(self, axes: "Axes", sample: Sample, panel: Panel) -> None:
        x, mean, *_ = self._curve(sample, panel)
        axes.plot(x, mean, **OTHERS)

    def highest(self, sample: Sample, panel: Panel) -> float:
        """Largest value of line and band."""
        _, mean, _, high = self._curve(sample, panel)
        return max(mean.max(), high.max())

    def handles(self) -> list["Line2D"]:
        """Entries of a legend, in the order of the samples."""
        from matplotlib.lines import Line2D

        return [Line2D([], [], label=self.names[sample], **self.styles[sample]) for sample in self.samples]

    def _curve(self, sample: Sample, panel: Panel) -> tuple[np.ndarray, ...]:
        key = (sample, panel.title)
        if key not in self._known:
            x, values = panel.values(sample)
            interval = curve_interval(values) if sample.n_seeds > 1 else (values[0], values[0])
            self._known[key] = (x, values.mean(0), *interval)
        return self._known[key]

    def _marked(self, sample: Sample, points: int) -> list[int]:
        """Positions of about five markers, shifted from sample to sample."""
        gap = max(1, points // 5)
        shift = round(gap * (self.samples.index(sample) + 0.5) / len(self.samples))
        return list(range(min(shift, points - 1), points, gap))


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
    _surround(figure, axis, curves.handles())
    return figure


def _multiples(curves: _Curves, groups: Sequence[Sequence[Sample]], panels: Sequence[Panel], axis: Axis) -> "Figure":
    """A row of panels for each group, or, of one panel only, a field for each group; the other samples in grey."""
    fields = [(group, panel) for group in groups for panel in panels]
    columns = len(panels) if len(panels) > 1 else COLUMNS
    rows = -(-len(fields) // columns)
    figure = new_figure(TEXT_WIDTH, 1.3 + (1.0 if rows > 4 else 1.2) * rows)
    for number, (axes, (group, panel)) in enumerate(zip(_grid(figure, columns, len(fields)), fields, strict=True)):
        for sample in curves.samples:
            if sample not in group:
                curves.draw_grey(axes, sample, panel)
        for sample in group:
            curves.draw(axes, sample, panel)
        _finish(axes, panel, axis, bins=4 if columns <= COLUMNS else 3, first=number % columns == 0)
        _name_field(axes, panel, curves, group, number if len(panels) > 1 else None, columns)
    shown = {sample for group in groups for sample in group}
    handles = [h for h, sample in zip(curves.handles(), curves.samples, strict=True) if sample in shown]
    _surround(figure, axis, [*handles, _grey_handle()])
    return figure


def _grid(figure: "Figure", columns: int, count: int) -> list["Axes"]:
    """The first `count` fields of a grid; those at the bottom of their column have numbers on the x axis."""
    grid = figure.add_gridspec(-(-count // columns), columns)
    found: list[Axes] = []
    for number in range(count):
        axes = figure.add_subplot(grid[divmod(number, columns)], sharex=found[0] if found else None)
        axes.tick_params(labelbottom=number + columns >= count)
        if axes.xaxis.get_tick_params()["labelbottom"] and number // columns < (count - 1) // columns:
            axes.xaxis.set_in_layout(False)  # its numbers have the empty field below for themselves
            figure.get_layout_engine().set(rect=(0, 0, 0.975, 1), w_pad=0.12)
        found.append(axes)
    return found


def _finish(axes: "Axes", panel: Panel, axis: Axis, bins: int, first: bool) -> None:
    """Limits and ticks, in `bins` parts on the x axis; numbers on the y axis where it is the `first` in its row."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    axes.set_xlim(0, max(line.get_xdata()[-1] for line in axes.lines) or 1)
    axes.set_ylim(-0.04 * panel.top, 1.04 * panel.top)
    axes.xaxis.set_major_locator(MaxNLocator(bins, integer=axis.whole, steps=STEPS))
    number_axis(axes.yaxis, panel.top)
    if axis.ticks is not None:
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: axis.ticks(x)))
    axes.tick_params(labelleft=first)


def number_axis(axis: "XAxis | YAxis", top: float) -> None:
    """Ticks of an axis of shares, or of counts where its `top` is above 1."""
    from matplotlib.ticker import FixedLocator, MaxNLocator

    axis.set_major_locator(FixedLocator(QUARTERS) if top == 1 else MaxNLocator(5, integer=top > 1, steps=STEPS))
    axis.set_major_formatter("{x:g}")


def _name_field(
    axes: "Axes", panel: Panel, curves: _Curves, group: Sequence[Sample], number: int | None, columns: int
) -> None:
    """Write whose field it is: beside the row, below the panels' titles, or above the field where `number` is None."""
    name = method_name(base(group[-1].method))
    if sum(base(sample.method) == base(group[-1].method) for sample in group) < 2:
        name = curves.names[group[-1]]
    if number is None:
        axes.set_title(textwrap.shorten(name, 34))
        return
    if number < columns:
        axes.set_title(panel.title)
    if number % columns == 0:
        axes.set_ylabel(textwrap.fill(_WORDS.sub(" ", name) if len(name) > 15 else name, 15), fontsize=SMALL)


def _surround(figure: "Figure", axis: Axis, handles: Sequence["Line2D"]) -> None:
    """Names of the axes and a legend above all panels."""
    figure.supylabel(axis.y, fontsize=TEXT, parse_math=True)
    for axes in figure.axes:
        if axes.xaxis.get_tick_params()["labelbottom"]:
            axes.set_xlabel(axis.x)
    longest = max(len(str(handle.get_label())) for handle in handles)
    columns = max(1, min(len(handles), int(figure.get_figwidth() * 15 / (longest + 7))))
    figure.legend(handles=_by_rows(handles, columns), loc="outside upper center", ncols=columns, handlelength=3)


def _by_rows(handles: Sequence["Line2D"], columns: int) -> list["Line2D"]:
    """Handles in the order in which a legend, which fills column by column, shows them row by row."""
    rows = -(-len(handles) // columns)
    full = len(handles) - columns * (rows - 1)
    sizes = [rows if column < full else rows - 1 for column in range(columns)]
    return [handles[row * columns + column] for column, size in enumerate(sizes) for row in range(size)]


def _grey_handle() -> "Line2D":
    from matplotlib.lines import Line2D

    return Line2D([], [], label="all others", **OTHERS)


def _groups(samples: Sequence[Sample]) -> list[list[Sample]]:
    """Samples of one curiosity method together with the reference; one by one where they are too many."""
    reference = [sample for sample in samples if sample.method == REFERENCE]
    reference = reference if len(reference) == 1 else []
    others = [sample for sample in samples if sample not in reference]
    groups: dict[str, list[Sample]] = {}
    for sample in others:
        groups.setdefault(base(sample.method), []).append(sample)
    if max(map(len, groups.values())) >= OVERLAID:
        return [[*reference, sample] for sample in others]
    return [[*reference, *group] for group in groups.values()]
