"""`curiobench figure`: draws the figures of a set of runs to files."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from curiobench.analysis.canvas import FORMATS, save_figure
from curiobench.analysis.colours import base
from curiobench.analysis.comparison import draw_comparison, draw_heat_map
from curiobench.analysis.frames import Results
from curiobench.analysis.lines import Axis, Panel, draw_lines
from curiobench.analysis.paper import ABLATIONS, CURIOUS
from curiobench.analysis.samples import Sample, TaskSamples, task_samples
from curiobench.analysis.statistics import performance_profile, seed_warnings
from curiobench.analysis.style import caption, layer_in_words, method_name, seeds_in_words, theme
from curiobench.files import writing_to
from curiobench.workers import no_collection, parallel_map

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Samples = Sequence[Sample]
MOST_POINTS = 150  # points that are drawn of one curve, evenly spread: a panel is no more than a few hundred dots wide
THRESHOLDS = np.linspace(0, 1, 101)  # τ of a profile, success from 0 to 1


def draw_success(task: TaskSamples, samples: Samples) -> list["Figure"]:
    """Mean success over epochs: all goals, then the goals of each layer."""
    panels = [
        Panel(f"{layer_in_words(layer)} ({size})", lambda s, place=place: thinned(s.epochs, s.success[..., place]))
        for place, (layer, size) in enumerate(task.sizes.items())
    ]
    return draw_lines(samples, panels, _epochs(task, "success"))


def draw_learned(task: TaskSamples, samples: Samples) -> list["Figure"]:
    """Learned goals over epochs."""
    panel = Panel("", lambda sample: thinned(sample.epochs, sample.learned[..., 0]), task.sizes[0])
    return draw_lines(samples, [panel], _epochs(task, f"learned goals, of {task.sizes[0]}"))


def draw_profile(task: TaskSamples, samples: Samples) -> list["Figure"]:
    """Share of goals and seeds with a final success above τ, over τ; a seed's goals are resampled together."""

    def profile(sample: Sample) -> tuple[np.ndarray, np.ndarray]:
        return THRESHOLDS, np.stack([performance_profile(seed[None], THRESHOLDS) for seed in sample.goal_success])

    return draw_lines(samples, [Panel("", profile)], Axis("final success τ", "share above τ", integers=False))


def _draw_logged(task: TaskSamples, samples: Samples, column: str, name: str) -> list["Figure"]:
    """A column of progress.csv over epochs, on an axis that ends at 1 or above its largest value."""
    highest = max(sample.logged[column][1].max() for sample in samples)
    panel = Panel("", lambda sample: thinned(*sample.logged[column]), max(1.0, float(np.ceil(highest))))
    return draw_lines(samples, [panel], _epochs(task, name))


draw_exploitation = partial(_draw_logged, column="share_exploitation", name=r"share of $\pi_d$")
draw_bonus = partial(_draw_logged, column="bonus_spread", name=r"spread of $\tau \cdot n(r_{int})$")


