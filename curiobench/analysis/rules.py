"""What `curiobench submit-check` asks of runs: the protocol's tests and options, possible numbers, unaltered code.

Each rule gives the faults that it finds in a submission beside a reference, or raises `Skipped`.
"""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from curiobench.analysis.frames import read_results
from curiobench.analysis.rows import IDENTITY
from curiobench.analysis.style import count
from curiobench.analysis.submission import (
    Fault,
    Reference,
    Submission,
    apply_rules,
    first_of,
    goals_in,
    reference,
    rule,
    task_and_robot,
)
from curiobench.check import Finding, Skipped
from curiobench.methods.specs import BUILT_IN, split
from curiobench.protocol import EVALUATION_SEED, MIN_SEEDS
from curiobench.tasks.registration import TASK_VERSION, task_spec

LAST_BITS = frozenset({"device", "torch_threads"})  # options that may change a run's numbers by rounding
SOFTWARE = ("curiobench", "mujoco", "dm_control", "torch")  # packages whose versions are compared
_DIGEST = re.compile(r"[0-9a-f]{64}")
_LARGEST_OPTION = 10**9
_ROUNDING = 1e-6


def submit_check(paths: Sequence[Path], against: str | None = None) -> tuple[str, list[Finding]]:
    """Examine whether runs are comparable with the published ones.

    Args:
        paths: run folders, folders of run folders (such as a grid's), published sets.
        against: name or path of the published set that is the reference, or "presets"; None for the newest set that
            comes with this package, or the presets where there is none. Raises ValueError where there is no such set.

    Returns a line that says what is compared with what, and one finding per property.
    """
    compared, runs = reference(against), Submission(read_results(paths))
    methods = first_of(list(dict.fromkeys(runs.results.runs["method"]))) or "no method"
    return f"{count(len(runs.records), 'run')} of {methods}, compared with {compared.name}", apply_rules(runs, compared)


@rule("every folder holds one whole run")
def complete(runs: Submission, _: Reference) -> Iterator[Fault]:
    """No folder may be missing, damaged, partial, duplicate or foreign."""
    yield from ((fault, "") for fault in runs.results.faults)
    if runs.results.runs.empty and not runs.results.faults:
        yield "there is no run", ""


@rule("version of the tasks")
def task_version(runs: Submission, against: Reference) -> Iterator[Fault]:
    """Runs must have the reference's version. Runs without a record have version 1, the only one of their time."""
    wanted = {v.get("task_version", 1) for _, v in against.runs.versions} if against.runs else {TASK_VERSION}
    for run, versions in runs.versions:
        if (found := versions.get("task_version", 1)) not in wanted:
            yield f"version {found}, not {' or '.join(sorted(map(str, wanted)))}", run


@rule("seed of the test episodes")
def evaluation_seed(runs: Submission, _: Reference) -> Iterator[Fault]:
    """Runs that record the seed must have the protocol's."""
    found = [(run, versions.get("evaluation_seed")) for run, versions in runs.versions]
    if all(seed is None for _, seed in found):
        raise Skipped("made by a curiobench that did not write it down yet")
    yield from ((f"{seed}, not {EVALUATION_SEED}", run) for run, seed in found if seed not in (None, EVALUATION_SEED))


@rule("starts of the test episodes")
def same_starts(runs: Submission, against: Reference) -> Iterator[Fault]:
    """Each goal must hold at the start of as many test episodes as with the protocol's seed."""
    known = False
    for run, rows in runs.evaluations.items():
        kinds = rows[["goal", "bits", "episodes", "episodes_unsatisfied"]].drop_duplicates()
        for goal, bits, total, unsatisfied in kinds.itertuples(index=False, name=None):
            if (counts := against.satisfied_starts(runs.configs[run]["task"], total)) is None:
                continue
            known, found, wanted = True, total - unsatisfied, counts.get(bits, 0)
            if found != wanted:
                yield f"{goal!r} holds at the start of {found} of {total} test episodes, not {wanted}", run
    if not known:
        raise Skipped("the protocol's test starts are not on record for this task and number of episodes")


