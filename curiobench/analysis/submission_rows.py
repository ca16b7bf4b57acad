"""What `curiobench submit-check` asks of the rows of a run: the protocol's test episodes, and numbers that can be."""

from collections.abc import Iterator
from itertools import chain
from typing import Any

import numpy as np
import pandas as pd

from curiobench.analysis.frames import IDENTITY
from curiobench.analysis.rows import LARGEST_LISTED_TASK
from curiobench.analysis.submission import Fault, Reference, Skipped, Submission
from curiobench.protocol import satisfied_starts
from curiobench.tasks.goals import goal_space
from curiobench.tasks.registration import EPISODE_STEPS, n_blocks_of

_LARGEST_OPTION = 10**9
_ROUNDING = 1e-6


def goals(runs: Submission, against: Reference) -> Iterator[Fault]:
    """Names, bits and layers of all goals of the task, and of no other."""
    for run, rows in runs.evaluations.items():
        wanted = _goals_of(runs.configs[run]["task"], against)
        found = set(rows[["goal", "bits", "layer"]].itertuples(index=False, name=None))
        for odd, told in ((found - wanted, "is none of the task's"), (wanted - found, "is missing")):
            if wanted and odd:
                name, bits, layer = min(odd)
                yield f"goal {name!r}, {bits} in layer {layer}, {told}", run


def _goals_of(task: str, against: Reference) -> set[tuple[str, str, int]]:
    """Name, bits and layer of each goal of a task; empty where they are not known."""
    if n_blocks_of(task) <= LARGEST_LISTED_TASK:
        space = goal_space(n_blocks_of(task))
        return set(zip(space.names, map(space.bit_string, space.goals), map(int, space.layers), strict=True))
    if against.runs is None:
        return set()
    rows = against.runs.results.evaluations
    rows = rows[rows["task"] == task].drop_duplicates("bits")
    return set(rows[["goal", "bits", "layer"]].itertuples(index=False, name=None))


def episodes(runs: Submission, _: Reference) -> Iterator[Fault]:
    """As many test episodes of every goal as the config says."""
    for run, rows in runs.evaluations.items():
        wanted = runs.configs[run].get("episodes_per_goal")
        for found in rows["episodes"].unique():
            if found != wanted:
                yield f"{found} episodes of a goal, not {wanted!r}", run


def starts(runs: Submission, against: Reference) -> Iterator[Fault]:
    """Goals hold at the start of as many test episodes as those of the protocol's seed."""
    known = False
    for run, rows in runs.evaluations.items():
        kinds = rows[["goal", "bits", "episodes", "episodes_unsatisfied"]].drop_duplicates()
        for goal, bits, total, unsatisfied in kinds.itertuples(index=False, name=None):
            counts = _satisfied(runs.configs[run]["task"], total, against)
            if counts is None:
                continue
            known, found, wanted = True, total - unsatisfied, counts.get(bits, 0)
            if found != wanted:
                yield f"{goal!r} holds at the start of {found} of {total} test episodes, not {wanted}", run
    if not known:
        raise Skipped("the protocol's test starts are not on record for this task and number of episodes")


def _satisfied(task: str, total: int, against: Reference) -> dict[str, int] | None:
    """Test episodes that start with their goal satisfied, by the goal's bits; None where that is not known."""
    counts = satisfied_starts(task, total)
    if counts is not None or against.runs is None:
        return counts
    rows = against.runs.results.evaluations
    rows = rows[(rows["task"] == task) & (rows["episodes"] == total)].drop_duplicates("bits")
    return dict(zip(rows["bits"], rows["episodes"] - rows["episodes_unsatisfied"], strict=True)) if len(rows) else None


def schedule(runs: Submission, _: Reference) -> Iterator[Fault]:
    """Evaluations before training, after every `evaluate_every`-th epoch and after the last."""
    for run, rows in runs.evaluations.items():
        config = runs.configs[run]
        if fault := _no_numbers(config, "evaluate_every"):
            yield fault, run
            continue
        last, every, found = config["epochs"], config["evaluate_every"], set(rows["epoch"])
        lacking = next((epoch for epoch in chain(range(0, last, every), [last]) if epoch not in found), None)
        if lacking is not None:
            yield f"no evaluation after epoch {lacking}", run
        if odd := [epoch for epoch in found if epoch > last or (epoch % every and epoch != last)]:
            yield f"an unplanned evaluation after epoch {min(odd)}", run


def amounts(runs: Submission, _: Reference) -> Iterator[Fault]:
    """As many steps and updates an epoch as the config says."""
    for run, config in runs.configs.items():
        if fault := _no_numbers(config, "cycles", "worlds", "rollouts", "updates"):
            yield fault, run
        elif run not in runs.progress:
            yield "no rows of progress", run
        else:
            steps = config["cycles"] * config["worlds"] * config["rollouts"] * EPISODE_STEPS
            told = _off(runs.evaluations[run], "steps", steps) or _off(runs.progress[run], "steps", steps)
            if told := told or _off(runs.progress[run], "updates", config["cycles"] * config["updates"]):
                yield told, run


def _no_numbers(config: dict[str, Any], *names: str) -> str:
    """What is wrong with options that have to be whole numbers; empty if nothing is."""
    wrong = [name for name in names if type(config.get(name)) is not int or not 1 <= config[name] <= _LARGEST_OPTION]
    return f"{wrong[0]} is {config.get(wrong[0])!r:.40}, not a number from 1 to {_LARGEST_OPTION:,}" if wrong else ""


def _off(rows: pd.DataFrame, name: str, an_epoch: int) -> str:
    """Where a counter does not rise by this much every epoch, as text; empty if it does."""
    wrong = rows[rows[name] != rows["epoch"].astype(float) * an_epoch]
    if not len(wrong):
        return ""
    epoch, found = (int(wrong[column].iloc[0]) for column in ("epoch", name))
    return f"{found} {name} after epoch {epoch}, not {epoch * an_epoch}"


def counts(runs: Submission, _: Reference) -> Iterator[Fault]:
    """Shares of whole episodes: successes, and those among them whose goal did not hold at the start."""
    for run, rows in runs.evaluations.items():
        satisfied = rows["episodes"] - rows["episodes_unsatisfied"]
        successes = rows["success"] * rows["episodes"]
        earned = (rows["success_unsatisfied"] * rows["episodes_unsatisfied"]).where(rows["episodes_unsatisfied"] > 0, 0)
        whole = _is_whole(successes) & _is_whole(earned)
        wrong = ~(whole & (successes - earned).between(-_ROUNDING, satisfied + _ROUNDING))
        if wrong.any():
            row = rows[wrong].iloc[0]
            all_, some = (
                f"{row['success']} of {row['episodes']}",
                f"{row['success_unsatisfied']} of {row['episodes_unsatisfied']}",
            )
            told = f"{row['goal']!r} after epoch {row['epoch']}"
            yield f"{told}: {all_} episodes, {some} that did not start with the goal", run


def _is_whole(numbers: pd.Series) -> pd.Series:
    return (numbers - np.rint(numbers)).abs() < _ROUNDING  # not where it is NaN


def own_numbers(runs: Submission, _: Reference) -> Iterator[Fault]:
    """No two runs of a task have the same progress: a copy with another seed in its config is no second run."""
    first: dict[tuple[str, bytes], str] = {}
    for run, rows in runs.progress.items():
        names = [name for name in rows if name not in IDENTITY and not name.startswith("seconds")]
        key = runs.configs[run]["task"], rows[names].to_numpy(float).tobytes()
        if key in first:
            yield f"the same progress as {first[key]}", run
        first.setdefault(key, run)
