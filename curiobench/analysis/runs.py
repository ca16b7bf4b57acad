"""Reads one run folder: config, rows and result, all checked, because others may have made it. Imports no method."""

import json
import re
import shlex
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd

from curiobench.analysis.rows import asked, read_evaluations, read_progress
from curiobench.config import CONFIG_VERSION, LARGEST_SEED, with_later_fields
from curiobench.files import read_json
from curiobench.methods.specs import HYBRID, canonical, display_name
from curiobench.run_folder import read_record
from curiobench.tasks.registration import check_robot
from curiobench.versions import PACKAGES

LARGEST_NUMBER = 1e15  # upper limit of steps, updates, seconds and other totals
_SPEC = re.compile(r"[\w.-]{1,100}(:[\w.]{1,100})?(\+hm)?")
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class RunData:
    """A run as read from files. `read_head` returns it without rows, `with_rows` adds them."""

    path: Path  # run folder
    config: dict[str, Any]  # options; plain values
    values: dict[str, Any]  # by column of the frame `runs`
    config_file: Path  # its config.json, or the copy in a published set
    result: dict[str, Any] | None = None  # what result.json holds
    fault: str = ""  # why its rows cannot be used
    evaluations: pd.DataFrame | None = None  # rows of `Results.evaluations`; None before they are read
    layers: pd.DataFrame = field(default_factory=pd.DataFrame)  # rows of `Results.layers`
    progress: pd.DataFrame = field(default_factory=pd.DataFrame)  # rows of `Results.progress`
    notes: tuple[str, ...] = ()  # a line for each file with incomplete last rows, which were left out

    def decisive(self) -> dict[str, Any]:
        """Options that affect the numbers, and the digest of the file of a method that is not built in."""
        digest = self.values["method_sha256"]
        return decisive(self.config) | ({"method_sha256": digest} if digest else {})

    def identity(self, **ignored: Any) -> str:
        """A key that is equal for runs with equal decisive options; `ignored` options are set to the given values."""
        return json.dumps(self.decisive() | {"preset": ""} | ignored, sort_keys=True)  # a preset is only a name


def decisive(config: Mapping[str, Any]) -> dict[str, Any]:
    """The options that affect the numbers of a run, without the machine's and those that its method does not use.

    Options that are newer than the run get the value that reproduces it.
    """
    config = with_later_fields(config)
    unused = {"machine"} | (set() if config["method"].endswith(HYBRID) else {"hybrid"})
    if config["method"] == "sac":
        unused.add("schedule_epochs")  # of curiosity's schedules
    return {name: value for name, value in config.items() if name not in unused and value is not None}


def without_beginnings(runs: Sequence[RunData]) -> list[RunData]:
    """Runs, without those that are the beginning of a longer run with the same config."""
    by_config: dict[str, list[RunData]] = defaultdict(list)
    for run in runs:
        by_config[run.identity(epochs=0)].append(run)
    return [run for run in runs if not any(_begins(run, other) for other in by_config[run.identity(epochs=0)])]


def _begins(run: RunData, other: RunData) -> bool:
    """Whether the layer means of a run are the first ones of a longer run."""
    return len(run.layers) < len(other.layers) and run.layers.equals(other.layers[: len(run.layers)])


def read_head(path: Path) -> RunData:
    """A run without its rows.

    Raises ValueError where the folder holds no run, one of another format or version, or damaged files.
    """
    record = read_record(path)
    if (found := record.get("config_version")) != CONFIG_VERSION:
        raise ValueError(
            f"{path}: its config has version {found!r}; this curiobench reads version {CONFIG_VERSION} only"
        )
    try:
        config = check_config(record.get("config"))
    except ValueError as error:
        raise ValueError(f"{path / 'config.json'}: {error}") from None
    result = _read_result(path / "result.json", config["epochs"])
    versions = versions_of(record)
    values = columns_of(config) | {"complete": result is not None}
    values |= {name: _joined(versions, name) for name in (*PACKAGES, "python", "git_commit")}
    values |= {"created": _text(record.get("created")), "command": _command(record), "config": json.dumps(config)}
    values |= {name: _text((result or {}).get(name)) for name in ("finished", "machine")}
    values |= {"method_sha256": _text(versions[0].get("method_sha256"))[:64]}
    return RunData(path, config, values, path / "config.json", result)


def columns_of(config: Mapping[str, Any]) -> dict[str, Any]:
    """The options that have a column of their own in the frame `runs`."""
    same = {name: config[name] for name in ("task", "seed", "robot", "preset", "epochs")}
    return same | {"method": display_name(config["method"])}


def _starts(record: Mapping[str, Any], name: str) -> list[Any]:
    """A value of the record at a run's start and at each lengthening; None if it is missing."""
    longer = record.get("lengthened", [])
    starts = [record, *(longer if isinstance(longer, list) else [])]
    return [start.get(name) if isinstance(start, dict) else None for start in starts]


