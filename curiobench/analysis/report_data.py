"""Data for the template of a report: summary sentences, tables, goals, options and runs."""

import base64
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import pandas as pd

from curiobench.analysis.formats import MISSING, number_and_interval
from curiobench.analysis.frames import Results
from curiobench.analysis.samples import Sample, TaskSamples
from curiobench.analysis.statistics import ENOUGH_SEEDS, seed_warnings
from curiobench.analysis.style import count, seeds_in_words
from curiobench.analysis.tables import Column, Estimate, Table, Value
from curiobench.analysis.variants import PAPER_STEPS, RUN_OPTIONS, cautions, configs, hour_digits, millions
from curiobench.options import flatten
from curiobench.tasks.registration import task_spec
from curiobench.versions import PACKAGES

FAR_BELOW = 0.5  # share of the paper's steps below which the scale of runs is warned of
MOST_NAMES = 3  # names in a sentence, before it only counts
MOST_CARDS = 100  # goals of the largest task with a card for each goal; four blocks have hundreds
BLOCKS = (("a", "#a02f2a"), ("b", "#38763f"), ("c", "#345499"))
"""Blocks, and the colours of their fronts in the pictures."""
SOFTWARE_AND_MACHINE = ("curiobench", "git_commit", *PACKAGES[1:], "python", "machine")
"""Columns of runs that are not options, but can affect numbers or costs."""

Names = list[tuple[str, list[str]]]  # samples by name: tasks, and the methods and variants of each


def listed(words: Iterable[object]) -> str:
    """Words as a list in a sentence: "a, b and c"."""
    *first, last = map(str, words)
    return f"{', '.join(first)} and {last}" if first else last


def _few(names: Sequence[str], noun: str) -> str:
    return listed(names) if len(names) <= MOST_NAMES else f"{len(names)} {noun}"


