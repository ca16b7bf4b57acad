"""Figures of probes: curiosity along one episode of each kind, with pictures of the key moments under the axis."""

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from curiobench.analysis.canvas import new_figure, save_figure
from curiobench.cli.arguments import Among
from curiobench.probe.episodes import Played
from curiobench.probe.scores import ProbedRun, Reading, others
from curiobench.probe.steps import falling, lifting
from curiobench.tasks.rendering import WorldRenderer

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Looks = Mapping[str, Mapping[str, str]]
"""Keywords of `Axes.plot` by method spec."""
STEPS_AFTER = 10
"""Steps shown after the last key moment; the hand rests from then on. numbers.csv has all steps."""
BANDS = {"controlled lifting": (lifting, "#A8C8E8"), "falling": (falling, "#D8D8D8")}
"""Steps that are shaded, and how; lighter than any line."""
Q_NAMES = {"popart": "n_PopArt(Q_int)", "zscore": "Q_int of the z-scored reward"}
"""The two values of curiosity."""
CAPTION = (
    "{task}, {robot}; one scripted episode, plain start number {start} of seed {seed}. r_int of each step as a z-score "
    "by the run's own past rewards, clipped to ±5, at its newest checkpoint. Every step is scored by itself among "
    "{reference}. A number marks the step that has just led to its picture."
)
REFERENCES = {
    "random": "the same {others} reference transitions of random play, not among the run's replay",
    "replay": "{others} transitions drawn from the run's own replay, as in training",
}
"""What `Among` means, for captions."""


def draw_rewards(
    runs: Sequence[ProbedRun],
    readings: Sequence[Reading],
    played: Played,
    looks: Looks,
    seed: int,
    path: Path,
    among: Among,
) -> list[Path]:
    """Draw normalised rewards along the pictured episode of a kind, one line per run; returns paths of PNG and PDF."""
    start, moments = played.pictured, played.kind.moments(played.track[played.pictured])
    figure = new_figure(9, 6.2, dpi=150)
    axes, strip = figure.subplots(2, 1, height_ratios=(1.5, 1))
    for run, reading in zip(runs, readings, strict=True):
        values = reading.normalised[start]
        axes.plot(1 + np.arange(len(values)), values, label=run.label, marker=".", **looks[run.config.method])
    shade(axes, played)
    axes.set_xlabel("step", loc="right")  # out of the way of the lines to the pictures
    axes.set_ylabel("normalised intrinsic reward")
    _title(axes, played)
    _finish(axes, moments, played.qpos.shape[1] - 1)
    _legend(figure, [axes])
    first = runs[0].config
    reference = REFERENCES[among].format(others="/".join(sorted({str(others(run)) for run in runs})))
    caption = CAPTION.format(task=first.task, robot=first.robot, start=start, seed=seed, reference=reference)
    if runs[0].as_of_epoch is not None:
        caption += f" Methods get epoch {runs[0].as_of_epoch}."
    figure.supxlabel(textwrap.fill(caption, 130), fontsize=7.5, color="0.35", x=0.02, ha="left")
    figure.canvas.draw()  # fixes the layout, which the pictures' places depend on
    figure.set_layout_engine("none")
    _pictures(figure, axes, strip, played, moments)
    return save_figure(figure, path, ("png", "pdf"))


