"""On what scale runs were made, in words: the same in tables, captions and the report."""

import json
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

from curiobench.analysis.reading import decisive
from curiobench.config import PRESETS, flatten, preset
from curiobench.tasks.registration import EPISODE_STEPS

if TYPE_CHECKING:
    import pandas as pd

_PAPER = PRESETS["paper"]
PAPER_STEPS = _PAPER.epochs * _PAPER.cycles * _PAPER.worlds * _PAPER.rollouts * EPISODE_STEPS
"""Steps of a run of the paper."""
_TOLD_APART = ("task", "method", "seed", "robot", "preset", "epochs")
"""Options that are told by themselves, or stand in columns of their own."""
_OWN = ("method_config.", "hybrid.")
"""Before the names of options that not every method has."""


def scale_of(runs: "pd.DataFrame") -> str:
    """The scale of runs of one task, as "gripper, short preset: 20 epochs, 2.56 M steps a run".

    Options in which all of them differ from their preset are named: "laptop preset with updates=40".
    """
    robots, presets = ("/".join(sorted(set(map(str, runs[name])))) for name in ("robot", "preset"))
    changed = ", ".join(f"{name}={value}" for name, value in _changed(runs).items())
    epochs = spread(runs["epoch"], lambda number: f"{number:,.0f}")
    with_ = f" with {changed}" if changed else ""
    return f"{robots}, {presets} preset{with_}: {epochs} epochs, {spread(runs['steps'], millions)} steps a run"


def spread(values: "pd.Series", write: Callable[[float], str]) -> str:
    """A number, or the least and the largest, as text."""
    low, high = write(values.min()), write(values.max())
    return low if low == high else f"{low} to {high}"


def millions(steps: float) -> str:
    """A number of steps as text."""
    return f"{steps / 1e6:.3g} M" if steps >= 1e6 else f"{steps:,.0f}"


def hour_digits(hours: float) -> int:
    """Decimals that hours of work take: two, more for runs of a few minutes."""
    return 2 if hours >= 0.1 else 4


def _changed(runs: "pd.DataFrame") -> dict[str, Any]:
    """Options that all runs have the same value of, and another than their preset."""
    found = None
    for text in dict.fromkeys(runs["config"]):
        own = _changed_in(json.loads(text))
        found = own if found is None else {name: value for name, value in found.items() if own.get(name) == value}
    return found or {}


@cache
def _usual(name: str, task: str) -> dict[str, Any]:
    """Options of a preset for a task; none of one that is not known."""
    return flatten(preset(name, task).decisive()) if name in PRESETS else {}


def _changed_in(config: dict[str, Any]) -> dict[str, Any]:
    usual = _usual(config["preset"], config["task"])
    return {
        name: value
        for name, value in flatten(decisive(config)).items()
        if name not in _TOLD_APART and not name.startswith(_OWN) and name in usual and value != usual[name]
    }
