"""The picture that training leaves in a run folder; figures of many runs are drawn by curiobench.analysis.figures."""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from curiobench.canvas import new_figure, save


def draw_learning_curve(rows: Sequence[dict[str, str]], path: Path) -> Path:
    """Draw mean success over training from the rows of evaluations.csv, a line a layer, as a PNG; returns its path."""
    curves: dict[int, dict[int, list[float]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        curves[int(row["layer"])][int(row["steps"])].append(float(row["success"]))
    figure = new_figure(6, 3.5, dpi=150)
    axes = figure.subplots()
    for layer, by_step in sorted(curves.items()):
        n_goals = len(next(iter(by_step.values())))
        label = f"layer {layer} ({n_goals} goal{'s' if n_goals > 1 else ''})"
        axes.plot(list(by_step), [sum(s) / len(s) for s in by_step.values()], label=label, marker=".")
    axes.set(xlabel="steps", ylabel="success from plain starts", ylim=(-0.02, 1.02))
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    return save(figure, path.with_suffix(""), ["png"])[0]