def thinned(epochs: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At most `MOST_POINTS` of the epochs (E,) and values (S, E), evenly spaced, with the first and the last."""
    kept = np.unique(np.linspace(0, len(epochs) - 1, min(len(epochs), MOST_POINTS)).round().astype(int))
    return epochs[kept], values[:, kept]


def _epochs(task: TaskSamples, y: str) -> Axis:
    """An x axis of epochs, with environment steps if all runs have the same number per epoch."""
    if task.steps_per_epoch is None:
        return Axis("epoch", y)

    def tick(epoch: float) -> str:
        millions = epoch * task.steps_per_epoch / 1e6
        return f"{epoch:.0f}\n({millions:{'.3g' if millions < 100 else '.0f'}})"

    return Axis("epoch (million steps)", y, tick)


@dataclass(frozen=True)
class FigureKind:
    """A figure that each task gets."""

    draw: Callable[[TaskSamples, Samples], list["Figure"]]
    caption: str  # what it shows
    seeds: str = "Lines: mean over {seeds}; bands: 95 % bootstrap interval over seeds"
    """The sentence on seeds, if there are several."""
    methods: tuple[str, ...] | None = None  # methods in it; None for all
    column: str | None = None  # column of progress.csv that it draws; only methods that have it are in it

    def shows(self, sample: Sample) -> bool:
        """Whether a sample is in it."""
        known = self.column is None or len(sample.logged[self.column][0]) > 0
        return known and (self.methods is None or sample.method in self.methods)


FIGURES = {
    "learning-curves": FigureKind(draw_success, "Success from plain starts, mean over goals"),
    "learned-goals": FigureKind(draw_learned, "Goals with a success above 80 %"),
    "exploitation": FigureKind(
        draw_exploitation,
        "Share of training steps at which the exploitation policy π_d acted; the rest was exploration",
        column="share_exploitation",
    ),
    "bonus": FigureKind(
        draw_bonus,
        "Spread of the intrinsic reward τ · n(r_int): its standard deviation over a batch; near 0 it has no effect",
        column="bonus_spread",
    ),
    "heat-map": FigureKind(draw_heat_map, "Success of each goal at the last evaluation", "Mean over {seeds}"),
    "profile": FigureKind(
        draw_profile,
        "Performance profile: share of goals and seeds whose final success is above τ; higher is better",
    ),
    "comparison": FigureKind(
        draw_comparison,
        "Learned goals and success at the last evaluation, and over training; dotted: before training",
        "Large dots: mean over {seeds} and its 95 % bootstrap interval; small dots: each seed",
    ),
}
"""Figures of all methods, by the ends of the files' names."""

PAPER = {
    "figure-4": replace(FIGURES["learning-curves"], methods=CURIOUS),
    "figure-6c": FIGURES["exploitation"],
    "figure-7": replace(FIGURES["learning-curves"], methods=ABLATIONS),
}
"""Figures of the paper, and the methods in them."""


def draw_figures(
    results: Results, out: Path, like: str | None = None, formats: Sequence[str] = ("pdf", "png"), processes: int = 1
) -> list[Path]:
    """Draw the figures of each task; files of the same names are replaced.

    Args:
        results: the runs. Partial ones are drawn up to the last evaluation that all runs of the method have.
        out: folder of the files; created if it does not exist.
        like: "paper" draws the paper's Figures 4, 6C and 7 with their methods; None draws all figures of all methods.
        formats: some of `FORMATS`.
        processes: number of processes that draw, if the system can fork; the files do not depend on it.

    Returns the files. Raises ValueError if there is nothing to draw, `formats` or `like` is unknown, or writing fails.
    """
    if like not in (None, "paper"):
        raise ValueError(f"like is {like!r}; it can be 'paper'")
    if unknown := sorted(set(formats) - set(FORMATS)):
        raise ValueError(f"unknown format {unknown[0]!r}; it must be one of {', '.join(FORMATS)}")
    chosen = []
    for task in task_samples(results):
        for name, kind in (PAPER if like else FIGURES).items():
            if samples := [sample for sample in task.samples if kind.shows(sample)]:
                chosen.append((f"{task.task}-{name}", kind, task, samples))
    if not chosen:
        raise ValueError(f"no run of a method in the paper's figures, such as {', '.join(CURIOUS)}")
    with writing_to(out), theme():
        out.mkdir(parents=True, exist_ok=True)
        files = parallel_map(partial(_write, out=out, formats=formats), chosen, processes)
    return [file for of_one in files for file in of_one]


@no_collection()
def _write(chosen: tuple[str, FigureKind, TaskSamples, Samples], out: Path, formats: Sequence[str]) -> list[Path]:
    """Draw one figure, given the name of its files, its kind, its task and the samples in it, and save its pages."""
    name, kind, task, samples = chosen
    pages = kind.draw(task, samples)
    files = []
    for number, figure in enumerate(pages, start=1):
        caption(figure, _caption(task, kind, samples))
        files += save_figure(figure, out / (name if len(pages) == 1 else f"{name}-{number}"), formats)
    return files


def _caption(task: TaskSamples, kind: FigureKind, samples: Samples) -> str:
    """The caption: what is drawn, the scale of the runs, seeds, and full specs of methods named by their class."""
    several = max(sample.n_seeds for sample in samples) > 1
    about = f"{task.task}, {task.scale}"
    if partial_runs := (~task.runs["complete"]).sum():
        about += f"; {partial_runs} of {len(task.runs)} runs are partial, and curves end where a run of the method does"
    parts = [
        f"{kind.caption}; {about}",
        kind.seeds.format(seeds=seeds_in_words(samples)) if several else "1 seed, no interval",
    ]
    if several:
        parts += seed_warnings([(method_name(sample.method), sample.n_seeds) for sample in samples])
    names = {base(sample.method) for sample in samples if ":" in sample.method}
    parts += [f"{method_name(name)} is {name}" for name in sorted(names) if method_name(name) != name]
    return ". ".join(parts) + "."