@rule("test episodes of a goal")
def same_episodes(runs: Submission, _: Reference) -> Iterator[Fault]:
    """Every goal must have as many test episodes as the config says."""
    for run, rows in runs.evaluations.items():
        wanted = runs.configs[run].get("episodes_per_goal")
        wrong = [found for found in rows["episodes"].unique() if found != wanted]
        yield from ((f"{found} episodes of a goal, not {wanted!r}", run) for found in wrong)


@rule("goals")
def same_goals(runs: Submission, against: Reference) -> Iterator[Fault]:
    """Names, bits and layers must be those of all goals of the task, without others."""
    for run, rows in runs.evaluations.items():
        found, wanted = goals_in(rows), against.goals(runs.configs[run]["task"])
        for odd, what in ((found - wanted, "is not one of the task's"), (wanted - found, "is missing")):
            if wanted and odd:
                name, bits, layer = min(odd)
                yield f"goal {name!r}, {bits} in layer {layer}, {what}", run


@rule("evaluations when they are due")
def schedule(runs: Submission, _: Reference) -> Iterator[Fault]:
    """Evaluations must be before training, after every `evaluate_every`-th epoch and after the last."""
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


@rule("options, apart from the method's own")
def same_options(runs: Submission, against: Reference) -> Iterator[Fault]:
    """Options must equal the reference's. `LAST_BITS` have a rule of their own."""
    for run, config in runs.configs.items():
        yield from ((text, run) for name, text in against.unlike(config).items() if name not in LAST_BITS)


@rule("steps and updates as the options say")
def amounts(runs: Submission, _: Reference) -> Iterator[Fault]:
    """Steps and updates must rise by the configured amount every epoch."""
    for run, config in runs.configs.items():
        fault = _no_numbers(config, "cycles", "worlds", "rollouts", "updates")
        if not fault and run not in runs.progress:
            fault = "no rows of progress"
        if not fault:
            steps = config["cycles"] * config["worlds"] * config["rollouts"] * task_spec(config["task"]).horizon
            fault = _off(runs.evaluations[run], "steps", steps) or _off(runs.progress[run], "steps", steps)
            fault = fault or _off(runs.progress[run], "updates", config["cycles"] * config["updates"])
        if fault:
            yield fault, run


def _no_numbers(config: Mapping[str, Any], *names: str) -> str:
    """What is wrong with options that have to be whole numbers; empty if nothing is."""
    wrong = [name for name in names if type(config.get(name)) is not int or not 1 <= config[name] <= _LARGEST_OPTION]
    return f"{wrong[0]} is {config.get(wrong[0])!r:.40}, not a number from 1 to {_LARGEST_OPTION:,}" if wrong else ""


def _off(rows: pd.DataFrame, name: str, per_epoch: int) -> str:
    """Where a counter does not rise by this much every epoch, as text; empty if it does."""
    for wrong in rows[rows[name] != rows["epoch"].astype(float) * per_epoch].head(1).to_dict("records"):
        return f"{wrong[name]} {name} after epoch {wrong['epoch']}, not {wrong['epoch'] * per_epoch}"
    return ""


@rule("success in whole episodes")
def whole_successes(runs: Submission, _: Reference) -> Iterator[Fault]:
    """Success must be a whole number of episodes, also among those whose goal did not hold at the start."""
    for run, rows in runs.evaluations.items():
        satisfied = rows["episodes"] - rows["episodes_unsatisfied"]
        successes = rows["success"] * rows["episodes"]
        earned = (rows["success_unsatisfied"] * rows["episodes_unsatisfied"]).where(rows["episodes_unsatisfied"] > 0, 0)
        sound = (successes - earned).between(-_ROUNDING, satisfied + _ROUNDING)
        for numbers in (successes, earned):
            sound &= (numbers - np.rint(numbers)).abs() < _ROUNDING  # not where it is NaN
        for row in rows[~sound].head(1).to_dict("records"):
            every = f"{row['success']} of {row['episodes']} episodes"
            some = f"{row['success_unsatisfied']} of {row['episodes_unsatisfied']} that did not start with the goal"
            yield f"{row['goal']!r} after epoch {row['epoch']}: {every}, {some}", run


