"""Names and markers of methods in figures, and the theme of all figures."""

import textwrap
from collections import Counter
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

from curiobench.analysis.canvas import matplotlib_settings
from curiobench.analysis.colours import base
from curiobench.analysis.samples import Sample

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GREY = {"color": "0.82", "linewidth": 0.7, "linestyle": "-", "zorder": 1}
"""Look of lines in the background."""
TEXT_WIDTH = 6.75  # width of a figure, which is that of a page's text, in inches
TEXT, SMALL = 9, 7.5  # sizes of labels, and of ticks, legends and captions, in points

_SETTINGS = {
    "font.sans-serif": ["DejaVu Sans"],  # comes with matplotlib
    **dict.fromkeys(("font.size", "axes.labelsize", "axes.titlesize"), TEXT),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize", "legend.fontsize"), SMALL),
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), "0.15"),
    **dict.fromkeys(("axes.linewidth", "xtick.major.width", "ytick.major.width"), 1),
    **dict.fromkeys(("xtick.major.size", "ytick.major.size"), 4.8),
    "axes.axisbelow": True,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "lines.markersize": 4,
    "lines.solid_capstyle": "round",
    "patch.edgecolor": "w",
    "patch.force_edgecolor": True,
    "patch.linewidth": 0.8,
    "pdf.fonttype": 42,
    "svg.hashsalt": "curiobench",
    "text.parse_math": False,  # names of goals and options come from files
}

_MARKERS = {"sac": "o", "icm": "s", "rnd": "^", "dac": "v", "re3": "D", "mi": "P"}
_OTHER_MARKERS = ("X", "p", "<", ">", "h", "d", "*", "8", "H", "s", "^", "v", "D", "o", "P")


def styles(samples: Sequence[Sample]) -> dict[Sample, dict[str, Any]]:
    """Keywords of `Axes.plot` for each sample: its label, its method's colour and dashes, and a marker.

    The marker is the method's. If two samples would look the same, the second gets another one. Markers are filled with
    the hybrid mechanism.
    """
    found: dict[Sample, dict[str, Any]] = {}
    taken: set[tuple[str, str, str]] = set()
    named = labels(samples)
    for sample in samples:
        look = sample.look
        own = _MARKERS.get(base(sample.method))
        keys = [(look["color"], look["linestyle"], marker) for marker in ([own] if own else []) + [*_OTHER_MARKERS]]
        key = next((key for key in keys if key not in taken), keys[0])
        taken.add(key)
        filled = look["color"] if look["linestyle"] == "-" else "white"
        marker = {"marker": key[2], "markerfacecolor": filled, "markeredgewidth": 1}
        found[sample] = {"label": named[sample], **look, **marker}
    return found


def names(samples: Sequence[Sample]) -> dict[Sample, str]:
    """Name of each sample: method and variant. Methods from outside that would share a name keep their full spec."""
    known = Counter(method_name(spec) for spec in {sample.method for sample in samples})
    found = {}
    for sample in samples:
        name = method_name(sample.method)
        text = name if known[name] == 1 else sample.method
        found[sample] = text + (f", {sample.variant}" if sample.variant else "")
    return found


def labels(samples: Sequence[Sample]) -> dict[Sample, str]:
    """Name of each sample, and its number of seeds if samples differ in it."""
    differ = len({sample.n_seeds for sample in samples}) > 1
    seeds = {sample: f" ({count(sample.n_seeds, 'seed')})" if differ else "" for sample in samples}
    return {sample: name + seeds[sample] for sample, name in names(samples).items()}


def method_name(spec: str) -> str:
    """A method's name in figures: its spec, of which `package.module:Class` keeps the class."""
    return spec.rpartition(":")[2]


def count(number: int, noun: str) -> str:
    """A number of things: "1 run", "27 runs"."""
    return f"{number:,} {noun}" + "s" * (number != 1)


def seeds_in_words(samples: Sequence[Sample]) -> str:
    """Numbers of seeds: "2 seeds", "1 to 3 seeds"."""
    low, high = (end(sample.n_seeds for sample in samples) for end in (min, max))
    return count(low, "seed") if low == high else f"{low} to {count(high, 'seed')}"


def layer_in_words(layer: int) -> str:
    """A layer in words, as the paper names its panels: "two layers"; "all goals" for 0."""
    return f"{('no', 'one', 'two', 'three', 'four', 'five')[layer]} layer{'s' * (layer > 1)}" if layer else "all goals"


def theme() -> AbstractContextManager[None]:
    """The settings of all figures, while it lasts."""
    return matplotlib_settings(_SETTINGS)


def caption(figure: "Figure", text: str) -> None:
    """Write what the figure shows below it, in small grey lines."""
    lines = textwrap.fill(text, round(19 * figure.get_figwidth()))
    figure.supxlabel(lines, fontsize=SMALL - 0.5, color="0.35", x=0.01, ha="left")
