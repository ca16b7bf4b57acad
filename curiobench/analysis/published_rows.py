"""Reading a published set: the frames of `Results` as csv files."""

import json
import zlib
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pandas as pd

from curiobench.analysis.evaluations import DTYPES, bits_as_integers, check
from curiobench.analysis.folders import CONFIGS, PUBLISHED_FILES
from curiobench.analysis.published import check_sums
from curiobench.analysis.reading import LARGEST_NUMBER, PROGRESS_COLUMNS, Head, Run, check_config
from curiobench.methods.specs import shown
from curiobench.run_folder import PACKAGES

MAX_ROWS = 20_000_000
"""Rows that are read of a file at most: a compressed one may be far larger than it looks."""
_TEXT = (
    *("run", "machine", *PACKAGES, "python"),
    *("git_commit", "method_sha256", "created", "finished", "command", "config"),
)
_COUNTERS = {"epoch": np.int32, "steps": np.int64, "updates": np.int64}
_NUMBERS = ("epoch", "steps", "updates", "hours", "peak_memory_mb")


def read_published(folder: Path, every_goal: bool = True) -> list[Run]:
    """The runs of a published set.

    Args:
        folder: holds `PUBLISHED_FILES`.
        every_goal: keep all details of every evaluation; otherwise of the last.

    Raises:
        ValueError: a file is damaged or lacks a column, or the files disagree; names the folder.
    """
    try:
        return _read(folder, every_goal)
    except (ValueError, KeyError, OverflowError, EOFError, RecursionError, zlib.error) as error:
        raise ValueError(f"{folder}: {' '.join(str(error).split())}") from None
    except OSError as error:
        raise ValueError(f"{folder}: cannot read it: {error}") from None


def _read(folder: Path, every_goal: bool) -> list[Run]:
    check_sums(folder)
    runs, evaluations, progress = (folder / name for name in PUBLISHED_FILES)
    texts = dict.fromkeys(_TEXT, str)
    heads = _csv(runs, (*_TEXT, *_NUMBERS, "complete"), texts | dict.fromkeys(_NUMBERS, float) | {"complete": bool})
    rows = _csv(evaluations, ("run", *DTYPES), DTYPES | {"run": str, "goal": str, "bits": str})
    details = _csv(progress, ("run", *PROGRESS_COLUMNS), {"run": str} | _COUNTERS)
    if heads["run"].duplicated().any():
        raise ValueError("a run is in runs.csv twice")
    if odd := [name for name in heads["run"] if PurePosixPath(name).name != name]:
        raise ValueError(f"{odd[0]!r} in runs.csv is no name of a run")
    if strangers := (set(rows["run"]) | set(details["run"])) - set(heads["run"]):
        raise ValueError(f"{min(strangers)!r} has rows, but is not in runs.csv")
    rows_of, details_of = dict(list(rows.groupby("run"))), dict(list(details.groupby("run")))
    return [
        _run(folder, values, rows_of.get(values["run"]), details_of.get(values["run"]), every_goal)
        for values in heads.to_dict("records")
    ]


def _csv(path: Path, required: tuple[str, ...], dtypes: dict[str, Any]) -> pd.DataFrame:
    frame = pd.read_csv(path, dtype=dtypes, nrows=MAX_ROWS + 1, low_memory=False)
    if len(frame) > MAX_ROWS:
        raise ValueError(f"{path.name} has more than {MAX_ROWS:,} rows")
    if lacking := [name for name in required if name not in frame]:
        raise ValueError(f"{path.name} has no column {', '.join(lacking)}")
    text = [name for name in frame if dtypes.get(name) is str]
    return frame.assign(**{name: frame[name].fillna("") for name in text})


def _run(
    folder: Path, row: dict[str, Any], rows: pd.DataFrame | None, details: pd.DataFrame | None, every_goal: bool
) -> Run:
    config = check_config(json.loads(row["config"]))
    if rows is None:
        raise ValueError(f"{row['run']} has no evaluation")
    if bits_as_integers(config["task"]):
        rows = rows.assign(bits=rows["bits"].astype(np.int64))
    found = check(rows, config["task"])
    if not every_goal:
        found = replace(found, episodes=found.episodes[-1:], episodes_unsatisfied=found.episodes_unsatisfied[-1:])
    if row["complete"] and found.epoch[-1] != config["epochs"]:
        raise ValueError(f"{row['run']} has {found.epoch[-1]} of {config['epochs']} epochs and is said to be complete")
    for name in _NUMBERS:
        if not (0 <= row[name] < LARGEST_NUMBER or (np.isnan(row[name]) and not row["complete"])):
            raise ValueError(f"{name} of {row['run']} is {row[name]}, which cannot be")
    values = {name: config[name] for name in ("task", "seed", "robot", "preset", "epochs")}
    values |= {"method": shown(config["method"]), "complete": row["complete"]}
    values |= {name: row[name] for name in _TEXT if name != "run"}
    values |= {"epoch": int(found.epoch[-1]), "steps": int(found.steps[-1]), "updates": int(row["updates"])}
    values |= {"hours": row["hours"], "peak_memory_mb": row["peak_memory_mb"]}
    progress = pd.DataFrame() if details is None else _own_columns(details)
    config_file = folder / CONFIGS / f"{row['run']}.json"
    head = Head(folder / row["run"], config, values, None, config_file, row["method_sha256"])
    return Run(head, values, found.detailed(), found.layers(), progress)


def _own_columns(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of one run's progress.csv, without the columns that only other methods have."""
    given = rows.drop(columns=["task", "method", "variant", "seed", "run"], errors="ignore")
    return given.dropna(axis="columns", how="all").reset_index(drop=True)
