"""One run folder: its config, its rows and its result, checked. Files of others are never trusted."""

import csv
import json
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from curiobench.analysis.evaluations import Evaluations, check_header, naming, parse_csv, read_bytes, read_evaluations
from curiobench.config import CONFIG_VERSION, LARGEST_SEED, with_later_fields
from curiobench.files import read_json
from curiobench.methods.specs import HYBRID, canonical, shown
from curiobench.run_folder import PACKAGES, read_record
from curiobench.tasks.registration import ROBOTS, TASKS, check_name

MAX_JSON_BYTES = 1 << 20
LARGEST_NUMBER = 1e15
"""Of steps, updates, seconds and the like; more cannot be."""
PROGRESS_COLUMNS = ("epoch", "steps", "updates", "seconds")
"""Columns that every progress.csv has; the rest depends on the method."""
_SPEC = re.compile(r"[\w.-]{1,100}(:[\w.]{1,100})?(\+hm)?")
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Head:
    """What a run is, from its config.json and result.json."""

    path: Path
    """Run folder."""
    config: dict[str, Any]
    """Options; plain values."""
    values: dict[str, Any]
    """Columns of the frame `runs` that are known before the rows are read."""
    result: dict[str, Any] | None
    """What result.json holds; None where the run is partial."""
    config_file: Path
    """Its config.json, or the copy in a published set."""
    digest: str = ""
    """SHA-256 of the file of a method from outside."""

    def decisive(self) -> dict[str, Any]:
        """What decides the numbers: `decisive`, and the file of a method from outside."""
        return decisive(self.config) | ({"method_sha256": self.digest} if self.digest else {})

    def identity(self) -> str:
        """Text that two runs of equal numbers have in common."""
        return json.dumps(self.decisive() | {"preset": ""}, sort_keys=True)  # only a name for other options

    def lineage(self) -> str:
        """`identity` that a run keeps when it is made longer."""
        return json.dumps(self.decisive() | {"preset": "", "epochs": 0}, sort_keys=True)


@dataclass(frozen=True)
class Run:
    """A run, read and checked."""

    head: Head
    """What it is."""
    values: dict[str, Any]
    """Columns of the frame `runs`, all but `run` and `variant`."""
    evaluations: Evaluations
    """Its evaluations, those of which all details were read."""
    layers: dict[str, np.ndarray]
    """Every evaluation's means over the goals of each layer: `Evaluations.layers`."""
    progress: pd.DataFrame
    """Rows of progress.csv."""
    notes: tuple[str, ...] = ()
    """What was left out of it."""


def decisive(config: Mapping[str, Any]) -> dict[str, Any]:
    """The options that decide the numbers of a run: all but the machine's, and those that its method does not use.

    Those that are younger than the run are what they then were.
    """
    config = with_later_fields(config)
    unused = {"machine"} | (set() if config["method"].endswith(HYBRID) else {"hybrid"})
    return {name: value for name, value in config.items() if name not in unused and value is not None}


def read_head(path: Path) -> Head:
    """Config and result of a run folder; imports no method.

    Raises ValueError where the folder holds no run, one of another format or version, or damaged files.
    """
    _check_size(path / "config.json")
    record = read_record(path)
    if record.get("config_version") != CONFIG_VERSION:
        found = record.get("config_version")
        raise ValueError(
            f"{path}: its config has version {found!r}; this curiobench reads version {CONFIG_VERSION} only"
        )
    try:
        config = check_config(record.get("config"))
    except ValueError as error:
        raise ValueError(f"{path / 'config.json'}: {error}") from None
    result = _read_result(path / "result.json", config["epochs"])
    begun = starts(record)
    values = {name: config[name] for name in ("task", "method", "seed", "robot", "preset", "epochs")}
    values |= {"method": shown(config["method"]), "complete": result is not None}
    values |= {name: _of_starts(begun, name) for name in (*PACKAGES, "python", "git_commit")}
    values |= {"created": _text(record.get("created")), "finished": _text((result or {}).get("finished"))}
    values |= {"machine": _text((result or {}).get("machine"))}
    values |= {"command": _command(record), "config": json.dumps(config)}
    values |= {"method_sha256": _text(begun[0].get("method_sha256"))[:64]}
    return Head(path, config, values, result, path / "config.json", values["method_sha256"])


def _told(record: Mapping[str, Any], name: str) -> list[Any]:
    """What a record says under a name of the run's beginning, and of each time it was made longer; None for nothing."""
    lengthened = record.get("lengthened", [])
    times = [record, *(lengthened if isinstance(lengthened, list) else [])]
    return [time.get(name) if isinstance(time, dict) else None for time in times]


