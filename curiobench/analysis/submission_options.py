"""What `curiobench submit-check` asks of a run's options and software: only what is the method's own may differ."""

import re
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

from curiobench.analysis.frames import METHOD_ORDER
from curiobench.analysis.submission import Fault, Reference, Skipped, Submission
from curiobench.config import PRESETS, preset
from curiobench.methods.specs import canonical, split
from curiobench.protocol import EVALUATION_SEED, MIN_SEEDS
from curiobench.tasks.registration import TASK_VERSION

PERSONAL = frozenset({"method", "method_config", "hybrid", "seed", "machine", "preset", "task", "robot"})
"""Options that may differ: the method's own, and what decides no number or with which runs a run is compared."""
LAST_BITS = frozenset({"device", "torch_threads"})
"""Options that may change the last bits of a run's numbers."""
BUILT_IN = frozenset(split(canonical(method))[0] for method in METHOD_ORDER)
"""Methods that come with this package, without `+hm`."""
SOFTWARE = ("curiobench", "mujoco", "dm_control", "torch")
"""Packages whose other versions call for a warning."""
_DIGEST = re.compile(r"[0-9a-f]{64}")


def options(runs: Submission, against: Reference) -> Iterator[Fault]:
    """Options like those of the reference, but for `PERSONAL` ones and `LAST_BITS`."""
    yield from ((text, run) for name, text, run in _unlike(runs, against) if name not in LAST_BITS)


def last_bits(runs: Submission, against: Reference) -> Iterator[Fault]:
    """Options among `LAST_BITS` like those of the reference."""
    yield from ((text, run) for name, text, run in _unlike(runs, against) if name in LAST_BITS)


def _unlike(runs: Submission, against: Reference) -> Iterator[tuple[str, str, str]]:
    """Name, values and run of each option that differs from the run of the reference that is most alike."""
    for run, config in runs.configs.items():
        alike = _runs_alike(config, against)
        if alike:
            own = _protocol(config)
            found = min((_differences(own, _protocol(other)) for other in alike), key=len)
            yield from ((name, text, run) for name, text in found.items())
        else:
            yield "preset", f"there is no preset {config['preset']!r}, only {', '.join(PRESETS)}", run


def _runs_alike(config: dict[str, Any], against: Reference) -> list[dict[str, Any]]:
    """Options of published runs of the same task and robot; those of the preset where there are none."""
    published = against.runs.configs.values() if against.runs else ()
    found = [other for other in published if (other["task"], other["robot"]) == (config["task"], config["robot"])]
    known = config["preset"] in PRESETS
    return found or ([preset(config["preset"], config["task"]).to_json()] if known else [])


def _protocol(options: dict[str, Any], path: str = "") -> dict[str, Any]:
    """The options that a submission may not change, by dotted name."""
    flat = {}
    for name, value in options.items():
        if isinstance(value, dict) and path + name not in PERSONAL:
            flat |= _protocol(value, f"{path}{name}.")
        elif path + name not in PERSONAL:
            flat[path + name] = value
    return flat


def _differences(own: dict[str, Any], other: dict[str, Any]) -> dict[str, str]:
    """What differs, as "epochs is 10, not 20", by option."""
    unset = object()
    found = {}
    for name in {**other, **own}:
        if name not in other:
            found[name] = f"{name!r:.60} is no option"
        elif (value := own.get(name, unset)) != other[name]:
            found[name] = f"{name} is {'missing' if value is unset else f'{value!r:.60}'}, not {other[name]!r}"
    return found


def task_version(runs: Submission, against: Reference) -> Iterator[Fault]:
    """The tasks' version; runs that do not tell it are of the first, the only one when they were made."""
    wanted = {TASK_VERSION}
    if against.runs:
        wanted = {v.get("task_version", 1) for run in against.runs.records for v in against.runs.versions(run)}
    for run in runs.records:
        for found in {versions.get("task_version", 1) for versions in runs.versions(run)} - wanted:
            yield f"version {found}, not {' or '.join(sorted(map(str, wanted)))}", run


def evaluation_seed(runs: Submission, _: Reference) -> Iterator[Fault]:
    """The seed of the test episodes, where a run tells it."""
    found = [(run, v.get("evaluation_seed")) for run in runs.records for v in runs.versions(run)]
    if not any(seed for _, seed in found):
        raise Skipped("made by a curiobench that did not write it down yet")
    yield from ((f"{seed}, not {EVALUATION_SEED}", run) for run, seed in found if seed not in (None, EVALUATION_SEED))


def seeds(runs: Submission, _: Reference) -> Iterator[Fault]:
    """Seeds enough of each method."""
    cells = runs.results.runs.groupby(["task", "robot", "method", "variant"], sort=False)["seed"].nunique()
    for names, found in cells.items():
        if found < MIN_SEEDS:
            yield f"{' '.join(filter(None, names))}: {found} of {MIN_SEEDS}", ""


def unaltered(runs: Submission, _: Reference) -> Iterator[Fault]:
    """Code as it is in a commit."""
    for run in runs.records:
        for commit in {str(versions.get("git_commit", "")) for versions in runs.versions(run)}:
            if commit.endswith("-dirty"):
                yield f"made by an altered copy of commit {commit[:12]}", run


def commit_known(runs: Submission, _: Reference) -> Iterator[Fault]:
    """A commit that says which code a run was made by; a package installed without git has none."""
    for run in runs.records:
        for versions in runs.versions(run):
            if not versions.get("git_commit"):
                yield f"only the version is known, {versions.get('curiobench', 'unknown')}", run


def digests(runs: Submission, _: Reference) -> Iterator[Fault]:
    """One file of each method from outside, and its digest."""
    outside = {
        run: config["method"] for run, config in runs.configs.items() if split(config["method"])[0] not in BUILT_IN
    }
    if not outside:
        raise Skipped("all methods come with curiobench")
    found = defaultdict(set)
    for run, method in outside.items():
        for digest in (str(versions.get("method_sha256", "")) for versions in runs.versions(run)):
            if _DIGEST.fullmatch(digest):
                found[method].add(digest)
            else:
                yield f"none of {method}", run
    yield from ((f"{len(files)} different files of {method}", "") for method, files in found.items() if len(files) > 1)


def beside(runs: Submission, against: Reference) -> Iterator[Fault]:
    """Runs of the same task and robot in the reference."""
    if against.runs is None:
        raise Skipped("no published set to compare with")
    published = {(config["task"], config["robot"]) for config in against.runs.configs.values()}
    for run, config in runs.configs.items():
        if (config["task"], config["robot"]) not in published:
            told = f"{against.name} has no {config['task']} with {config['robot']}"
            yield f"{told}: options are compared with the preset {config['preset']}", run


def software(runs: Submission, against: Reference) -> Iterator[Fault]:
    """Versions of the packages that decide the numbers, but for the build, such as +cpu."""
    if against.runs is None:
        raise Skipped("no published set to compare with")
    for name in SOFTWARE:
        published = set().union(*map(_releases, against.runs.results.runs[name]))
        for run, version in zip(runs.results.runs["run"], runs.results.runs[name], strict=True):
            if not _releases(version) <= published:
                yield f"{name} {version or 'unknown'}, not {' or '.join(sorted(published))}", run


def _releases(versions: str) -> set[str]:
    """Versions, separated by spaces, without their builds; {""} for an unknown one."""
    return {version.partition("+")[0] for version in versions.split() or [""]}