@rule(f"{MIN_SEEDS} seeds or more of each method")
def seeds(runs: Submission, _: Reference) -> Iterator[Fault]:
    """Every method needs this many seeds with the same options."""
    groups = runs.results.runs.groupby(["task", "robot", "method", "variant"], sort=False)["seed"].nunique()
    for names, found in groups[groups < MIN_SEEDS].items():
        yield f"{' '.join(filter(None, names))}: {found} of {MIN_SEEDS}", ""


@rule("numbers of its own in every run")
def own_numbers(runs: Submission, _: Reference) -> Iterator[Fault]:
    """No two runs of a task may have the same progress: a copy with another seed in its config is not a second run."""
    first: dict[tuple[str, bytes], str] = {}
    for run, rows in runs.progress.items():
        names = [name for name in rows if name not in IDENTITY and not name.startswith("seconds")]
        key = runs.configs[run]["task"], rows[names].to_numpy(float).tobytes()
        if first.setdefault(key, run) != run:
            yield f"the same progress as {first[key]}", run


@rule("digest of a method that is not built in")
def digests(runs: Submission, _: Reference) -> Iterator[Fault]:
    """All runs of a method that is not built in must record the SHA-256 of the same file."""
    methods = {run: config["method"] for run, config in runs.configs.items()}
    outside = {run: method for run, method in methods.items() if split(method)[0] not in ("sac", *BUILT_IN)}
    if not outside:
        raise Skipped("all methods come with curiobench")
    found = defaultdict(set)
    for run, versions in runs.versions:
        digest = str(versions.get("method_sha256", ""))
        if run in outside and _DIGEST.fullmatch(digest):
            found[outside[run]].add(digest)
        elif run in outside:
            yield f"no SHA-256 of {outside[run]}'s file is recorded", run
    several = {method: len(files) for method, files in found.items() if len(files) > 1}
    yield from ((f"{n_files} different files define {method}", "") for method, n_files in several.items())


@rule("unaltered code")
def unaltered(runs: Submission, _: Reference) -> Iterator[Fault]:
    """The code must be that of a commit, without changes."""
    for run, versions in runs.versions:
        if (commit := str(versions.get("git_commit", ""))).endswith("-dirty"):
            yield f"made by an altered copy of commit {commit[:12]}", run


@rule("commit on record", "warn")
def commit_known(runs: Submission, _: Reference) -> Iterator[Fault]:
    """The commit should be recorded. A package installed without git has none."""
    for run, versions in runs.versions:
        if not versions.get("git_commit"):
            yield f"only the version is known, {versions.get('curiobench', 'unknown')}", run


@rule("task and robot are the reference's", "warn")
def beside(runs: Submission, against: Reference) -> Iterator[Fault]:
    """The reference should have runs of the task with the robot."""
    published = set(map(task_and_robot, against.published().configs.values()))
    for run, config in runs.configs.items():
        if task_and_robot(config) not in published:
            lacking = f"{against.name} has no {config['task']} with {config['robot']}"
            yield f"{lacking}: options are compared with the preset {config['preset']}", run


@rule("versions are the reference's", "warn")
def software(runs: Submission, against: Reference) -> Iterator[Fault]:
    """Packages that affect numbers should have the reference's versions. Builds, such as +cpu, do not matter."""
    theirs = against.published().results.runs
    for name in SOFTWARE:
        published = set().union(*map(_releases, theirs[name]))
        for run, version in zip(runs.results.runs["run"], runs.results.runs[name], strict=True):
            if not _releases(version) <= published:
                yield f"{name} {version or 'unknown'}, not {' or '.join(sorted(published))}", run


def _releases(versions: str) -> set[str]:
    """Versions, separated by spaces, without their builds; {""} for an unknown one."""
    return {version.partition("+")[0] for version in versions.split() or [""]}


@rule("device and threads are the reference's", "warn")
def last_bits(runs: Submission, against: Reference) -> Iterator[Fault]:
    """The options in `LAST_BITS` should be the reference's."""
    for run, config in runs.configs.items():
        yield from ((text, run) for name, text in against.unlike(config).items() if name in LAST_BITS)
