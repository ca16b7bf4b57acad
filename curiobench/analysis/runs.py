"""One run folder: its config, its rows and its result, checked. Imports no method, and trusts no file."""

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
from curiobench.methods.specs import HYBRID, canonical, shown
from curiobench.run_folder import read_record
from curiobench.tasks.registration import check_robot
from curiobench.versions import PACKAGES

MAX_JSON_BYTES = 1 << 20
LARGEST_NUMBER = 1e15  # of steps, updates, seconds and the like; more cannot be
_SPEC = re.compile(r"[\w.-]{1,100}(:[\w.]{1,100})?(\+hm)?")
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Run:
    """A run: first its config and result, then also its rows."""

    path: Path  # run folder
    config: dict[str, Any]  # options; plain values
    values: dict[str, Any]  # columns of the frame `runs` that are known so far
    config_file: Path  # its config.json, or the copy in a published set
    result: dict[str, Any] | None = None  # what result.json holds
    fault: str = ""  # why its rows cannot be used
    evaluations: pd.DataFrame | None = None  # rows of `Results.evaluations`; None before they are read
    layers: pd.DataFrame = field(default_factory=pd.DataFrame)  # rows of `Results.layers`
    progress: pd.DataFrame = field(default_factory=pd.DataFrame)  # rows of `Results.progress`
    notes: tuple[str, ...] = ()  # one line on each incomplete end of a file that was left out

    def decisive(self) -> dict[str, Any]:
        """Options that decide the numbers, and the digest of the file of a method from outside."""
        digest = self.values["method_sha256"]
        return decisive(self.config) | ({"method_sha256": digest} if digest else {})

    def identity(self, **ignored: Any) -> str:
        """Text that two runs of equal numbers have in common; `ignored` options have the same value in both."""
        return json.dumps(self.decisive() | {"preset": ""} | ignored, sort_keys=True)  # a preset is only a name


def decisive(config: Mapping[str, Any]) -> dict[str, Any]:
    """The options that decide the numbers of a run: all but the machine's, and those that its method does not use.

    Options that are younger than the run have the value that they then had.
    """
    config = with_later_fields(config)
    unused = {"machine"} | (set() if config["method"].endswith(HYBRID) else {"hybrid"})
    if config["method"] == "sac":
        unused.add("schedule_epochs")  # of curiosity's schedules
    return {name: value for name, value in config.items() if name not in unused and value is not None}


def without_beginnings(runs: Sequence[Run]) -> list[Run]:
    """The runs without those that were made longer: another one has the same config but for its length, and rows."""
    alike: dict[str, list[Run]] = defaultdict(list)
    keys = [run.identity(epochs=0) for run in runs]
    for key, run in zip(keys, runs, strict=True):
        alike[key].append(run)
    return [run for key, run in zip(keys, runs, strict=True) if not any(_begins(run, other) for other in alike[key])]


def _begins(run: Run, other: Run) -> bool:
    """Whether the rows of one run are the first of a longer one; they are compared as means of layers."""
    return len(run.layers) < len(other.layers) and run.layers.equals(other.layers[: len(run.layers)])


def read_head(path: Path) -> Run:
    """A run without its rows.

    Raises ValueError where the folder holds no run, one of another format or version, or damaged files.
    """
    _check_size(path / "config.json")
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
    return Run(path, config, values, path / "config.json", result)


def columns_of(config: Mapping[str, Any]) -> dict[str, Any]:
    """The options that have a column of their own in the frame `runs`."""
    return {name: config[name] for name in ("task", "seed", "robot", "preset", "epochs")} | {
        "method": shown(config["method"])
    }


def _starts(record: Mapping[str, Any], name: str) -> list[Any]:
    """A value in the record of a run's start, and of each start that made it longer; None where it is missing."""
    longer = record.get("lengthened", [])
    starts = [record, *(longer if isinstance(longer, list) else [])]
    return [start.get(name) if isinstance(start, dict) else None for start in starts]


def versions_of(record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Versions that a run was begun with, and each time made longer; empty where they are not recorded."""
    return [versions if isinstance(versions, dict) else {} for versions in _starts(record, "versions")]


def _joined(versions: Sequence[Mapping[str, Any]], name: str) -> str:
    """A version, or all that there were, separated by spaces; "" where one is not recorded."""
    texts = [_text(found.get(name)) for found in versions]
    return " ".join(dict.fromkeys(texts)) if all(texts) else ""


def check_config(config: Any) -> dict[str, Any]:
    """The options in a config.json, its method in the one form; raises ValueError where they are not a run's."""
    if not isinstance(config, dict):
        raise ValueError("it holds no config")
    check_robot(config.get("task"), config.get("robot"))
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
    """The command line that began a run, joined with those that made it longer; "" where one is not recorded."""
    lines = _starts(record, "command")
    if not all(isinstance(line, list) and all(isinstance(word, str) for word in line) for line in lines):
        return ""
    return _text(" && ".join(map(shlex.join, lines)), limit=10_000)


def with_rows(run: Run, every_goal: bool = True, progress: bool | Collection[str] = True) -> Run:
    """A run by `read_head` with its rows; the other arguments are those of `read_evaluations` and `read_progress`.

    Of a partial run progress.csv is read in any case, as it alone has what the run cost. Raises ValueError, one line
    that names the folder, where a file is missing or damaged, or the files disagree.
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
    """Raises ValueError where result.json has another end of the run than evaluations.csv."""
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
    """Updates, hours and memory; of a partial run up to its last evaluation, as far as they are known."""
    if result is not None:
        memory = float(result["peak_memory_mb"])
        return {"updates": int(result["updates"]), "hours": result["seconds"] / 3600, "peak_memory_mb": memory}
    until = rows[rows["epoch"] <= epoch]
    updates, seconds = (0, 0.0) if until.empty else until[["updates", "seconds"]].iloc[-1]
    return {"updates": int(updates), "hours": float(seconds) / 3600, "peak_memory_mb": float("nan")}
