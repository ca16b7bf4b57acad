"""Run folders with numbers that a test chooses, written without training."""

import copy
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from curiobench.config import CONFIG_VERSION
from curiobench.methods.specs import canonical
from curiobench.presets import preset
from curiobench.run_folder import RUN_FORMAT
from curiobench.tasks.registration import task_spec

Success = Callable[[str, str, int, int, int], float]
"""Share of successful episodes by task, method (as given), seed, epoch and position of the goal."""

STEPS_AN_EPOCH = 1_000
EPISODES = 25
SECONDS_AN_EPOCH = 36.0
NINE = ("sac", "icm", "rnd", "dac", "re3", "mihm", "icm+hm", "rnd+hm", "mi")
LONG = "my_lab.curiosity:SomethingLong+hm"
"""A method that cannot be imported, and whose name is long."""


def rising(task: str, method: str, seed: int, epoch: int, goal: int) -> float:
    """Success that rises with the epoch, earlier for the first goals and for longer names; differs between seeds."""
    return round(min(1.0, epoch / (4 + goal) + 0.02 * seed + 0.03 * len(method)) * EPISODES) / EPISODES


def known(task: str, method: str, seed: int, epoch: int, goal: int) -> float:
    """From the second epoch on, sac has learned one goal; mihm all, but for the last goal with seed 1."""
    if epoch < 2:
        return 0.0
    if method == "sac":
        return float(goal == 0)
    return 0.6 if (seed, goal) == (1, 3) else 1.0


def uneven(task: str, method: str, seed: int, epoch: int, goal: int) -> float:
    """Success of 1 from an epoch on that differs with goal and seed."""
    return float(epoch >= goal + seed + (method == "sac"))


def write_runs(
    folder: Path,
    tasks: Sequence[str] = ("stack2",),
    methods: Sequence[str] = ("sac", "mihm"),
    seeds: int | Iterable[int] = 3,
    epochs: int = 4,
    success: Success = rising,
    options: Mapping[str, Any] | None = None,
    complete: bool = True,
    grid: bool = False,
    suffix: str = "",
) -> list[Path]:
    """Write a run folder for every task, method and seed.

    Args:
        folder: where; each run folder is `TASK-METHOD-SEED` + `suffix` in it.
        tasks: of the runs.
        methods: specs; one that is not built in, such as `pkg.mod:Class`, need not exist.
        seeds: or how many from 0 on.
        epochs: of the runs, with an evaluation after each and one before the first.
        success: see `Success`.
        options: that differ from the laptop preset, by dotted name: `{"sac.tau": 0.1}`.
        complete: with a result.json; otherwise the config plans twice the epochs.
        grid: also write grid.json, which expects these runs.
        suffix: of the folder names.

    Returns:
        The run folders.
    """
    seeds = range(seeds) if isinstance(seeds, int) else list(seeds)
    cells = [(task, method, seed) for task in tasks for method in methods for seed in seeds]
    paths = []
    for task, method, seed in cells:
        path = folder / f"{task}-{method.replace(':', '_')}-{seed}{suffix}"
        write_run(path, task, method, seed, epochs, success, options or {}, complete)
        paths.append(path)
    if grid:
        write_grid(folder, [(path.name, *cell) for path, cell in zip(paths, cells, strict=True)])
    return paths


def write_grid(folder: Path, cells: Iterable[tuple[str, str, str, int]]) -> None:
    """Write the grid.json that expects these runs: folder, task, method and seed each."""
    names = ("folder", "task", "method", "seed")
    listed = [dict(zip(names, cell, strict=True)) | {"variant": ""} for cell in cells]
    (folder / "grid.json").write_text(json.dumps({"format": "curiobench grid", "cells": listed}))


def write_run(
    path: Path,
    task: str,
    method: str,
    seed: int,
    epochs: int,
    success: Success,
    options: Mapping[str, Any],
    complete: bool,
) -> None:
    """Write one run folder; see `write_runs`."""
    path.mkdir(parents=True)
    space = task_spec(task).goal_space
    rates = np.array([[success(task, method, seed, e, g) for g in range(len(space))] for e in range(epochs + 1)])
    _write_config(path, task, method, seed, epochs if complete else 2 * epochs, options)
    (path / "evaluations.csv").write_text(_evaluations(task, rates))
    (path / "progress.csv").write_text(_progress(method, rates))
    if complete:
        (path / "result.json").write_text(json.dumps(_result(space.layers, rates)))


