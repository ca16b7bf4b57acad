"""How all figures of results look: text of 9 pt at one text width, and the same method the same everywhere."""

import textwrap
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from curiobench.methods.specs import canonical, split
from curiobench.palette import line_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from curiobench.analysis.samples import Sample

TEXT_WIDTH = 6.75
"""Width of a figure, which is that of a page's text, in inches."""
TEXT, SMALL = 9, 7.5
"""Sizes of labels, and of ticks, legends and captions, in points."""
OTHERS = {"color": "0.82", "linewidth": 0.7, "linestyle": "-", "zorder": 1}
"""Look of the lines that one line is seen against."""

_MARKERS = {"sac": "o", "icm": "s", "rnd": "^", "dac": "v", "re3": "D", "mi": "P"}
_OTHER_MARKERS = ("X", "p", "<", ">", "h", "d", "*", "8", "H", "s", "^", "v", "D", "o", "P")


def preload() -> None:
    """Import what figures need, which takes a second."""
    import matplotlib.backends.backend_agg
    import matplotlib.backends.backend_pdf  # noqa: F401
    import seaborn  # noqa: F401


@contextmanager
def theme() -> Iterator[None]:
    """Seaborn's theme for paper with our sizes, while it lasts."""
    import matplotlib
    import seaborn

    ours = {
        "font.sans-serif": ["DejaVu Sans"],  # comes with matplotlib; seaborn's Arial is not on every machine
        "font.size": TEXT,
        "axes.labelsize": TEXT,
        "axes.titlesize": TEXT,
        "xtick.labelsize": SMALL,
        "ytick.labelsize": SMALL,
        "legend.fontsize": SMALL,
        "legend.frameon": False,
        "axes.titlelocation": "left",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "lines.linewidth": 1.3,
        "lines.markersize": 4,
        "pdf.fonttype": 42,
        "svg.hashsalt": "curiobench",
        "text.parse_math": False,  # names of goals and options come from files
    }
    context = seaborn.plotting_context("paper")
    with matplotlib.rc_context({**seaborn.axes_style("ticks"), **context, **ours}):
        yield


def caption(figure: "Figure", text: str) -> None:
    """Write what the figure shows below it, in small grey lines."""
    lines = textwrap.fill(text, round(19 * figure.get_figwidth()))
    figure.supxlabel(lines, fontsize=SMALL - 0.5, color="0.35", x=0.01, ha="left")


def method_name(spec: str) -> str:
    """A method's name in figures: its spec, of which `package.module:Class` keeps the class."""
    return spec.rpartition(":")[2]


def base(spec: str) -> str:
    """The curiosity method in a spec, without the hybrid mechanism: `mi` for `mihm`."""
    return split(canonical(spec))[0]


def styles(samples: Sequence["Sample"]) -> dict["Sample", dict[str, Any]]:
    """Keywords of `Axes.plot` for each sample: its method's colour and dashes, and a marker.

    The marker is the method's; where two samples would look the same, the later one gets another. It is filled with
    the hybrid mechanism.
    """
    found: dict[Sample, dict[str, Any]] = {}
    taken: set[tuple[str, str, str]] = set()
    for sample in samples:
        look = line_style(sample.method)
        own = _MARKERS.get(base(sample.method))
        candidates = [own, *_OTHER_MARKERS] if own else _OTHER_MARKERS
        keys = [(look["color"], look["linestyle"], marker) for marker in candidates]
        key = next((key for key in keys if key not in taken), keys[0])
        taken.add(key)
        filled = look["color"] if look["linestyle"] == "-" else "white"
        found[sample] = {**look, "marker": key[2], "markerfacecolor": filled, "markeredgewidth": 1}
    return found


def labels(samples: Sequence["Sample"]) -> dict["Sample", str]:
    """What to call each sample: the method, the variant, and the number of seeds where samples differ in it.

    Methods from outside that would share a name keep their whole spec.
    """
    specs = {sample.method for sample in samples}
    known = Counter(method_name(spec) for spec in specs)
    sizes = {sample.n_seeds for sample in samples}
    found = {}
    for sample in samples:
        name = method_name(sample.method)
        text = name if known[name] == 1 else sample.method
        text += f", {sample.variant}" if sample.variant else ""
        found[sample] = text if len(sizes) == 1 else f"{text} ({seeds(sample.n_seeds)})"
    return found


def seeds(count: int) -> str:
    """A number of seeds in words: "1 seed", "3 seeds"."""
    return f"{count} seed" + "s" * (count != 1)