def versions_of(record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Versions at a run's start and at each lengthening; empty if not recorded."""
    return [versions if isinstance(versions, dict) else {} for versions in _starts(record, "versions")]


def _joined(versions: Sequence[Mapping[str, Any]], name: str) -> str:
    """The different values of a version, separated by spaces; "" if one is not recorded."""
    texts = [_text(found.get(name)) for found in versions]
    return " ".join(dict.fromkeys(texts)) if all(texts) else ""


def check_config(config: Any) -> dict[str, Any]:
    """The options in a config.json, with a canonical method spec. Raises ValueError if one is missing or illegal."""
    if not isinstance(config, dict):
        raise ValueError("it holds no config")
    check_robot(config.get("task"), config.get("robot"))
    for name, least in (("seed", 0), ("epochs", 1)):
        if type(config.get(name)) is not int or not least <= config[name] <= LARGEST_SEED:
            legal = f"a whole number from {least} to {LARGEST_SEED}"
            raise ValueError(f"{name} is {config.get(name)!r}; it must be {legal}")
    for name in ("method", "preset"):
        if not isinstance(config.get(name), str) or not _SPEC.fullmatch(config[name]):
            legal = "letters, digits and . _ - (a method may also have :Class and +hm)"
            raise ValueError(f"{name} is {config.get(name)!r:.80}; it must consist of {legal}")
    return config | {"method": canonical(config["method"])}


def _read_result(path: Path, epochs: int) -> dict[str, Any] | None:
    """The content of result.json. Raises ValueError if it is damaged or has another number of epochs."""
    if not path.exists():
        return None
    result = read_json(path)
    for name in ("epochs", "steps", "updates", "goals", "goals_learned", "success", "seconds", "peak_memory_mb"):
        value = result.get(name)
        if type(value) not in (int, float) or not 0 <= value < LARGEST_NUMBER:
            raise ValueError(f"{path}: {name} is {value!r:.80}; it must be a number from 0 to {LARGEST_NUMBER:.0e}")
    if result["epochs"] != epochs:
        raise ValueError(f"{path} records {result['epochs']} epochs, config.json {epochs}")
    return result


def _text(value: Any, limit: int = 200) -> str:
    """Text on one line; "" for anything else."""
    if not isinstance(value, str):
        return ""
    return "".join(character if character.isprintable() else " " for character in value[:limit])


def _command(record: Mapping[str, Any]) -> str:
    """The command lines of a run's start and lengthenings, joined by &&; "" where one is not recorded."""
    lines = _starts(record, "command")
    if not all(isinstance(line, list) and all(isinstance(word, str) for word in line) for line in lines):
        return ""
    return _text(" && ".join(map(shlex.join, lines)), limit=10_000)


def with_rows(run: RunData, every_goal: bool, progress: bool | Collection[str]) -> RunData:
    """A run by `read_head` with its rows; the other arguments are those of `read_evaluations` and `read_progress`.

    progress.csv of a partial run is always read, as nothing else has its cost. Raises ValueError, one line that names
    the folder, where a file is missing or damaged, or the files disagree.
    """
    partial = run.result is None
    file = run.path / "evaluations.csv"
    (evaluations, layers), dropped = read_evaluations(file, run.config["task"], every_goal, partial)
    if run.result is not None:
        _check_result(run.path, run.result, evaluations, layers)
    rows, cut = read_progress(run.path / "progress.csv", progress, run.result)
    epoch, steps = (int(layers[name].iloc[-1]) for name in ("epoch", "steps"))
    return replace(
        run,
        values=run.values | {"epoch": epoch, "steps": steps} | _cost(run.result, rows, epoch),
        evaluations=evaluations,
        layers=layers,
        progress=rows if asked(progress, rows) else pd.DataFrame(),
        notes=tuple(filter(None, (dropped, cut))),
    )


def _check_result(path: Path, result: Mapping[str, Any], evaluations: pd.DataFrame, layers: pd.DataFrame) -> None:
    """Raises ValueError where result.json and the last evaluation disagree."""
    total, *of_layers = layers[layers["epoch"] == layers["epoch"].iloc[-1]].to_dict("records")
    found = {
        "epochs": total["epoch"],
        "steps": total["steps"],
        "goals": total["goals"],
        "goals_learned": total["learned"],
        "success": float(evaluations["success"].to_numpy()[-total["goals"] :].mean()),
    }
    for name, value in found.items():
        if abs(result[name] - value) > _TOLERANCE:
            raise ValueError(f"{path}: result.json says {name} {result[name]}, evaluations.csv {value}")
    by_layer = {str(row["layer"]): {name: row[name] for name in ("learned", "goals")} for row in of_layers}
    if result.get("learned_by_layer") != by_layer:
        raise ValueError(f"{path}: result.json and evaluations.csv disagree in learned_by_layer")


def _cost(result: Mapping[str, Any] | None, rows: pd.DataFrame, epoch: int) -> dict[str, Any]:
    """Updates, hours and memory; of a partial run those up to its last evaluation, without the memory."""
    if result is not None:
        memory = float(result["peak_memory_mb"])
        return {"updates": int(result["updates"]), "hours": result["seconds"] / 3600, "peak_memory_mb": memory}
    until = rows[rows["epoch"] <= epoch]
    updates, seconds = (0, 0.0) if until.empty else until[["updates", "seconds"]].iloc[-1]
    return {"updates": int(updates), "hours": float(seconds) / 3600, "peak_memory_mb": float("nan")}