def _write_config(path: Path, task: str, method: str, seed: int, epochs: int, options: Mapping[str, Any]) -> None:
    config = copy.deepcopy(preset("laptop", task).to_json())
    config |= {"task": task, "method": canonical(method), "seed": seed, "epochs": epochs}
    config["method_config"] = None if method == "sac" else {"hidden": 128}
    for name, value in options.items():
        *outer, last = name.split(".")
        within = config
        for key in outer:
            within = within[key]
        within[last] = value
    packages = ("curiobench", "mujoco", "dm_control", "torch", "numpy", "python")
    record = {
        "format": RUN_FORMAT,
        "config_version": CONFIG_VERSION,
        "config": config,
        "versions": dict.fromkeys(packages, "1.0") | {"git_commit": "c0ffee"},
        "command": ["curiobench", "train", "--task", task, "--method", method, "--out", str(path)],
        "created": "2026-11-22T08:00:00+00:00",
    }
    (path / "config.json").write_text(json.dumps(record))


def _evaluations(task: str, rates: np.ndarray) -> str:
    """evaluations.csv; one test episode of each goal in layer 1 starts with the goal satisfied."""
    space = task_spec(task).goal_space
    lines = ["epoch,steps,goal,bits,layer,episodes,success,episodes_unsatisfied,success_unsatisfied,learned"]
    goals = [
        (f'"{name}"' if "," in name else name, space.bit_string(bits), layer)
        for name, bits, layer in zip(space.names, space.goals, space.layers, strict=True)
    ]
    for epoch, row in enumerate(rates.tolist()):
        lines += [
            f"{epoch},{epoch * STEPS_AN_EPOCH},{name},{bits},{layer},{EPISODES},{rate},"
            f"{EPISODES - (layer == 1)},{rate},{int(rate > 0.8)}"
            for (name, bits, layer), rate in zip(goals, row, strict=True)
        ]
    return "\n".join(lines) + "\n"


def _progress(method: str, rates: np.ndarray) -> str:
    hybrid, curious = canonical(method).endswith("+hm"), method != "sac"
    names = "epoch,steps,updates,episodes,diverged,training_success,training_success_unsatisfied,goals_reached,"
    names += (
        "goals_learned,success,reward,critic_loss"
        + ",bonus_spread" * curious
        + ",share_exploitation" * hybrid
        + ",seconds"
    )
    lines = [names]
    for epoch, row in enumerate(rates[1:], start=1):
        means = f"{row.mean()},{row.mean()},{(row > 0).sum()},{(row > 0.8).sum()},{row.mean()},0.3,{1 / epoch}"
        logged = f",{0.2 / epoch}" * curious + f",{0.5 + 0.4 * row.mean()}" * hybrid
        counts = f"{epoch},{epoch * STEPS_AN_EPOCH},{epoch * 10},20,0"
        lines.append(f"{counts},{means}{logged},{epoch * SECONDS_AN_EPOCH}")
    return "\n".join(lines) + "\n"


def _result(layers: np.ndarray, rates: np.ndarray) -> dict[str, Any]:
    epochs, last = len(rates) - 1, rates[-1]
    by_layer = {
        str(k): {"learned": int((last[layers == k] > 0.8).sum()), "goals": int((layers == k).sum())}
        for k in np.unique(layers)
    }
    return {
        "epochs": epochs,
        "steps": epochs * STEPS_AN_EPOCH,
        "updates": epochs * 10,
        "goals": len(last),
        "goals_learned": int((last > 0.8).sum()),
        "learned_by_layer": by_layer,
        "success": float(last.mean()),
        "seconds": epochs * SECONDS_AN_EPOCH,
        "peak_memory_mb": 800,
        "machine": "Test CPU, 2 cores",
        "finished": "2026-11-22T09:00:00+00:00",
    }
