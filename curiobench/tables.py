"""Tables of learned goals, from the rows of evaluations.csv."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from curiobench.run_folder import config_of, method_of, read_config, read_record, read_rows

Layers = dict[int, tuple[int, int]]
"""Learned goals and all goals, by layer."""


@dataclass(frozen=True)
class RunSummary:
    """A run at its last evaluation."""

    path: Path
    """Run folder."""
    task: str
    """Task."""
    method: str
    """Method spec."""
    seed: int
    """Seed."""
    epoch: int
    """Epochs trained before the evaluation."""
    epochs: int
    """Epochs of the whole run."""
    layers: Layers
    """Learned goals."""


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


def summarise_runs(paths: Sequence[Path]) -> tuple[list[RunSummary], list[str]]:
    """The runs in folders, and one line on each folder that cannot be summarised."""
    summaries, faults = [], []
    for path in paths:
        try:
            run = _read_head(path)
            last = last_evaluation(read_rows(path / "evaluations.csv"))
            epoch, layers = int(last[0]["epoch"]), learned_by_layer(last)
        except (ValueError, KeyError, TypeError, OSError) as error:
            faults.append(str(error) if str(path) in str(error) else f"{path}: {error}")
            continue
        summaries.append(RunSummary(path, run["task"], run["method"], run["seed"], epoch, run["epochs"], layers))
    return summaries, faults


def _read_head(path: Path) -> dict[str, Any]:
    """Task, method, seed and epochs of a run, checked. A method from outside is not imported to tell its name."""
    record = read_record(path)
    if ":" not in method_of(record):
        return read_config(path).to_json()
    checked = config_of(path, record | {"config": record["config"] | {"method": "sac", "method_config": None}})
    return checked.to_json() | {"method": method_of(record)}


def format_runs(summaries: Sequence[RunSummary]) -> str:
    """A line a run: what it is, how far it has come, learned goals of each layer and in total."""
    layers = sorted({layer for summary in summaries for layer in summary.layers})
    head = ["run", "task", "method", "seed", "epoch", *(f"layer {layer}" for layer in layers), "total"]
    lines = [
        [
            *(str(value) for value in (s.path, s.task, s.method, s.seed)),
            str(s.epoch) if s.epoch == s.epochs else f"{s.epoch} of {s.epochs}",
            *("{}/{}".format(*s.layers[layer]) if layer in s.layers else "" for layer in layers),
            "{}/{}".format(*_total(s.layers)),
        ]
        for s in summaries
    ]
    return align([head, *lines], left=3)


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
