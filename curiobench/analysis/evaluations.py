"""Evaluations of one run as arrays, checked: every goal of the task at every evaluation, and only possible numbers."""

import csv
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd

from curiobench.protocol import LEARNED_ABOVE
from curiobench.tasks.goals import goal_space
from curiobench.tasks.registration import n_blocks_of

MAX_CSV_BYTES = 1 << 30
LARGEST_LISTED_TASK = 4
"""Blocks of the largest task whose valid goals are looked up; enumerating those of five blocks takes ten seconds."""
_ROUNDING = 1e-9
_LONGEST_INTEGER = 18
"""Digits of a bit string that still is an integer of 64 bits."""

DTYPES = {
    "epoch": np.int32,
    "steps": np.int64,
    "goal": "category",
    "bits": "category",
    "layer": np.int8,
    "episodes": np.int32,
    "success": np.float64,
    "episodes_unsatisfied": np.int32,
    "success_unsatisfied": np.float64,
    "learned": np.int8,
}
"""Columns of evaluations.csv and what they hold."""
CURVE_COLUMNS = ("epoch", "steps", "bits", "layer", "success", "success_unsatisfied", "learned")
"""What is needed of an evaluation that is not the last."""
_DETAILS = {"goal": str, "bits": str, "episodes": np.int32, "episodes_unsatisfied": np.int32}
"""What is needed of the last one only, and as what it is read."""


@dataclass(frozen=True)
class Evaluations:
    """E evaluations of the G goals of a task by one run, with all details for the last K of them."""

    epoch: np.ndarray
    """`(E,)` int32 epochs completed, rising."""
    steps: np.ndarray
    """`(E,)` int64 training steps."""
    goal: tuple[str, ...]
    """`(G,)` names."""
    bits: tuple[str, ...]
    """`(G,)` predicates."""
    layer: np.ndarray
    """`(G,)` int8."""
    success: np.ndarray
    """`(E, G)` share of successful test episodes."""
    success_unsatisfied: np.ndarray
    """`(E, G)` the same among those whose goal did not hold at the start; NaN where it held in all."""
    learned: np.ndarray
    """`(E, G)` bool."""
    episodes: np.ndarray
    """`(K, G)` test episodes."""
    episodes_unsatisfied: np.ndarray
    """`(K, G)` … whose goal did not hold at the start."""

    def detailed(self) -> "Evaluations":
        """The last K of them; the others take no more memory."""
        known = len(self.episodes)
        if known == len(self.epoch):
            return self
        names = ("epoch", "steps", "success", "success_unsatisfied", "learned")
        return replace(self, **{name: getattr(self, name)[-known:].copy() for name in names})

    def layers(self) -> dict[str, np.ndarray]:
        """Columns of the frame `layers`, `(E × (L + 1),)` each: every evaluation's layers, 0 for all goals together."""
        kinds = np.unique(self.layer)
        member = np.column_stack([np.ones(len(self.layer)), *(self.layer == kind for kind in kinds)])  # (G, L + 1)
        goals = member.sum(axis=0)
        seen = ~np.isnan(self.success_unsatisfied)
        with np.errstate(invalid="ignore"):  # 0 / 0 is the NaN that is meant
            unsatisfied = np.where(seen, self.success_unsatisfied, 0) @ member / (seen @ member)
        n = len(self.epoch)
        return {
            "epoch": np.repeat(self.epoch, len(goals)),
            "steps": np.repeat(self.steps, len(goals)),
            "layer": np.tile(np.concatenate([[0], kinds]).astype(np.int8), n),
            "goals": np.tile(goals.astype(np.int32), n),
            "success": (self.success @ member / goals).ravel(),
            "success_unsatisfied": unsatisfied.ravel(),
            "learned": (self.learned @ member).astype(np.int32).ravel(),
        }


