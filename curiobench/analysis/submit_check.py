"""`curiobench submit-check`: whether somebody's runs can stand beside the published ones, a line a property.

Each property is a function of a submission and a reference, in submission_rows.py and submission_options.py, that gives
the faults it finds or raises `Skipped`. They do not lean on each other: runs that break one rule fail one line. What
cannot be read at all fails the first, and is not examined further.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from curiobench.analysis import submission_options, submission_rows
from curiobench.analysis.submission import Fault, Reference, Skipped, Submission, read_submission, reference
from curiobench.findings import Finding
from curiobench.protocol import MIN_SEEDS

_FAULTS_TOLD = 10
"""Different faults of one property that are told; the others are counted."""
_RUNS_NAMED = 3
"""Runs that are named of those with the same fault; the others are counted."""


@dataclass(frozen=True)
class Rule:
    """A property of submissions."""

    property: str
    """What holds of a good one."""
    faults: Callable[[Submission, Reference], Iterable[Fault]]
    """Finds what does not."""
    verdict: str = "FAIL"
    """What a fault comes to: FAIL or warn."""


def whole(runs: Submission, _: Reference) -> Iterator[Fault]:
    """Runs that are whole and consistent, all of them; reading them has found what is not."""
    yield from ((fault, "") for fault in runs.results.faults)
    if runs.results.runs.empty and not runs.results.faults:
        yield "there is no run", ""


RULES = (
    Rule("every folder holds one whole run", whole),
    Rule("version of the tasks", submission_options.task_version),
    Rule("seed of the test episodes", submission_options.evaluation_seed),
    Rule("starts of the test episodes", submission_rows.starts),
    Rule("test episodes of a goal", submission_rows.episodes),
    Rule("goals", submission_rows.goals),
    Rule("evaluations when they are due", submission_rows.schedule),
    Rule("options, apart from the method's own", submission_options.options),
    Rule("steps and updates as the options say", submission_rows.amounts),
    Rule("success in whole episodes", submission_rows.counts),
    Rule(f"{MIN_SEEDS} seeds or more of each method", submission_options.seeds),
    Rule("numbers of its own in every run", submission_rows.own_numbers),
    Rule("digest of a method from outside", submission_options.digests),
    Rule("unaltered code", submission_options.unaltered),
    Rule("commit on record", submission_options.commit_known, "warn"),
    Rule("task and robot are the reference's", submission_options.beside, "warn"),
    Rule("versions are the reference's", submission_options.software, "warn"),
    Rule("device and threads are the reference's", submission_options.last_bits, "warn"),
)
"""In the order in which they are told."""


def submit_check(paths: Sequence[Path], against: str | None = None) -> tuple[str, list[Finding]]:
    """Examine runs.

    Args:
        paths: run folders, folders of run folders (such as a grid's), published sets.
        against: name or path of the published set that is the reference, or "presets"; None for the newest set that
            comes with this package, or the presets where there is none.

    Returns:
        A line that says what is compared with what, and a finding a property.

    Raises:
        ValueError: there is no such set.
    """
    compared, runs = reference(against), read_submission(paths)
    methods = ", ".join(dict.fromkeys(runs.results.runs["method"])) or "no method"
    number = f"{len(runs.records)} run{'s' * (len(runs.records) != 1)}"
    return f"{number} of {methods}, compared with {compared.name}", examine(runs, compared)


def examine(runs: Submission, against: Reference) -> list[Finding]:
    """Try every property; where there is no run, all but the first are skipped."""
    first, *others = RULES
    found = [finding(first, runs, against)]
    if runs.results.runs.empty:
        return found + [Finding(rule.property, "skip", "there is no run to examine") for rule in others]
    return found + [finding(rule, runs, against) for rule in others]


def finding(rule: Rule, runs: Submission, against: Reference) -> Finding:
    """What one property comes to; runs with the same fault are named together."""
    where: dict[str, list[str]] = {}
    try:
        for fault, run in rule.faults(runs, against):
            where.setdefault(fault, []).append(run)
    except Skipped as reason:
        return Finding(rule.property, "skip", str(reason))
    told = [fault + _named(names) for fault, names in where.items()]
    if len(told) > _FAULTS_TOLD:
        told[_FAULTS_TOLD:] = [f"and {len(told) - _FAULTS_TOLD} more"]
    return Finding(rule.property, rule.verdict if told else "pass", "; ".join(told))


def _named(runs: Sequence[str]) -> str:
    """The runs behind a fault, in brackets."""
    names = list(dict.fromkeys(filter(None, runs)))
    if not names:
        return ""
    more = f" and {len(names) - _RUNS_NAMED} more" if len(names) > _RUNS_NAMED else ""
    return f" ({', '.join(names[:_RUNS_NAMED])}{more})"
