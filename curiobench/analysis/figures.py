"""`curiobench figure`: every figure of a set of runs, as files."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from curiobench.analysis.comparison import draw_comparison
from curiobench.analysis.curves import draw_bonus, draw_exploitation, draw_learned, draw_success
from curiobench.analysis.heat_map import draw_heat_map
from curiobench.analysis.profiles import draw_profile
from curiobench.analysis.samples import Sample, TaskSamples, task_samples
from curiobench.analysis.statistics import seed_warnings
from curiobench.analysis.style import base, caption, method_name, seeds, theme
from curiobench.canvas import FORMATS, save
from curiobench.workers import no_collection, parallel_map

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from curiobench.analysis.frames import Results

Samples = Sequence[Sample]


@dataclass(frozen=True)
class Kind:
    """A figure that each task gets."""

    draw: Callable[[TaskSamples, Samples], list["Figure"]]
    caption: str
    seeds: str
    """How the seeds are in it, where there are several."""
    methods: tuple[str, ...] | None = None
    """Methods in it; None for all."""
    column: str | None = None
    """Column of progress.csv that it draws; only methods that have it are in it."""

    def shows(self, sample: Sample) -> bool:
        """Whether a sample is in it."""
        known = self.column is None or len(sample.logged[self.column][0]) > 0
        return known and (self.methods is None or sample.method in self.methods)


_LINES = "Lines: mean over {seeds}; bands: 95 % bootstrap interval over seeds"
_SUCCESS = Kind(draw_success, "Success from plain starts, mean over goals", _LINES)
_EXPLOITATION = Kind(
    draw_exploitation,
    "Share of training steps at which the exploitation policy π_d acted",
    _LINES,
    column="share_exploitation",
)

KINDS = MappingProxyType(
    {
        "learning-curves": _SUCCESS,
        "learned-goals": Kind(draw_learned, "Goals with a success above 80 %", _LINES),
        "exploitation": _EXPLOITATION,
        "bonus": Kind(
            draw_bonus,
            "Standard deviation of τ · n(r_int) over a batch; near 0 it is dead",
            _LINES,
            column="bonus_spread",
        ),
        "heat-map": Kind(draw_heat_map, "Success of each goal at the last evaluation", "Mean over {seeds}"),
        "profile": Kind(draw_profile, "Share of goals and seeds that end above a success of τ", _LINES),
        "comparison": Kind(
            draw_comparison,
            "The last evaluation, and success averaged over training; dotted: success before training",
            "Large: mean over {seeds} and its 95 % bootstrap interval; small: each seed",
        ),
    }
)
"""Figures of all methods, by the ends of the files' names."""

PAPER = MappingProxyType(
    {
        "figure-4": replace(_SUCCESS, methods=("sac", "icm", "rnd", "dac", "re3", "mihm")),
        "figure-6c": _EXPLOITATION,
        "figure-7": replace(_SUCCESS, methods=("icm+hm", "rnd+hm", "mi", "mihm")),
    }
)
"""Figures of the paper, and the methods in them."""


def draw_figures(
    results: "Results",
    out: Path,
    like: str | None = None,
    formats: Sequence[str] = ("pdf", "png"),
    processes: int = 1,
) -> list[Path]:
    """Draw the figures of each task; files of the same names are replaced.

    Args:
        results: the runs. Partial ones among them are drawn up to the last evaluation that all runs of the method have.
        out: folder of the files, which is made.
        like: "paper" draws the paper's Figures 4, 6C and 7, of the methods in them that there are, each over the
            others; None draws everything of all methods.
        formats: some of `FORMATS`.
        processes: how many draw side by side, where the system can fork; the files do not depend on it.

    Returns:
        The files.

    Raises:
        ValueError: nothing to draw, an unknown format or `like`, or a folder that cannot be written.
    """
    if like not in (None, "paper"):
        raise ValueError(f"like is {like!r}; it can be 'paper'")
    if unknown := sorted(set(formats) - set(FORMATS)):
        raise ValueError(f"unknown format {unknown[0]!r}; legal are {', '.join(FORMATS)}")
    chosen = [figure for task in task_samples(results) for figure in _chosen(task, like)]
    if not chosen:
        raise ValueError(f"no run of a method in the paper's figures, such as {', '.join(PAPER['figure-4'].methods)}")
    try:
        out.mkdir(parents=True, exist_ok=True)
        with theme():
            files = parallel_map(partial(_write, out=out, formats=formats), chosen, processes)
    except OSError as error:
        raise ValueError(f"cannot write to {out}: {error.strerror}") from None
    return [file for of_one in files for file in of_one]


@dataclass(frozen=True)
class _Chosen:
    """A figure that is to be drawn."""

    name: str
    """Of its files, without page and suffix."""
    kind: Kind
    """How it is drawn."""
    task: TaskSamples
    """All samples of its task."""
    samples: Samples
    """Those in it."""


def _chosen(task: TaskSamples, like: str | None) -> list[_Chosen]:
    """The figures of a task that have samples."""
    chosen = []
    for name, kind in (PAPER if like else KINDS).items():
        if samples := [sample for sample in task.samples if kind.shows(sample)]:
            chosen.append(_Chosen(f"{task.task}-{name}", kind, task, samples))
    return chosen


@no_collection()
def _write(chosen: _Chosen, out: Path, formats: Sequence[str]) -> list[Path]:
    """Draw one figure and save its pages."""
    pages = chosen.kind.draw(chosen.task, chosen.samples)
    files = []
    for number, figure in enumerate(pages, start=1):
        caption(figure, _caption(chosen.task, chosen.kind, chosen.samples))
        page = chosen.name if len(pages) == 1 else f"{chosen.name}-{number}"
        files += save(figure, out / page, formats)
    return files


def _caption(task: TaskSamples, kind: Kind, samples: Samples) -> str:
    """What is drawn, of which runs, how many they are, and the whole specs of methods whose class stands for them."""
    counts = sorted({sample.n_seeds for sample in samples})
    number = seeds(counts[0]) if len(counts) == 1 else f"{counts[0]} to {seeds(counts[-1])}"
    shown = kind.seeds.format(seeds=number) if counts[-1] > 1 else "1 seed, no interval"
    parts = [f"{kind.caption}; {task.about}", shown]
    if counts[-1] > 1:
        parts += seed_warnings([(method_name(sample.method), sample.n_seeds) for sample in samples])
    names = {base(sample.method) for sample in samples if ":" in sample.method}
    parts += [f"{method_name(name)} is {name}" for name in sorted(names) if method_name(name) != name]
    return ". ".join(parts) + "."