def read_evaluations(path: Path, task: str, every_goal: bool = True, tolerant: bool = False) -> tuple[Evaluations, str]:
    """Evaluations of a run.

    Args:
        path: of evaluations.csv.
        task: of the run.
        every_goal: read all details of every evaluation; otherwise of the last, which takes half the time.
        tolerant: leave out an evaluation at the end that is not all there, as a run at work or killed may have one.

    Returns:
        The evaluations, and what was left out ("" for nothing).

    Raises:
        ValueError: the file is missing, damaged, or not of this task; names the file.
    """
    with naming(path):
        content = read_bytes(path, whole=not tolerant)
        whole = _whole_evaluations(content) if tolerant else content
        dropped = "" if len(whole) == len(content) else f"{path}: its last evaluation is not all there, and left out"
        return _parse(whole, task, every_goal), dropped


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Turns whatever a damaged csv file raises into one line, as a ValueError that names the file."""
    try:
        yield
    except (ValueError, TypeError, OverflowError, csv.Error) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from None
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror}") from None


def read_bytes(path: Path, whole: bool) -> bytes:
    """A csv file of a run.

    Raises ValueError where it is missing, no regular one, too large to be a run's, or should be `whole` and ends
    within a row.
    """
    if not path.is_file():
        raise ValueError("the file is missing")
    if path.stat().st_size > MAX_CSV_BYTES:
        raise ValueError(f"the file has more than {MAX_CSV_BYTES:,} bytes")
    content = path.read_bytes()
    if whole and not content.endswith(b"\n"):
        raise ValueError("the file is empty" if not content else "its last row is cut off")
    return content


def _whole_evaluations(content: bytes) -> bytes:
    """The file up to the last evaluation that has as many rows as the first."""
    header, *lines = content.splitlines(keepends=True) or [b""]
    epochs = [line.partition(b",")[0] for line in lines if line.endswith(b"\n")]
    n_goals = epochs.count(epochs[0]) if epochs else 1
    return header + b"".join(lines[: len(epochs) // n_goals * n_goals])


def _parse(content: bytes, task: str, every_goal: bool) -> Evaluations:
    dtypes = DTYPES | ({"bits": np.int64} if bits_as_integers(task) else {})
    check_header(content, tuple(DTYPES))
    if every_goal:
        return check(parse_csv(content, tuple(DTYPES), dtypes), task)
    frame = parse_csv(content, CURVE_COLUMNS, dtypes)
    epoch = frame["epoch"].to_numpy()
    return check(frame, task, _last_rows(content, int((epoch == epoch[-1:]).sum())))


def bits_as_integers(task: str) -> bool:
    """Whether bit strings of a task are read as decimal numbers: that is faster, but they must fit into 64 bits."""
    return _n_bits(task) <= _LONGEST_INTEGER


def _n_bits(task: str) -> int:
    return 3 * n_blocks_of(task) * (n_blocks_of(task) - 1) // 2


def _last_rows(content: bytes, n_rows: int) -> dict[str, np.ndarray]:
    """The last rows of a csv file, by column, as far as `check` wants more than `CURVE_COLUMNS` of them."""
    start = len(content) - 1
    for _ in range(n_rows):
        start = content.rindex(b"\n", 0, start)
    text = content[: content.index(b"\n")] + content[start:]
    rows = list(csv.DictReader(text.decode().splitlines()))
    return {name: np.array([row[name] for row in rows]).astype(kind) for name, kind in _DETAILS.items()}


def check_header(content: bytes, columns: Iterable[str]) -> list[str]:
    """Names of the columns of a csv file; raises ValueError where it lacks one."""
    header = BytesIO(content).readline().decode().strip().split(",")
    if lacking := [name for name in columns if name not in header]:
        raise ValueError(f"it has no column {', '.join(lacking)}")
    return header


def parse_csv(content: bytes, columns: Iterable[str], dtypes: Mapping[str, object]) -> pd.DataFrame:
    """Columns of a csv file, all of which it has; raises ValueError where a value is of another kind."""
    types = {name: dtypes[name] for name in columns if name in dtypes}
    # index_col: without it a row with too many fields would shift the columns
    with warnings.catch_warnings():  # of an infinite whole number, which is an error as well
        warnings.simplefilter("ignore", RuntimeWarning)
        return pd.read_csv(BytesIO(content), usecols=list(columns), dtype=types, index_col=False, low_memory=False)


def check(frame: pd.DataFrame, task: str, last: Mapping[str, np.ndarray] | None = None) -> Evaluations:
    """Evaluations from the rows of evaluations.csv.

    Args:
        frame: all rows, with `CURVE_COLUMNS` or more.
        task: of the run.
        last: goals, bits and episodes of the last evaluation, where `frame` has not got these columns.

    Raises:
        ValueError: a goal is missing, there twice, or foreign, or a number cannot be.
    """
    if not len(frame):
        raise ValueError("there is no evaluation yet")
    details = {name: frame[name].to_numpy() for name in _DETAILS} if last is None else last
    column = {name: frame[name].to_numpy() for name in CURVE_COLUMNS}
    epoch, steps, layer = column["epoch"], column["steps"], column["layer"]
    starts = np.flatnonzero(np.r_[True, epoch[1:] != epoch[:-1]])
    n_goals = _check_goals(column["bits"], layer, starts, task)
    if (np.diff(epoch[starts]) <= 0).any() or epoch[0] < 0 or (np.diff(steps[starts]) < 0).any():
        raise ValueError("its epochs and steps do not rise")
    rates = [column[name].reshape(-1, n_goals) for name in ("success", "success_unsatisfied", "learned")]
    _check_success(*rates)
    episodes, unsatisfied = (details[name].reshape(-1, n_goals) for name in ("episodes", "episodes_unsatisfied"))
    if not ((episodes > 0) & (unsatisfied >= 0) & (unsatisfied <= episodes)).all():
        raise ValueError("its numbers of episodes cannot be")
    goal, bits = _names(details["goal"], details["bits"], n_goals, task)
    success, success_unsatisfied, learned = rates
    arrays = (layer[:n_goals].copy(), success, success_unsatisfied, learned > 0, episodes, unsatisfied)
    return Evaluations(epoch[starts], steps[starts], goal, bits, *arrays)


def _check_goals(bits: np.ndarray, layer: np.ndarray, starts: np.ndarray, task: str) -> int:
    """Number of goals; raises ValueError where an evaluation does not hold each of them once, in one order."""
    known = _goals_of(task)
    sizes = np.diff(np.r_[starts, len(bits)])
    n_goals = len(known) if known else int(sizes[0])
    if (sizes != n_goals).any():
        raise ValueError(f"an evaluation has {sizes[sizes != n_goals][0]} rows; it takes {n_goals}, one a goal")
    first = dict(zip(bits[:n_goals].tolist(), layer[:n_goals].tolist(), strict=True))
    if len(first) != n_goals or (known and first != known):
        raise ValueError(f"its goals are not those of {task}")
    for column in (bits, layer):
        if (column.reshape(-1, n_goals) != column[:n_goals]).any():
            raise ValueError("its evaluations differ in their goals")
    return n_goals


@cache
def _goals_of(task: str) -> dict[int, int] | None:
    """Layer by goal, whose bits are read as a decimal number; None where there are too many goals to list."""
    if n_blocks_of(task) > LARGEST_LISTED_TASK:
        return None
    space = goal_space(n_blocks_of(task))
    return {int(space.bit_string(bits)): int(layer) for bits, layer in zip(space.goals, space.layers, strict=True)}


def _check_success(success: np.ndarray, unsatisfied: np.ndarray, learned: np.ndarray) -> None:
    # a NaN fails every comparison, and only `success_unsatisfied` may be one
    if not ((success >= 0) & (success <= 1)).all():
        raise ValueError("its success is not always a number from 0 to 1")
    if ((unsatisfied < 0) | (unsatisfied > 1)).any():
        raise ValueError("its success_unsatisfied is not always a number from 0 to 1")
    sure = np.abs(success - LEARNED_ABOVE) > _ROUNDING
    if ((learned != (success > LEARNED_ABOVE)) & sure).any():
        raise ValueError(f"its learned is not 1 where success is above {LEARNED_ABOVE} and 0 elsewhere")


def _names(goal: np.ndarray, bits: np.ndarray, n_goals: int, task: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and bit strings of the goals; raises ValueError where a goal changes its name."""
    goals = goal.reshape(-1, n_goals)
    if (
        (goals != goals[0]).any()
        or len(set(goals[0])) != n_goals
        or not all(isinstance(name, str) for name in goals[0])
    ):
        raise ValueError("its goals do not have one name each")
    return tuple(map(str, goals[0])), tuple(str(text).zfill(_n_bits(task)) for text in bits[:n_goals])