def _capital(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def sentences(results: Results, tasks: Sequence[TaskSamples]) -> list[str]:
    """Sentences on what was run, and on the outcome."""
    what = [part for task in tasks for part in (_what(task), _capital(task.scale))]
    return [*what, _when(results.runs), *(part for task in tasks for part in _outcome(task))]


def _what(task: TaskSamples) -> str:
    runs, methods = task.runs, task.runs["method"].nunique()
    variants = f" in {len(task.samples)} variants" if len(task.samples) > methods else ""
    complete = int(runs["complete"].sum())
    kind = "all complete" if complete == len(runs) else f"{complete} of them complete"
    total = f"{count(len(runs), 'run')}, {kind}" if len(runs) > 1 else f"1 run, {'' if complete else 'not '}complete"
    return f"{task.task}: {count(methods, 'method')}{variants} × {seeds_in_words(task.samples)}, {total}."


def _when(runs: pd.DataFrame) -> str:
    begun, ended, machines = (sorted({*runs[name]} - {""}) for name in ("created", "finished", "machine"))
    parts = []
    if begun:
        first, last = begun[0][:10], max(begun[-1][:10], (ended or begun)[-1][:10])
        parts.append(f"run on {first}" if first == last else f"run from {first} to {last}")
    if machines:
        parts.append(f"on {_few(machines, 'machines')}")
    hours = runs["hours"].sum()
    minutes = count(round(60 * hours), "minute") if hours >= 1 / 60 else "less than a minute"
    parts.append(f"in {f'{hours:,.1f} hours' if hours >= 1 else minutes} of work")
    return _capital(" ".join(parts))


def _outcome(task: TaskSamples) -> list[str]:
    """Sentences on the methods with the most and the fewest learned goals."""
    means = {sample.label: float(sample.last_learned[:, 0].mean()) for sample in task.samples}
    most, fewest = max(means.values()), min(means.values())
    sizes = [sample.n_seeds for sample in task.samples]
    average = " on average over seeds" if max(sizes) > 1 else ""
    if len(means) == 1 or most == fewest:
        who = task.samples[0].label if len(means) == 1 else "every method"
        line = f"On {task.task} {who} has learned {most:.3g} of {count(len(task.goals), 'goal')}{average}."
    else:
        leaders, others = ([label for label, mean in means.items() if mean == end] for end in (most, fewest))
        line = (
            f"On {task.task} most goals{average} were learned by {_few(leaders, 'methods')} "
            f"({most:.3g} of {len(task.goals)}), fewest by {_few(others, 'methods')} ({fewest:.3g})."
        )
    return [line] + ["So few seeds do not rank them."] * (len(means) > 1 and min(sizes) < ENOUGH_SEEDS)


def warnings(results: Results, tasks: Sequence[TaskSamples]) -> list[str]:
    """Warnings about the comparison; lines without a full stop."""
    by_task = {task.task: seed_warnings([(s.label, s.n_seeds) for s in task.samples]) for task in tasks}
    found, *others = by_task.values()
    if any(lines != found for lines in others):
        found = [f"{task}: {line}" for task, lines in by_task.items() for line in lines]
    samples = [sample for task in tasks for sample in task.samples]
    if len({sample.n_seeds for sample in samples}) > 1:
        found.append(f"methods have {seeds_in_words(samples)}, so that their intervals are not equally wide")
    most = results.runs["steps"].max()
    if most < FAR_BELOW * PAPER_STEPS:
        found.append(
            f"the runs are far below the paper's scale, {millions(most)} steps at most, which is "
            f"{100 * most / PAPER_STEPS:.2g} % of the paper's {millions(PAPER_STEPS)}: longer runs may rank otherwise"
        )
    return found + cautions(results.runs)


class Heading(NamedTuple):
    """The head of a column."""

    name: str
    numeric: bool = False  # its values are numbers: the largest come first when it is sorted


class Entry(NamedTuple):
    """A value in a table."""

    text: str
    order: str  # text or number that its column is sorted by; "" comes last
    numeric: bool = False
    interval: str = ""  # ends of the interval around it
    best: bool = False  # its interval lies above all others of its column
    look: str = ""  # CSS of a sample of its method's bars


def table_data(table: Table, elsewhere: Sequence[str], samples: Sequence[Sample]) -> dict[str, Any]:
    """A table of samples for the template, without notes that the page has `elsewhere`."""
    looks = {sample.method: _look(sample) for sample in samples}
    best = {column.key: table.best(column) for column in table.columns}
    rows = [
        [_entry(row.get(column.key), column, best[column.key] == place, looks) for column in table.columns]
        for place, row in enumerate(table.rows)
    ]
    of_columns = zip(table.columns, zip(*rows, strict=True), strict=True)
    return {
        "title": table.title,
        "headings": [Heading(c.heading, all(e.numeric or e.text == MISSING for e in own)) for c, own in of_columns],
        "rows": rows,
        "notes": [note for note in table.notes if note not in elsewhere],
    }


def _entry(value: Value, column: Column, best: bool, looks: Mapping[str, str]) -> Entry:
    if value is None or value != value:
        return Entry(MISSING, "")
    if isinstance(value, str):
        if column.key == "epochs_to_good":
            return Entry(value, value.partition(" ")[0], True)
        return Entry(value, value, look=looks[value] if column.key == "method" else "")
    number = value.value if isinstance(value, Estimate) else value
    text, interval = number_and_interval(value, column.digits)
    return Entry(text, repr(float(number)), True, interval, best)


def _look(sample: Sample) -> str:
    """CSS of a method's bars: filled in its colour, hatched where its line is dashed."""
    style = sample.look
    # a black line could not be seen on a dark page
    colour = "var(--ink)" if style["color"] == "#000000" else style["color"]
    return f"--bar: {colour}" + ("; --gap: 2px" if style["linestyle"] == "--" else "")


def goal_cards(task: TaskSamples) -> dict[str, Any]:
    """The goals of a task with their pictures and each method's success; no cards if there are too many goals."""
    cards = [
        {
            "name": task.goals[goal],
            "layer": int(task.goal_layers[goal]),
            "picture": _goal_picture(task.bits[goal]),
            "bars": [_bar(sample, goal) for sample in task.samples],
        }
        for goal in range(len(task.goals) if len(task.goals) <= MOST_CARDS else 0)
    ]
    blocks = BLOCKS[: task_spec(task.task).n_blocks] if any(card["picture"] for card in cards) else ()
    return {"task": task.task, "goals": len(task.goals), "cards": cards, "blocks": blocks}


def _bar(sample: Sample, goal: int) -> dict[str, Any]:
    """Final success of a sample on a goal: mean, smallest and largest of its seeds, and how many learned the goal."""
    success, learned = sample.goal_success[:, goal], sample.goal_learned[:, goal]
    numbers = {"mean": success.mean(), "low": success.min(), "high": success.max(), "learned": int(learned.sum())}
    return {"label": sample.label, "look": _look(sample), "seeds": sample.n_seeds, **numbers}


@cache
def _goal_picture(bits: str) -> str:
    """Data URI of the picture of a goal, which docs/make_goal_pictures.py has drawn; "" where there is none."""
    if not set(bits) <= {"0", "1"}:
        return ""
    file = files("curiobench.analysis") / "goal_pictures" / f"{bits}.webp"
    return f"data:image/webp;base64,{base64.b64encode(file.read_bytes()).decode()}" if file.is_file() else ""


def option_tables(samples: Sequence[Sample]) -> dict[str, list]:
    """Options, versions and machines: `shared` values, names of `differing` ones, and samples grouped by these.

    Options under `machine`, which affect no number, are left out. Settings of the curiosity methods are separate.
    """
    values = {sample: _values(sample.runs) for sample in samples}
    shared, differing = [], []
    for name in dict.fromkeys(name for own in values.values() for name in own):
        found = {own.get(name, MISSING) for own in values.values()}
        if name in SOFTWARE_AND_MACHINE and len(found) > 1:
            found.discard(MISSING)  # not recorded, which is no difference
        shared.append((name, found.pop())) if len(found) == 1 else differing.append(name)
    settings = {s: _together([own.get("method_config") or {} for own in configs(s.runs)]) for s in samples}
    texts = {s: ", ".join(f"{name} = {value}" for name, value in own.items()) for s, own in settings.items() if own}
    return {
        "shared": shared,
        "differing": differing,
        "groups": _grouped({s: tuple(own.get(name, MISSING) for name in differing) for s, own in values.items()}),
        "settings": _grouped(texts),
    }


def _values(runs: pd.DataFrame) -> dict[str, str]:
    """Every option of the runs of a sample, and what they ran on."""
    apart = (*RUN_OPTIONS, "machine", "method_config")
    found = _together([{name: v for name, v in config.items() if name not in apart} for config in configs(runs)])
    return found | {name: _joined(filter(None, runs[name])) or MISSING for name in SOFTWARE_AND_MACHINE}


def _together(options: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Options by dotted name, with all different values."""
    flat = [flatten(own) for own in options]
    names = dict.fromkeys(name for own in flat for name in own)
    return {name: _joined(own.get(name, MISSING) for own in flat) for name in names}


def _joined(values: Iterable[object]) -> str:
    return " / ".join(dict.fromkeys(map(str, values)))


def _grouped(values: Mapping[Sample, Any]) -> list[tuple[Names, Any]]:
    """Names of samples of equal values, and these."""
    groups: dict[Any, dict[str, list[str]]] = {}
    for sample, value in values.items():
        groups.setdefault(value, {}).setdefault(sample.task, []).append(sample.label)
    return [(list(names.items()), value) for value, names in groups.items()]


_SHOWN: dict[str, tuple[str, Callable[[Any], str] | None]] = {
    "task": ("task", None),
    "method": ("method", None),
    "seed": ("seed", "{:d}".format),
    "epoch": ("epochs", "{:,d}".format),
    "steps": ("steps", "{:,d}".format),
    "hours": ("hours", lambda hours: f"{hours:.{hour_digits(hours)}f}"),
    "peak_memory_mb": ("memory (MB)", "{:,.0f}".format),
}
"""Columns of runs that the list of runs shows, their heads, and how numbers are written."""
RUN_HEADINGS = (Heading("run"), *(Heading(head, write is not None) for head, write in _SHOWN.values()))
_FACTS = ("git_commit", *PACKAGES, "python", "machine", "created", "finished", "preset", "robot", "updates")
"""Columns that are listed below the command of a run, where they are known; some under another name."""
_TITLES = {"git_commit": "git commit", "mujoco": "MuJoCo", "torch": "PyTorch", "numpy": "NumPy", "python": "Python"}
_TITLES |= {"created": "begun"}


def run_rows(samples: Sequence[Sample]) -> list[dict[str, Any]]:
    """Identity, cost and command of each run, for the template; by sample and seed."""
    return [
        _run_row(values | {"method": sample.label})
        for sample in samples
        for values in sample.runs.sort_values(["seed", "run"]).to_dict("records")
    ]


def _run_row(values: dict[str, Any]) -> dict[str, Any]:
    known = values | {"updates": f"{values['updates']:,}"}
    facts = [(_TITLES.get(name, name), known[name]) for name in _FACTS if known[name]]
    if not values["complete"]:
        facts.insert(0, ("state", f"not finished: {values['epoch']} of {values['epochs']} epochs"))
    entries = [_run_entry(values[name], write) for name, (_, write) in _SHOWN.items()]
    command = values["command"] or "not recorded"
    return {"name": values["run"], "method": values["method"], "entries": entries, "command": command, "facts": facts}


def _run_entry(value: Any, write: Callable[[Any], str] | None) -> Entry:
    if write is None:
        return Entry(value, value)
    return Entry(MISSING, "", True) if math.isnan(value) else Entry(write(value), repr(float(value)), True)
