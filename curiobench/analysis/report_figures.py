"""The figures of a report, as data URIs."""

import base64
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from curiobench.analysis.frames import Results

ENLARGED = 1.25
"""How much larger than on paper a figure is shown at most."""
PIXELS_A_POINT = 4 / 3

_COORDINATES = re.compile(rb'( (?:d|x|y|width|height)="|translate\()([^")]*)')
_LONG = re.compile(rb"-?\d+\.\d{2,}")
_UNSEEN = re.compile(rb'<metadata>.*?</metadata>|<!--.*?-->|\n\s*(?=\n)|(?<=<g) id="\w+_\d+"', re.DOTALL)
"""Parts of an SVG that show nothing; `id` of groups, to which nothing refers."""

CAPTIONS = MappingProxyType(
    {
        "learning-curves": "Success at evaluations over training: mean over seeds and goals, of all goals and of each "
        "layer; bands are 95 % bootstrap intervals over seeds.",
        "learned-goals": "Number of goals whose success is above 80 %, over training.",
        "exploitation": "Share of training steps at which the exploitation policy π_d acted; the rest was exploration.",
        "bonus": "Spread over a batch of what curiosity adds to the reward, τ · n(r_int); near 0 it is dead.",
        "heat-map": "Success of each goal at the last evaluation, mean over seeds.",
        "profile": "Performance profile: the share of goals and seeds whose final success is above τ. Higher is "
        "better, at every τ.",
        "comparison": "Learned goals and mean success at the last evaluation, with 95 % bootstrap intervals; small "
        "dots are seeds.",
    }
)
"""What each kind of figure shows, by the end of its file's name."""


@dataclass(frozen=True)
class Picture:
    """A figure."""

    source: str
    """Data URI."""
    caption: str
    alt: str
    width: int
    """Largest width, in pixels."""
    height: int
    """Height at that width, in pixels."""


def pictures(results: "Results", processes: int = 1) -> list[Picture]:
    """All figures of the runs; raises ValueError as `draw_figures`."""
    from curiobench.analysis.figures import draw_figures

    with tempfile.TemporaryDirectory(prefix="curiobench-report-") as folder:
        paths = draw_figures(results, Path(folder), formats=("svg",), processes=processes)
        return [_picture(path) for path in paths]


def _picture(path: Path) -> Picture:
    content = shortened(path.read_bytes())
    task, _, name = path.stem.partition("-")
    kind = re.sub(r"-\d+$", "", name)
    caption = f"{task}: {CAPTIONS.get(kind, kind.replace('-', ' '))}"
    source = f"data:image/svg+xml;base64,{base64.b64encode(content).decode()}"
    return Picture(source, caption, f"{caption} The tables of this page hold the last values.", *_size(content))


def shortened(svg: bytes) -> bytes:
    """An SVG of matplotlib's with coordinates to a tenth of a point, a third smaller; no difference can be seen."""
    return _UNSEEN.sub(b"", _COORDINATES.sub(lambda found: found[1] + _LONG.sub(_short, found[2]), svg))


def _short(number: re.Match[bytes]) -> bytes:
    return (b"%.1f" % float(number[0])).removesuffix(b".0")


def _size(svg: bytes) -> tuple[int, int]:
    width, height = (re.search(rb'<svg[^>]* %s="([\d.]+)' % side, svg) for side in (b"width", b"height"))
    return tuple(round(float(points[1]) * PIXELS_A_POINT * ENLARGED) for points in (width, height))
