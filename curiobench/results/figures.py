"""`curiobench figure`: every figure of a set of runs, as files."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from curiobench.canvas import FORMATS, save
from curiobench.results.comparison import draw_comparison
from curiobench.results.curves import draw_exploitation, draw_learned, draw_success
from curiobench.results.heat_map import draw_heat_map
from curiobench.results.profiles import draw_profile
from curiobench.results.samples import Sample, TaskSamples, task_samples
from curiobench.results.statistics import seed_warnings
from curiobench.results.style import base, caption, method_name, seeds, theme

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from curiobench.results.frames import Results

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
    hybrid: bool = False
    """Whether only those with the hybrid mechanism have it."""

    def shows(self, sample: Sample) -> bool:
        """Whether a sample is in it."""
        known = not self.hybrid or len(sample.exploitation_epochs) > 0
        return known and (self.methods is None or sample.method in self.methods)


_LINES = "Lines: mean over {seeds}; bands: 95 % bootstrap interval over seeds"
_SUCCESS = Kind(draw_success, "Success from plain starts, mean over goals", _LINES)
_EXPLOITATION = Kind(
    draw_exploitation, "Share of training steps at which the exploitation policy π_d acted", _LINES, hybrid=True
)

KINDS = MappingProxyType(
    {
        "learning-curves": _SUCCESS,
        "learned-goals": Kind(draw_learned, "Goals with a success above 80 %", _LINES),
        "exploitation": _EXPLOITATION,
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
    results: "Results", out: Path, like: str | None = None, formats: Sequence[str] = ("pdf", "png")
) -> list[Path]:
    """Draw the figures of each task; files of the same names are replaced.

    Args:
        results: the runs. Partial ones among them are drawn up to the last evaluation that all runs of the method have.
        out: folder of the files, which is made.
        like: "paper" draws the paper's Figures 4, 6C and 7, of the methods in them that there are, each over the
            others; None draws everything of all methods.
        formats: some of `FORMATS`.

    Returns:
        The files.

    Raises:
        ValueError: nothing to draw, an unknown format or `like`, or a folder that cannot be written.
    """
    if like not in (None, "paper"):
        raise ValueError(f"like is {like!r}; it can be 'paper'")
    if unknown := sorted(set(formats) - set(FORMATS)):
        raise ValueError(f"unknown format {unknown[0]!r}; legal are {', '.join(FORMATS)}")
    chosen = [(task, *figure) for task in task_samples(results) for figure in _chosen(task, like)]
    if not chosen:
        raise ValueError(f"no run of a method in the paper's figures, such as {', '.join(PAPER['figure-4'].methods)}")
    try:
        out.mkdir(parents=True, exist_ok=True)
        with theme():
            return [
                file
                for task, name, kind, samples in chosen
                for file in _write(task, kind, samples, out / f"{task.task}-{name}", formats)
            ]
    except OSError as error:
        raise ValueError(f"cannot write to {out}: {error.strerror}") from None


def _chosen(task: TaskSamples, like: str | None) -> list[tuple[str, Kind, list[Sample]]]:
    """Name, kind and samples of each figure of a task that has samples."""
    chosen = []
    for name, kind in (PAPER if like else KINDS).items():
        if samples := [sample for sample in task.samples if kind.shows(sample)]:
            chosen.append((name, kind, samples))
    return chosen


def _write(task: TaskSamples, kind: Kind, samples: Samples, path: Path, formats: Sequence[str]) -> list[Path]:
    """Draw one kind of figure and save its pages."""
    pages = kind.draw(task, samples)
    files = []
    for number, figure in enumerate(pages, start=1):
        caption(figure, _caption(task, kind, samples))
        files += save(figure, path if len(pages) == 1 else path.with_name(f"{path.name}-{number}"), formats)
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
