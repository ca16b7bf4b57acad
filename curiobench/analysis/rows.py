"""Reads and checks the csv files of one run: all goals at every evaluation, and numbers within their ranges."""

import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from curiobench.files import reading
from curiobench.protocol import LEARNED_ABOVE
from curiobench.tasks.registration import task_spec

MAX_CSV_BYTES = 1 << 30
_ROUNDING = 1e-9

IDENTITY = ("run", "task", "method", "variant", "seed")  # first columns of every frame
DTYPES = {
    "epoch": np.int32,
    "steps": np.int64,
    "goal": "category",
    "bits": str,
    "layer": np.int8,
    "episodes": np.int32,
    "success": np.float64,
    "episodes_unsatisfied": np.int32,
    "success_unsatisfied": np.float64,
    "learned": np.int8,
}
"""Columns of evaluations.csv and their types."""
PROGRESS_DTYPES = {"epoch": np.int32, "steps": np.int64, "updates": np.int64}
PROGRESS_COLUMNS = (*PROGRESS_DTYPES, "seconds")  # columns that every progress.csv has; the rest depends on the method

Frames = tuple[pd.DataFrame, pd.DataFrame]
"""Rows of a run in `Results.evaluations` and `Results.layers`, without the columns that identify the run."""


def read_evaluations(path: Path, task: str, every_goal: bool, tolerant: bool) -> tuple[Frames, str]:
    """The frames of a run's evaluations.csv, and a note on what was left out ("" for nothing).

    With `every_goal` the first frame has all evaluations, otherwise the last one, which saves memory. With `tolerant`
    an incomplete last evaluation, as of a running or killed run, is left out. Raises ValueError, which names the file,
    if it is missing, damaged, or of another task.
    """
    with reading(path), _naming(path):
        content = _read_bytes(path, cut_off=tolerant)
        kept = _complete_evaluations(content) if tolerant else content
        dropped = "" if len(kept) == len(content) else f"{path}: its last evaluation is not all there, and left out"
        _check_header(kept, DTYPES)
        return check_evaluations(_parse_csv(kept, DTYPES, DTYPES), task, every_goal), dropped


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Turn an error of a damaged csv file into a ValueError, one line, that names the file."""
    try:
        yield
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from None


def _read_bytes(path: Path, cut_off: bool) -> bytes:
    """Content of a csv file. Raises ValueError if it is missing, too large or (without `cut_off`) cut off."""
    if not path.is_file():
        raise ValueError("the file is missing")
    if path.stat().st_size > MAX_CSV_BYTES:
        raise ValueError(f"the file has more than {MAX_CSV_BYTES:,} bytes")
    content = path.read_bytes()
    if not cut_off and not content.endswith(b"\n"):
        raise ValueError("the file is empty" if not content else "its last row is cut off")
    return content


def _complete_evaluations(content: bytes) -> bytes:
    """The file up to the last evaluation with as many rows as the first."""
    header, *lines = content.splitlines(keepends=True) or [b""]
    epochs = [line.partition(b",")[0] for line in lines if line.endswith(b"\n")]
    n_goals = epochs.count(epochs[0]) if epochs else 1
    return header + b"".join(lines[: len(epochs) // n_goals * n_goals])


def _check_header(content: bytes, columns: Iterable[str]) -> list[str]:
    """Columns of a csv file. Raises ValueError if one of `columns` is missing."""
    header = BytesIO(content).readline().decode().strip().split(",")
    if lacking := [name for name in columns if name not in header]:
        raise ValueError(f"it has no column {', '.join(lacking)}")
    return header


def _parse_csv(content: bytes, columns: Iterable[str], dtypes: Mapping[str, Any]) -> pd.DataFrame:
    """Read columns of a csv file that has them. Raises ValueError if a value has another type."""
    # index_col: without it a row with too many fields would shift the columns
    with warnings.catch_warnings():  # an infinite integer gives a warning and an error
        warnings.simplefilter("ignore", RuntimeWarning)
        return pd.read_csv(BytesIO(content), usecols=list(columns), dtype=dtypes, index_col=False, low_memory=False)


def check_evaluations(rows: pd.DataFrame, task: str, every_goal: bool) -> Frames:
    """The frames of one run from the rows of its evaluations.csv, with `every_goal` as for `read_evaluations`.

    Raises ValueError where a goal is missing, repeated or unknown, or a number is out of its range.
    """
    if rows.empty:
        raise ValueError("there is no evaluation yet")
    epoch, steps, layer = (rows[name].to_numpy() for name in ("epoch", "steps", "layer"))
    starts = np.flatnonzero(np.r_[True, epoch[1:] != epoch[:-1]])
    bits = _check_goals(rows["bits"].astype("category"), layer, starts, task)
    n_goals, epoch, steps = len(bits), epoch[starts], steps[starts]
    if (np.diff(epoch) <= 0).any() or epoch[0] < 0 or (np.diff(steps) < 0).any():
        raise ValueError("its epochs and steps do not rise")
    rates = [rows[name].to_numpy().reshape(-1, n_goals) for name in ("success", "success_unsatisfied", "learned")]
    _check_success(*rates)
    if not ((rows["episodes"] > 0) & rows["episodes_unsatisfied"].between(0, rows["episodes"])).all():
        raise ValueError("episodes must be above 0 and episodes_unsatisfied from 0 to episodes")
    names = _names(rows["goal"].to_numpy().reshape(-1, n_goals))
    kept = rows[list(DTYPES)].iloc[0 if every_goal else -n_goals :]
    codes = np.tile(np.arange(n_goals), len(kept) // n_goals)
    texts = {"goal": pd.Categorical.from_codes(codes, names), "bits": pd.Categorical.from_codes(codes, bits)}
    return kept.assign(**texts).reset_index(drop=True), _layers(epoch, steps, layer[:n_goals], *rates)


def _check_goals(bits: pd.Series, layer: np.ndarray, starts: np.ndarray, task: str) -> list[str]:
    """Bits of the goals. Raises ValueError unless every evaluation has each of them once, in the same order."""
    known = _goals_of(task)
    sizes = np.diff(np.r_[starts, len(bits)])
    n_goals = len(known) if known else int(sizes[0])
    if (sizes != n_goals).any():
        raise ValueError(f"an evaluation has {sizes[sizes != n_goals][0]} rows, expected {n_goals} (one per goal)")
    first = dict(zip(bits[:n_goals].astype(str), layer[:n_goals].tolist(), strict=True))
    if len(first) != n_goals or (known and first != known):
        raise ValueError(f"its goals are not those of {task}")
    for column in (bits.cat.codes.to_numpy(), layer):
        if (column.reshape(-1, n_goals) != column[:n_goals]).any():
            raise ValueError("all evaluations must have the same goals and layers, in the same order")
    return list(first)


@cache
def _goals_of(task: str) -> dict[str, int] | None:
    """Layer by the bits of a goal; None where there are too many goals to enumerate."""
    if task_spec(task).is_slow_to_enumerate:
        return None
    space = task_spec(task).goal_space
    return {space.bit_string(bits): int(layer) for bits, layer in zip(space.goals, space.layers, strict=True)}


def _check_success(success: np.ndarray, unsatisfied: np.ndarray, learned: np.ndarray) -> None:
    # a NaN fails every comparison, and only `success_unsatisfied` may be one
    if not ((success >= 0) & (success <= 1)).all():
        raise ValueError("its success is not always a number from 0 to 1")
    if ((unsatisfied < 0) | (unsatisfied > 1)).any():
        raise ValueError("its success_unsatisfied is not always a number from 0 to 1")
    sure = np.abs(success - LEARNED_ABOVE) > _ROUNDING
    if ((learned != (success > LEARNED_ABOVE)) & sure).any():
        raise ValueError(f"column learned must be 1 where success > {LEARNED_ABOVE}, else 0")


def _names(goals: np.ndarray) -> list[str]:
    """Names of the goals `(E, G)`. Raises ValueError unless they are unique and the same in all evaluations."""
    first = list(goals[0])
    texts = all(isinstance(name, str) for name in first)
    if (goals != goals[0]).any() or len(set(first)) != len(first) or not texts:
        raise ValueError("every goal needs one unique name, the same in all evaluations")
    return first


def _layers(epoch: np.ndarray, steps: np.ndarray, layer: np.ndarray, *rates: np.ndarray) -> pd.DataFrame:
    """Means over the goals of each layer, 0 for all goals together, from `(E,)`, `(G,)` and `(E, G)` arrays."""
    success, unsatisfied, learned = rates
    layers = np.unique(layer)
    member = np.column_stack([np.ones(len(layer)), *(layer == one for one in layers)])  # (G, L + 1)
    goals = member.sum(axis=0)
    known = ~np.isnan(unsatisfied)
    with np.errstate(invalid="ignore"):  # 0 / 0 gives NaN, as intended
        means = np.where(known, unsatisfied, 0) @ member / (known @ member)
    columns = {
        "epoch": np.repeat(epoch, len(goals)),
        "steps": np.repeat(steps, len(goals)),
        "layer": np.tile(np.concatenate([[0], layers]).astype(np.int8), len(epoch)),
        "goals": np.tile(goals.astype(np.int32), len(epoch)),
        "success": (success @ member / goals).ravel(),
        "success_unsatisfied": means.ravel(),
        "learned": ((learned > 0) @ member).astype(np.int32).ravel(),
    }
    return pd.DataFrame(columns, copy=False)


def read_progress(
    path: Path, wanted: bool | Collection[str], result: Mapping[str, Any] | None
) -> tuple[pd.DataFrame, str]:
    """Rows of a progress.csv, and a note on what was left out ("" for nothing).

    `wanted` is True for all columns, or names some in addition to those that every run has. Without the `result` of a
    finished run the last row may be cut off. Raises ValueError, which names the file, if it is missing, damaged, or
    disagrees with result.json.
    """
    if result is None and not path.exists():
        return pd.DataFrame(columns=list(PROGRESS_COLUMNS), dtype=np.float64), ""  # no epoch has ended yet
    with reading(path), _naming(path):
        content = _read_bytes(path, cut_off=result is None)
        kept = content[: content.rfind(b"\n") + 1]
        columns = asked(wanted, _check_header(kept, PROGRESS_COLUMNS))
        rows = _parse_csv(kept, dict.fromkeys([*PROGRESS_COLUMNS, *columns]), PROGRESS_DTYPES)
        _check_progress(rows)
        if result is not None:
            _check_end(rows, result)
    return rows, "" if len(kept) == len(content) else f"{path}: its last row is not all there, and left out"


def asked(wanted: bool | Collection[str], columns: Iterable[str]) -> list[str]:
    """The columns of a progress.csv that `wanted` names."""
    return [name for name in columns if wanted is True or name in (wanted or ())]


def _check_end(rows: pd.DataFrame, result: Mapping[str, Any]) -> None:
    """Raises ValueError where progress.csv and result.json disagree on the end of the run."""
    if len(rows) != result["epochs"]:
        raise ValueError(f"it has {len(rows)} rows for {result['epochs']} epochs")
    for name in ("steps", "updates"):
        if (last := rows[name].iloc[-1]) != result[name]:
            raise ValueError(f"its last row has {last} {name}, result.json {result[name]}")


def _check_progress(rows: pd.DataFrame) -> None:
    if rows.empty:
        raise ValueError("it has no rows")
    columns = {name: rows[name].to_numpy() for name in rows}  # numpy is faster than pandas in the checks below
    if text := [name for name, values in columns.items() if values.dtype.kind not in "biuf"]:
        raise ValueError(f"its column {text[0]} does not hold numbers")
    if (columns["epoch"] != np.arange(1, len(rows) + 1)).any():
        raise ValueError("its epochs do not count from 1")
    if not np.isfinite(columns["seconds"]).all() or (np.diff(columns["seconds"], prepend=0) < 0).any():
        raise ValueError("its seconds are not all numbers that rise from 0")
    if infinite := [name for name, values in columns.items() if np.isinf(values).any()]:
        raise ValueError(f"its column {infinite[0]} has a number that is not finite")