def draw_q_int(
    runs: Sequence[ProbedRun],
    readings: Sequence[Sequence[Reading]],
    played: Sequence[Played],
    looks: Looks,
    path: Path,
) -> list[Path]:
    """Draw both values of curiosity along the pictured episodes, for runs that have them.

    Args:
        runs: R of them, all with the hybrid mechanism.
        readings: R readings of each kind of episode.
        played: the kinds.
        looks: of all methods.
        path: of the files, without suffix.

    Returns:
        The PNG's and PDF's paths.
    """
    figure = new_figure(9, 5, dpi=150)
    panels = figure.subplots(len(Q_NAMES), len(played), sharex="col", sharey="row", squeeze=False)
    for column, of_kind, episodes in zip(panels.T, readings, played, strict=True):
        start = episodes.pictured
        moments = episodes.kind.moments(episodes.track[start])
        for axes, member in zip(column, Q_NAMES, strict=True):
            for run, reading in zip(runs, of_kind, strict=True):
                values = reading.q_int[member][start]
                axes.plot(1 + np.arange(len(values)), values, label=run.label, **looks[run.config.method])
            shade(axes, episodes)
            _finish(axes, moments, episodes.qpos.shape[1] - 1)
        _title(column[0], episodes)
        column[-1].set_xlabel("step")
    for axes, name in zip(panels[:, 0], Q_NAMES.values(), strict=True):
        axes.set_ylabel(name)
    _legend(figure, panels.flat)
    return save_figure(figure, path, ("png", "pdf"))


def shade(axes: "Axes", played: Played) -> None:
    """Shade the lifting and falling steps of the pictured episode."""
    track = played.track[played.pictured]
    for name, (find, colour) in BANDS.items():
        for number, step in enumerate(np.flatnonzero(find(track))):
            label = name if number == 0 else None
            axes.axvspan(step + 0.5, step + 1.5, color=colour, alpha=0.6, linewidth=0, zorder=0, label=label)


def _title(axes: "Axes", played: Played) -> None:
    axes.set_title(played.kind.title, loc="left", pad=16)


def _legend(figure: "Figure", panels: Iterable["Axes"]) -> None:
    """One legend beside all panels, in which each name stands once."""
    named = {}
    for axes in panels:
        handles, labels = axes.get_legend_handles_labels()
        named |= dict(zip(labels, handles, strict=True))
    figure.legend(named.values(), named.keys(), loc="outside right upper", frameon=False, fontsize=8)


def _finish(axes: "Axes", moments: Mapping[str, int], steps: int) -> None:
    """Number the key moments and show the part of the episode in which something happens."""
    for number, state in enumerate(moments.values(), start=1):
        axes.axvline(state, color="0.5", linewidth=0.8, linestyle=(0, (1, 2)), zorder=1)
        axes.annotate(
            str(number), (state, 1), xycoords=("data", "axes fraction"), xytext=(0, 3), textcoords="offset points",
            ha="center", fontsize=8, fontweight="bold",
        )  # fmt: skip
    axes.set_xlim(0.5, min(steps, max(moments.values(), default=steps) + STEPS_AFTER) + 0.5)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.axhline(0, color="0.75", linewidth=0.8, zorder=0)
    axes.spines[["top", "right"]].set_visible(False)


def _pictures(figure: "Figure", axes: "Axes", strip: "Axes", played: Played, moments: Mapping[str, int]) -> None:
    """Pictures of the key moments side by side in the strip, each joined to its step on the axis above."""
    from matplotlib.patches import ConnectionPatch

    below, above = axes.get_xaxis_transform(), (0.5, 1)
    strip.axis("off")
    box, count = strip.get_position(), max(1, len(moments))
    for number, (frame, (name, state)) in enumerate(zip(_render(played, moments), moments.items(), strict=True)):
        left = 0.02 + 0.96 * number / count
        place = figure.add_axes((left, box.y0, 0.94 / count, box.height))
        place.imshow(frame)
        place.set_xlabel(f"{number + 1}  {name} (step {state})", fontsize=8)
        place.set(xticks=[], yticks=[])
        line = ConnectionPatch((state, 0), above, below, place.transAxes, color="0.5", linewidth=0.8, zorder=-1)
        figure.add_artist(line)
    for label in axes.get_xticklabels():
        label.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.5})  # the lines pass behind it


def _render(played: Played, moments: Mapping[str, int]) -> list[np.ndarray]:
    with closing(WorldRenderer(played.model)) as renderer:
        return [renderer.render(played.qpos[played.pictured, state]).copy() for state in moments.values()]
