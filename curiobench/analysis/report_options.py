"""In which options, versions and machines the runs of a report agree, and in which they differ."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from curiobench.analysis.report_cells import Cell, cells_of, runs_of

if TYPE_CHECKING:
    import pandas as pd

WHAT_A_RUN_IS = ("task", "method", "seed")
"""Options that tell runs apart: every table shows them."""
ENVIRONMENT = ("curiobench", "git_commit", "mujoco", "dm_control", "torch", "numpy", "python", "machine")
"""Columns of runs that are no options, but may decide numbers or costs."""
ABSENT = "–"
"""Value of an option that a run does not have."""

Names = tuple[tuple[str, tuple[str, ...]], ...]
"""Cells by name: tasks, and the methods and variants of each."""


@dataclass(frozen=True)
class Options:
    """Options of all runs of a set."""

    shared: tuple[tuple[str, str], ...]
    """Name and value of those that all runs have in common."""
    differing: tuple[str, ...]
    """Names of the others."""
    groups: tuple[tuple["Names", tuple[str, ...]], ...]
    """Cells that agree in the others, and their values."""
    settings: tuple[tuple["Names", str], ...]
    """Cells whose curiosity method has the same settings, and these."""


def options(runs: "pd.DataFrame") -> Options:
    """Options of runs, from their configs; those under `machine`, which change no number, are left out."""
    of_cell = {cell: _values(runs_of(runs, cell)) for cell in cells_of(runs)}
    names = list(dict.fromkeys(name for values in of_cell.values() for name in values))
    shared, differing = [], []
    for name in names:
        values = {values.get(name, ABSENT) for values in of_cell.values()}
        if name in ENVIRONMENT and len(values) > 1:
            values.discard(ABSENT)  # not recorded, which is no difference
        shared.append((name, values.pop())) if len(values) == 1 else differing.append(name)
    return Options(
        shared=tuple(shared),
        differing=tuple(differing),
        groups=tuple(_grouped({c: tuple(v.get(name, ABSENT) for name in differing) for c, v in of_cell.items()})),
        settings=tuple(_grouped({c: text for c in of_cell if (text := _settings(runs_of(runs, c)))})),
    )


def _values(runs: "pd.DataFrame") -> dict[str, str]:
    """Every option of the runs of a cell, and what they ran on."""
    configs = [flat(_config(text), without=(*WHAT_A_RUN_IS, "machine", "method_config")) for text in runs["config"]]
    values = {name: _together(config.get(name, ABSENT) for config in configs) for name in _option_names(configs)}
    return values | {name: _together(value for value in runs[name] if value) or ABSENT for name in ENVIRONMENT}


def _settings(runs: "pd.DataFrame") -> str:
    """Settings of the curiosity method in the runs of a cell, as "beta = 0.2, hidden = 128"."""
    configs = [flat(_config(text).get("method_config") or {}) for text in runs["config"]]
    names = _option_names(configs)
    return ", ".join(f"{name} = {_together(config.get(name, ABSENT) for config in configs)}" for name in names)


def _config(text: str) -> dict[str, Any]:
    config = json.loads(text)
    if not isinstance(config, dict):
        raise ValueError(f"a run's config is no JSON object: {text[:80]!r}")
    return config


def _option_names(configs: Iterable[Mapping[str, object]]) -> list[str]:
    return list(dict.fromkeys(name for config in configs for name in config))


def flat(config: Mapping[str, Any], prefix: str = "", without: Sequence[str] = ()) -> dict[str, str]:
    """Options by the names that the command line gives them, such as `sac.gamma`, as text."""
    found: dict[str, str] = {}
    for name, value in config.items():
        if name in without:
            continue
        if isinstance(value, dict):
            found |= flat(value, f"{prefix}{name}.")
        else:
            found[prefix + name] = str(value)
    return found


def _together(values: Iterable[object]) -> str:
    """One value, or all that differ."""
    return " / ".join(dict.fromkeys(map(str, values)))


def _grouped(values: Mapping[Cell, Any]) -> list[tuple[Names, Any]]:
    """Cells of equal values together."""
    groups: dict[Any, list[Cell]] = {}
    for cell, value in values.items():
        groups.setdefault(value, []).append(cell)
    return [(_names(cells), value) for value, cells in groups.items()]


def _names(cells: Sequence[Cell]) -> Names:
    tasks = dict.fromkeys(cell.task for cell in cells)
    return tuple((task, tuple(cell.label for cell in cells if cell.task == task)) for task in tasks)
