"""Figures as files: they need no screen, and the same data gives the same bytes. Training draws its picture by it."""

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_METADATA = {"pdf": {"CreationDate": None}, "png": {"Software": None}, "svg": {"Date": None}}
"""By format, what would change from day to day, or with the version of matplotlib, and is left out of the files."""
FORMATS = tuple(_METADATA)  # formats that a figure can be saved in


@contextmanager
def matplotlib_settings(ours: Mapping[str, Any] | None = None) -> Iterator[None]:
    """While it lasts, matplotlib has its own defaults and `ours`, whatever a matplotlibrc or the caller has set.

    It may be matplotlib's first import, which fails if MPLBACKEND names a backend that it does not know.
    """
    first, backend = "matplotlib" not in sys.modules, os.environ.pop("MPLBACKEND", None)
    import matplotlib

    if backend is not None:
        os.environ["MPLBACKEND"] = backend
        if first:
            with suppress(ValueError):
                matplotlib.rcParams["backend"] = backend
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(ours or {})
        yield


def new_figure(width: float, height: float, dpi: int = 200) -> "Figure":
    """An empty figure of a size in inches that lays itself out and needs no screen; `dpi` dots an inch as a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # a second to import
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)  # which measures text at once; the default canvas makes a new one each time
    return figure


def save_figure(figure: "Figure", path: Path, formats: Sequence[str]) -> list[Path]:
    """Save a figure as `path` with the suffix of each format; returns the files. It is not to be used afterwards."""
    paths = [path.with_name(f"{path.name}.{suffix}") for suffix in formats]
    for file, suffix in zip(paths, formats, strict=True):
        figure.savefig(file, metadata=_METADATA[suffix])
        figure.set_layout_engine("none")  # the layout of the first format serves all
    return paths


@matplotlib_settings()
def draw_learning_curve(rows: Sequence[Mapping[str, str]], path: Path) -> Path:
    """Draw mean success over training from evaluations.csv, one line per layer, as a PNG; returns its path."""
    curves: dict[int, dict[int, list[float]]] = {}
    for row in rows:
        curve = curves.setdefault(int(row["layer"]), {})
        curve.setdefault(int(row["steps"]), []).append(float(row["success"]))
    figure = new_figure(6, 3.5, dpi=150)
    axes = figure.subplots()
    for layer, by_step in sorted(curves.items()):
        n_goals = len(next(iter(by_step.values())))
        label = f"layer {layer} ({n_goals} goal{'s' if n_goals > 1 else ''})"
        axes.plot(list(by_step), [sum(s) / len(s) for s in by_step.values()], label=label, marker=".")
    axes.set(xlabel="steps", ylabel="success from plain starts", ylim=(-0.02, 1.02))
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    return save_figure(figure, path.with_suffix(""), ["png"])[0]