def starts(record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Versions that a run was begun with, and each time made longer; empty where it does not tell."""
    return [versions if isinstance(versions, dict) else {} for versions in _told(record, "versions")]


def _of_starts(begun: Sequence[Mapping[str, Any]], name: str) -> str:
    """A version, or all that there were, separated by spaces; "" where one is not told."""
    texts = [_text(versions.get(name)) for versions in begun]
    return " ".join(dict.fromkeys(texts)) if all(texts) else ""


def check_config(config: Any) -> dict[str, Any]:
    """The options in a config.json, its method in the one form; raises ValueError where they are not a run's."""
    if not isinstance(config, dict):
        raise ValueError("it holds no config")
    check_name("task", config.get("task"), TASKS)
    check_name("robot", config.get("robot"), ROBOTS)
    for name, least in (("seed", 0), ("epochs", 1)):
        if type(config.get(name)) is not int or not least <= config[name] <= LARGEST_SEED:
            legal = f"a whole number from {least} to {LARGEST_SEED}"
            raise ValueError(f"{name} is {config.get(name)!r}; it must be {legal}")
    for name in ("method", "preset"):
        if not isinstance(config.get(name), str) or not _SPEC.fullmatch(config[name]):
            raise ValueError(f"{name} is {config.get(name)!r:.80}; it must be a name")
    return config | {"method": canonical(config["method"])}


def _check_size(path: Path) -> None:
    if path.exists() and not (path.is_file() and path.stat().st_size <= MAX_JSON_BYTES):
        raise ValueError(f"cannot read {path}: it is no file of less than {MAX_JSON_BYTES:,} bytes")


def _read_result(path: Path, epochs: int) -> dict[str, Any] | None:
    """What result.json holds; raises ValueError where it is damaged or of a run of other length."""
    if not path.exists():
        return None
    _check_size(path)
    result = read_json(path)
    for name in ("epochs", "steps", "updates", "goals", "goals_learned", "success", "seconds", "peak_memory_mb"):
        value = result.get(name)
        if type(value) not in (int, float) or not 0 <= value < LARGEST_NUMBER:
            raise ValueError(f"{path}: {name} is {value!r:.80}; it must be a number from 0 to {LARGEST_NUMBER:.0e}")
    if result["epochs"] != epochs:
        raise ValueError(f"{path}: it is of {result['epochs']} epochs, the config of {epochs}")
    return result


def _text(value: Any, limit: int = 200) -> str:
    """Text on one line; "" where there is none."""
    if not isinstance(value, str):
        return ""
    return "".join(character if character.isprintable() else " " for character in value[:limit])


def _command(record: Mapping[str, Any]) -> str:
    """The command line that began a run, joined with those that made it longer; "" where it does not tell."""
    lines = _told(record, "command")
    if not all(isinstance(line, list) and all(isinstance(word, str) for word in line) for line in lines):
        return ""
    return _text(" && ".join(map(shlex.join, lines)), limit=10_000)


def read_run(head: Head, every_goal: bool = True, progress: bool | Sequence[str] = True) -> Run:
    """The rows of a run.

    Args:
        head: of the run.
        every_goal: see `read_evaluations`.
        progress: read progress.csv, or only these columns of it and those that every run has; with none of these only
            its end is checked. Of a partial run it is read in any case, as it alone tells what the run has cost.

    Raises:
        ValueError: a file is missing or damaged, or the files disagree; one line that names the folder.
    """
    partial = head.result is None
    evaluations, dropped = read_evaluations(head.path / "evaluations.csv", head.config["task"], every_goal, partial)
    if head.result is not None:
        _check_result(head.path, head.result, evaluations)
    rows, dropped_progress = read_progress(head.path / "progress.csv", progress, head.result)
    epoch = int(evaluations.epoch[-1])
    values = head.values | {"epoch": epoch, "steps": int(evaluations.steps[-1])} | _cost(head.result, rows, epoch)
    notes = tuple(filter(None, (dropped, dropped_progress)))
    rows = rows if _asked(progress, rows) else pd.DataFrame()
    return Run(head, values, evaluations.detailed(), evaluations.layers(), rows, notes)


def _check_result(path: Path, result: dict[str, Any], evaluations: Evaluations) -> None:
    """Raises ValueError where result.json tells another end of the run than evaluations.csv."""
    learned, layer = evaluations.learned[-1], evaluations.layer
    found = {
        "epochs": int(evaluations.epoch[-1]),
        "steps": int(evaluations.steps[-1]),
        "goals": len(learned),
        "goals_learned": int(learned.sum()),
        "success": float(evaluations.success[-1].mean()),
    }
    for name, value in found.items():
        if abs(result[name] - value) > _TOLERANCE:
            raise ValueError(f"{path}: result.json says {name} {result[name]}, evaluations.csv {value}")
    by_layer = {
        str(k): {"learned": int(learned[layer == k].sum()), "goals": int((layer == k).sum())} for k in set(layer)
    }
    if result.get("learned_by_layer") != by_layer:
        raise ValueError(f"{path}: result.json and evaluations.csv disagree in learned_by_layer")


def read_progress(
    path: Path, progress: bool | Sequence[str], result: Mapping[str, Any] | None
) -> tuple[pd.DataFrame, str]:
    """Rows of progress.csv.

    Args:
        path: of the file.
        progress: see `read_run`.
        result: what result.json holds; None for a run that is not finished, whose last row may be cut off.

    Returns:
        The rows, and what was left out ("" for nothing).

    Raises:
        ValueError: the file is missing, damaged, or has another end than result.json; names the file.
    """
    if result is None and not path.exists():
        return pd.DataFrame(columns=list(PROGRESS_COLUMNS), dtype=np.float64), ""  # no epoch has ended yet
    with naming(path):
        content = read_bytes(path, whole=result is not None)
        whole = content[: content.rfind(b"\n") + 1]
        header = check_header(whole, PROGRESS_COLUMNS)
        wanted = _asked(progress, header)
        rows = _parse_progress(whole, wanted) if wanted or result is None else pd.DataFrame()
        if result is not None:
            _check_end(whole, header, result)
    return rows, "" if len(whole) == len(content) else f"{path}: its last row is not all there, and left out"


def _asked(progress: bool | Sequence[str], columns: Iterable[str]) -> list[str]:
    """Those of the columns of a progress.csv that `read_run` is asked for."""
    return list(columns) if progress is True else [name for name in columns if name in (progress or ())]


def _parse_progress(content: bytes, wanted: Sequence[str]) -> pd.DataFrame:
    columns = tuple(dict.fromkeys([*PROGRESS_COLUMNS, *wanted]))
    rows = parse_csv(content, columns, {"epoch": np.int32, "steps": np.int64, "updates": np.int64})
    _check_progress(rows)
    return rows


def _check_end(content: bytes, header: Sequence[str], result: Mapping[str, Any]) -> None:
    """Raises ValueError where progress.csv, of which only the last row is parsed, has another end than result.json."""
    n_rows = content.count(b"\n") - 1
    if n_rows != result["epochs"]:
        raise ValueError(f"it has {n_rows} rows for {result['epochs']} epochs")
    (last,) = csv.reader([content[:-1].rpartition(b"\n")[2].decode()])
    found = dict(zip(header, last, strict=False))
    for name in ("steps", "updates"):
        if float(found.get(name, "nan")) != result[name]:
            raise ValueError(f"its last row has {found.get(name)} {name}, result.json {result[name]}")


def _check_progress(rows: pd.DataFrame) -> None:
    if rows.empty:
        raise ValueError("it has no rows")
    columns = {name: rows[name].to_numpy() for name in rows}  # pandas takes longer for each of the steps below
    if text := [name for name, values in columns.items() if values.dtype.kind not in "biuf"]:
        raise ValueError(f"its column {text[0]} does not hold numbers")
    if (columns["epoch"] != np.arange(1, len(rows) + 1)).any():
        raise ValueError("its epochs do not count from 1")
    if not np.isfinite(columns["seconds"]).all() or (np.diff(columns["seconds"], prepend=0) < 0).any():
        raise ValueError("its seconds are not all numbers that rise from 0")
    if infinite := [name for name, values in columns.items() if np.isinf(values).any()]:
        raise ValueError(f"its column {infinite[0]} has a number that is not finite")


def _cost(result: dict[str, Any] | None, rows: pd.DataFrame, epoch: int) -> dict[str, Any]:
    """Updates, hours and memory; of a partial run up to its last evaluation, as far as they are known."""
    if result is not None:
        memory = float(result["peak_memory_mb"])
        return {"updates": int(result["updates"]), "hours": result["seconds"] / 3600, "peak_memory_mb": memory}
    until = rows[rows["epoch"] <= epoch]
    updates, seconds = (0, 0.0) if until.empty else until[["updates", "seconds"]].iloc[-1]
    return {"updates": int(updates), "hours": float(seconds) / 3600, "peak_memory_mb": float("nan")}
