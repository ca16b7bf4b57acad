"""What is drawn in matplotlib's Axes."""

from matplotlib.axes import Axes
from matplotlib.lines import Line2D


def lines(axes: Axes) -> dict[str, Line2D]:
    """Lines of an Axes by label, grey ones without."""
    return {line.get_label(): line for line in axes.lines if not line.get_label().startswith("_")}
