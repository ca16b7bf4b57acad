"""Run folders that keep every rule of a submission, of numbers that nobody trained for; and ways to alter runs."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from synthetic import write_runs

from curiobench.analysis.folders import SUMS, read_sums
from curiobench.files import read_json
from curiobench.protocol import EVALUATION_SEED, LEARNED_ABOVE, satisfied_starts
from curiobench.tasks.registration import TASK_VERSION

OUTSIDE = "pkg.mod:Class"
"""A method that cannot be imported."""
EPOCHS, STEPS, UPDATES = 6, 128_000, 2_400
"""Epochs of the laptop preset on stack2, and steps and updates of each."""
COMMIT = "0123456789abcdef0123456789abcdef01234567"


def write_lawful(folder: Path) -> list[Path]:
    """Write run folders of the laptop preset, four seeds of sac and of `OUTSIDE`."""
    paths = write_runs(folder, methods=["sac", OUTSIDE], seeds=4, epochs=EPOCHS)
    for number, path in enumerate(paths):
        edit_versions(path, git_commit=COMMIT, task_version=TASK_VERSION, evaluation_seed=EVALUATION_SEED)
        if OUTSIDE in read_json(path / "config.json")["config"]["method"]:
            edit_versions(path, method_file="/home/someone/mod.py", method_sha256="ab" * 32)
        rewrite(path)
        edit_rows(path / "progress.csv", lambda rows, n=number: rows.assign(critic_loss=rows["critic_loss"] + n))
    return paths


def edit_json(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Change what a JSON file holds, in place."""
    values = json.loads(path.read_text())
    change(values)
    path.write_text(json.dumps(values))


def edit_versions(path: Path, **values: Any) -> None:
    """Set versions in config.json; None removes one."""

    def change(record: dict[str, Any]) -> None:
        record["versions"] = {name: v for name, v in (record["versions"] | values).items() if v is not None}

    edit_json(path / "config.json", change)


def lengthen(path: Path, **versions: Any) -> None:
    """Let config.json say that the run was lengthened, with its own versions but for some."""

    def change(record: dict[str, Any]) -> None:
        again = {"versions": record["versions"] | versions, "command": ["curiobench", "train", "--resume"]}
        record.setdefault("lengthened", []).append(again)

    edit_json(path / "config.json", change)


def edit_options(path: Path, part: str = "", **values: Any) -> None:
    """Set options in config.json, those of a part of it such as "sac", if it is named."""
    edit_json(
        path / "config.json", lambda record: (record["config"][part] if part else record["config"]).update(values)
    )


def edit_rows(file: Path, change: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
    """Rewrite a csv file of a run."""
    change(pd.read_csv(file, dtype={"bits": str})).to_csv(file, index=False)


def sign(folder: Path) -> None:
    """Write the digests of a published set's files as they are now."""
    sums = [f"{hashlib.sha256((folder / name).read_bytes()).hexdigest()}  {name}\n" for name in read_sums(folder)]
    (folder / SUMS).write_text("".join(sums))


def rewrite(path: Path, episodes: int = 25, steps: int = STEPS, satisfied: dict[str, int] | None = None) -> None:
    """Bring the numbers of a synthetic run to whole episodes of a protocol.

    Args:
        path: of the run.
        episodes: of a goal.
        steps: of an epoch.
        satisfied: episodes that start with their goal satisfied, by the goal's bits; those of the protocol if None.
    """
    config = read_json(path / "config.json")["config"]
    held = satisfied_starts(config["task"], episodes) if satisfied is None else satisfied
    edit_rows(path / "evaluations.csv", lambda rows: _whole_episodes(rows, episodes, steps, held))
    edit_rows(
        path / "progress.csv", lambda rows: rows.assign(steps=rows["epoch"] * steps, updates=rows["epoch"] * UPDATES)
    )
    last = pd.read_csv(path / "evaluations.csv").tail(len(held) + 2)
    layers = last.groupby("layer")["learned"].agg(["sum", "size"])
    by_layer = {str(k): {"learned": int(n), "goals": int(total)} for k, n, total in layers.itertuples()}
    result = {"steps": EPOCHS * steps, "updates": EPOCHS * UPDATES, "success": float(last["success"].mean())}
    result |= {"goals_learned": int(last["learned"].sum()), "learned_by_layer": by_layer}
    edit_json(path / "result.json", lambda values: values.update(result))


def _whole_episodes(rows: pd.DataFrame, episodes: int, steps: int, held: dict[str, int]) -> pd.DataFrame:
    """Rows in which every episode that starts with its goal satisfied succeeds."""
    satisfied = rows["bits"].map(held).fillna(0).astype(int)
    unsatisfied = episodes - satisfied
    earned = np.rint(rows["success"] * unsatisfied)
    success = (earned + satisfied) / episodes
    return rows.assign(
        steps=rows["epoch"] * steps,
        episodes=episodes,
        success=success,
        episodes_unsatisfied=unsatisfied,
        success_unsatisfied=earned / unsatisfied,
        learned=(success > LEARNED_ABOVE).astype(int),
    )
