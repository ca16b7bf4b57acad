"""Options in which runs agree or differ: variants, scale, and what makes a comparison unfair."""

import json
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from curiobench.analysis.runs import decisive
from curiobench.options import flatten
from curiobench.presets import PRESETS, preset
from curiobench.tasks.registration import task_spec
from curiobench.versions import PACKAGES

RUN_OPTIONS = ("task", "method", "seed")  # options in which runs of a grid differ: every table has a column of each
_PAPER = PRESETS["paper"]
PAPER_STEPS = _PAPER.epochs * _PAPER.cycles * _PAPER.worlds * _PAPER.rollouts * task_spec(_PAPER.task).horizon
"""Steps of a run of the paper."""
_SETTINGS = "method_config."  # before the names of a method's own settings


def variants(options: Sequence[Mapping[str, Any]]) -> list[str]:
    """Options in which a run differs from others of its task and method, as "sac.tau=0.1, sac.gamma=0.9".

    `options` are nested as in config.json, without the machine's. If such runs have several presets, the preset is
    named, and other options only if they differ within it. Options that are False are not named.
    """
    flat = [flatten(run) for run in options]
    found = [""] * len(flat)
    for members in _groups(flat, range(len(flat)), "task", "method"):
        differing = _differing([flat[i] for i in members])
        named = ["preset"] if "preset" in differing and len(differing) > 1 else []  # the name alone sets no run apart
        for within in _groups(flat, members, "preset"):
            names = named + _differing([flat[i] for i in within])
            for i in within:
                on = [name for name in names if flat[i].get(name, False) is not False]
                found[i] = ", ".join(f"{_flag(name)}={_word(flat[i][name])}" for name in on)
    return found


def cautions(runs: pd.DataFrame) -> list[str]:
    """A line on each difference between runs that makes a comparison unfair, from the frame `runs`."""
    lines = []
    for task, group in runs.groupby("task", sort=True):
        lines += _unlike_options(task, [flatten(decisive(config)) for config in configs(group)], list(group["variant"]))
        for package in PACKAGES:
            if len(found := sorted({*group[package]} - {""})) > 1:  # "" is not recorded, which is no difference
                lines.append(f"runs of {task} were made with {package} {' and '.join(found)}")
        commits = list(dict.fromkeys(commit[:7] for text in group["git_commit"] for commit in text.split()))
        if len(commits) > 1:
            lines.append(f"runs of {task} were made at {len(commits)} commits: {', '.join(commits)}")
    if partial := (~runs["complete"]).sum():
        lines.append(f"runs that are not finished: {partial}; their last evaluation stands for their end")
    return list(dict.fromkeys(lines))


def _unlike_options(task: str, flat: Sequence[Mapping[str, Any]], named: Sequence[str]) -> list[str]:
    """Lines on options that all runs of a task have and in which they differ, such as the number of epochs.

    Methods' own settings, which may share a name but no meaning, and options in the variants `named` are left out. If
    variants name the preset, runs are compared within each preset.
    """
    lines = []
    apart = ("preset",) if any(_names(text, "preset") for text in named) else ()
    for members in _groups(flat, range(len(flat)), *apart):
        runs = [flat[i] for i in members]
        common = [n for n in _differing(runs) if all(n in run for run in runs) and not n.startswith(_SETTINGS)]
        words = {name: {_word(flat[i][name]) for i in members if not _names(named[i], name)} for name in common}
        if unlike := [f"{name} ({' or '.join(sorted(found))})" for name, found in words.items() if len(found) > 1]:
            lines.append(f"runs of {task} differ in {', '.join(unlike)}")
    return lines


def configs(runs: pd.DataFrame) -> list[dict[str, Any]]:
    """The options of runs, as config.json has them."""
    return [json.loads(text) for text in runs["config"]]


def _names(variant: str, name: str) -> bool:
    """Whether a variant's text has the value of an option."""
    return any(part.startswith(f"{_flag(name)}=") for part in variant.split(", "))


def _groups(flat: Sequence[Mapping[str, Any]], members: Iterable[int], *names: str) -> list[list[int]]:
    """Positions of the members that share these options."""
    groups = defaultdict(list)
    for i in members:
        groups[tuple(flat[i][name] for name in names)].append(i)
    return list(groups.values())


def _differing(runs: Sequence[Mapping[str, Any]]) -> list[str]:
    names = dict.fromkeys(name for run in runs for name in run if name not in RUN_OPTIONS)
    unset = object()
    return [name for name in names if len({json.dumps(run[name]) if name in run else unset for run in runs}) > 1]


def _flag(name: str) -> str:
    """Name of an option on the command line, with underscores."""
    return name.replace(_SETTINGS, "method.")


def _word(value: Any) -> str:
    text = value[:8] if isinstance(value, str) and len(value) == 64 else str(value)  # of a digest the first eight
    return "".join(character if character.isprintable() else " " for character in text[:60])


def scale_of(runs: pd.DataFrame) -> str:
    """The scale of runs of one task, as "gripper, laptop preset: 28 epochs, 1.79 M steps a run".

    Options in which all of them differ from their preset are named: "laptop preset with updates=40".
    """
    robots, presets = ("/".join(sorted(set(map(str, runs[name])))) for name in ("robot", "preset"))
    changed = [_changed(config) for config in configs(runs.drop_duplicates("config"))]
    shared = {name: value for name, value in changed[0].items() if all(c.get(name) == value for c in changed)}
    with_ = f" with {', '.join(f'{name}={value}' for name, value in shared.items())}" if shared else ""
    epochs = spread(runs["epoch"], lambda number: f"{number:,.0f}")
    plural = "" if epochs == "1" else "s"
    return f"{robots}, {presets} preset{with_}: {epochs} epoch{plural}, {spread(runs['steps'], millions)} steps a run"


def _changed(config: Mapping[str, Any]) -> dict[str, Any]:
    """Options that every method has, with another value than in the preset."""
    usual = flatten(preset(config["preset"], config["task"]).decisive()) if config["preset"] in PRESETS else {}
    flat = flatten({n: v for n, v in decisive(config).items() if n not in (*RUN_OPTIONS, "robot", "preset", "epochs")})
    own = (_SETTINGS, "hybrid.")
    return {n: value for n, value in flat.items() if not n.startswith(own) and n in usual and value != usual[n]}


def spread(values: "pd.Series", write: Callable[[float], str]) -> str:
    """A number, or the least and the largest, as text."""
    low, high = write(values.min()), write(values.max())
    return low if low == high else f"{low} to {high}"


def millions(steps: float) -> str:
    """A number of steps as text."""
    return f"{steps / 1e6:.3g} M" if steps >= 1e6 else f"{steps:,.0f}"


def hour_digits(hours: float) -> int:
    """Decimals that hours of work take: two, more for runs of a few minutes."""
    return 2 if hours >= 0.1 else 4
