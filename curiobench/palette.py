"""How a method looks in every figure: one colour a curiosity method, solid with the hybrid mechanism, dashed without.

The colours are Okabe and Ito's (2008), which differ for colour-blind readers too.
"""

import zlib

from curiobench.methods.specs import canonical, split

COLOURS = {
    "sac": "#000000",
    "icm": "#E69F00",
    "rnd": "#56B4E9",
    "dac": "#CC79A7",
    "re3": "#009E73",
    "mi": "#D55E00",
}
"""Colours of the built-in methods by spec, without `+hm`."""

OTHERS = ("#0072B2", "#7F7F7F")
"""Colours of methods from outside; the name decides, so that a method keeps its colour from figure to figure."""


def line_style(spec: str) -> dict[str, str]:
    """Colour and line style of a method spec, as keywords of `Axes.plot`."""
    base, hybrid = split(canonical(spec))
    colour = COLOURS.get(base) or OTHERS[zlib.crc32(base.encode()) % len(OTHERS)]
    return {"color": colour, "linestyle": "-" if hybrid or base == "sac" else "--"}
