"""Colours and line styles of methods.

A curiosity method has one colour, solid with the hybrid mechanism, dashed without. The colours are Okabe and Ito's
(2008), which differ for colour-blind readers too; methods beyond the paper's have Paul Tol's.
"""

import zlib
from collections.abc import Collection, Iterable

from curiobench.methods.specs import BUILT_IN, canonical, split

_PALETTE = (
    *("#000000", "#E69F00", "#56B4E9", "#CC79A7", "#009E73", "#D55E00"),
    *("#332288", "#882255", "#44AA99", "#999933", "#AA4499", "#6699CC", "#997700"),
    *("#DDCC77", "#EE99AA", "#117733", "#004488", "#994455"),
)
COLOURS = dict(zip(("sac", *BUILT_IN), _PALETTE, strict=False))
"""Colours of the built-in methods by spec, without `+hm`; beyond the palette they are chosen as for other methods."""
OUTSIDE = (
    *("#0072B2", "#0000FF", "#00C300", "#FF0FFF", "#FF005A", "#965AFF"),
    *("#3C4B1E", "#E19678", "#782D0F", "#FF00A5", "#0F7800", "#A596FF"),
)
"""Colours of methods that are not built in, far from those above and from each other."""


def line_styles(specs: Iterable[str]) -> dict[str, dict[str, str]]:
    """Colour and line style of each method spec among all that are shown together, as keywords of `Axes.plot`."""
    specs = set(specs)
    colours = COLOURS | _outside_colours({base(spec) for spec in specs} - COLOURS.keys())
    return {
        spec: {"color": colours[name], "linestyle": "-" if hybrid or name == "sac" else "--"}
        for spec in specs
        for name, hybrid in [split(canonical(spec))]
    }


def _outside_colours(names: Collection[str]) -> dict[str, str]:
    """Colours by a hash of the name, so that all figures use the same; the next one if a colour is taken."""
    found: dict[str, str] = {}
    for name in sorted(names):
        first = zlib.crc32(name.encode()) % len(OUTSIDE)
        order = OUTSIDE[first:] + OUTSIDE[:first]
        found[name] = next((colour for colour in order if colour not in found.values()), order[0])
    return found


def base(spec: str) -> str:
    """The curiosity method in a spec, without the hybrid mechanism: `mi` for `mihm`."""
    return split(canonical(spec))[0]
