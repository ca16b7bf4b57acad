"""Learned goals of one evaluation, counted by layer and as text."""

from collections.abc import Mapping, Sequence
from typing import Any

Layers = dict[int, tuple[int, int]]
"""Learned goals and all goals, by layer."""


def last_evaluation(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The rows of the last evaluation, one a goal; raises ValueError where there is none."""
    if not rows:
        raise ValueError("there is no evaluation yet")
    return [row for row in rows if row["epoch"] == rows[-1]["epoch"]]


def learned_by_layer(evaluation: Sequence[Mapping[str, Any]]) -> Layers:
    """Learned goals and all goals of each layer, from one evaluation's rows."""
    layers: Layers = {}
    for row in evaluation:
        learned, goals = layers.get(int(row["layer"]), (0, 0))
        layers[int(row["layer"])] = (learned + int(row["learned"]), goals + 1)
    return layers


def format_layers(layers: Layers) -> str:
    """Learned goals of each layer and in total."""
    lines = [[str(layer), *map(str, counts)] for layer, counts in layers.items()]
    return align([["layer", "learned", "goals"], *lines, ["total", *map(str, _total(layers))]], left=1)


def format_goals(evaluation: Sequence[Mapping[str, Any]]) -> str:
    """Success of every goal, and of those of its episodes that did not start with the goal satisfied."""
    lines = [
        [
            row["goal"],
            row["bits"],
            str(row["layer"]),
            format(row["success"], ".2f"),
            "" if row["success_unsatisfied"] is None else format(row["success_unsatisfied"], ".2f"),
            "yes" if row["learned"] else "no",
        ]
        for row in evaluation
    ]
    return align([["goal", "bits", "layer", "success", "unsatisfied", "learned"], *lines], left=2)


def _total(layers: Layers) -> tuple[int, int]:
    learned, goals = zip(*layers.values(), strict=True)
    return sum(learned), sum(goals)


def align(lines: Sequence[Sequence[str]], left: int) -> str:
    """Columns side by side, the first `left` of them flush left."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(
            cell.ljust(w) if i < left else cell.rjust(w) for i, (cell, w) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    )
