"""Reading a published set: the frames of `Results` as csv files, checked like those of run folders."""

import json
import zlib
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pandas as pd

from curiobench.analysis.folders import CONFIGS, PUBLISHED_FILES, check_sums
from curiobench.analysis.rows import DTYPES, IDENTITY, PROGRESS_COLUMNS, PROGRESS_DTYPES, check_evaluations
from curiobench.analysis.runs import LARGEST_NUMBER, RunData, check_config, columns_of
from curiobench.versions import PACKAGES

_TEXT = (
    *("run", "machine", *PACKAGES, "python"),
    *("git_commit", "method_sha256", "created", "finished", "command", "config"),
)
_NUMBERS = ("epoch", "steps", "updates", "hours", "peak_memory_mb")


def read_set(folder: Path, every_goal: bool) -> list[RunData]:
    """The runs of a published set, with every evaluation of each, or the last.

    Raises ValueError, which names the folder, where a file is damaged or lacks a column, or the files disagree.
    """
    try:
        return _read(folder, every_goal)
    except (ValueError, KeyError, OverflowError, EOFError, RecursionError, zlib.error) as error:
        raise ValueError(f"{folder}: {' '.join(str(error).split())}") from None
    except OSError as error:
        raise ValueError(f"{folder}: cannot read it: {error}") from None


def _read(folder: Path, every_goal: bool) -> list[RunData]:
    check_sums(folder)
    runs, evaluations, progress = (folder / name for name in PUBLISHED_FILES)
    types = dict.fromkeys(_TEXT, str) | dict.fromkeys(_NUMBERS, float) | {"complete": bool}
    heads = _csv(runs, (*_TEXT, *_NUMBERS, "complete"), types)
    rows = _csv(evaluations, ("run", *DTYPES), DTYPES | {"run": str, "goal": str})
    details = _csv(progress, ("run", *PROGRESS_COLUMNS), {"run": str} | PROGRESS_DTYPES)
    if heads["run"].duplicated().any():
        raise ValueError("a run is in runs.csv twice")
    if odd := [name for name in heads["run"] if PurePosixPath(name).name != name]:
        raise ValueError(f"runs.csv: {odd[0]!r} is not the name of a run")
    if strangers := (set(rows["run"]) | set(details["run"])) - set(heads["run"]):
        raise ValueError(f"{min(strangers)!r} has rows, but is not in runs.csv")
    rows_of, details_of = dict(list(rows.groupby("run"))), dict(list(details.groupby("run")))
    return [
        _run(folder, row, rows_of.get(row["run"]), details_of.get(row["run"], details[:0]), every_goal)
        for row in heads.to_dict("records")
    ]


def _csv(path: Path, required: tuple[str, ...], dtypes: dict[str, Any]) -> pd.DataFrame:
    names = pd.read_csv(path, nrows=0).columns
    missing = {name: [""] for name in names if dtypes.get(name) is not str}  # a run may have the name NA
    frame = pd.read_csv(path, dtype=dtypes, low_memory=False, keep_default_na=False, na_values=missing)
    if lacking := [name for name in required if name not in frame]:
        raise ValueError(f"{path.name} has no column {', '.join(lacking)}")
    return frame


def _run(
    folder: Path, row: dict[str, Any], rows: pd.DataFrame | None, details: pd.DataFrame, every_goal: bool
) -> RunData:
    """A run from its row of runs.csv, and its rows of the other two files."""
    config, name = check_config(json.loads(row["config"])), row["run"]
    if rows is None:
        raise ValueError(f"{name} has no evaluation")
    evaluations, layers = check_evaluations(rows, config["task"], every_goal)
    epoch, steps = (int(layers[column].iloc[-1]) for column in ("epoch", "steps"))
    if row["complete"] and epoch != config["epochs"]:
        raise ValueError(f"{name} has {epoch} of {config['epochs']} epochs and is said to be complete")
    for column in _NUMBERS:
        if not (0 <= row[column] < LARGEST_NUMBER or (np.isnan(row[column]) and not row["complete"])):
            legal = f"at least 0 and below {LARGEST_NUMBER:.0e}"
            raise ValueError(f"runs.csv: {column} of run {name} is {row[column]}; it must be {legal}")
    values = columns_of(config) | {column: row[column] for column in (*_TEXT[1:], *_NUMBERS, "complete")}
    values |= {"epoch": epoch, "steps": steps, "updates": int(row["updates"])}
    file = folder / CONFIGS / f"{name}.json"
    progress = details.drop(columns=list(IDENTITY), errors="ignore").dropna(axis="columns", how="all")
    progress = progress.reset_index(drop=True)
    return RunData(folder / name, config, values, file, evaluations=evaluations, layers=layers, progress=progress)
