"""What a set of runs is and what it can show, in a few sentences made from the data."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from curiobench.analysis.options import PAPER_STEPS, cautions, millions, scale_of
from curiobench.analysis.report_cells import Cell, cells_of, count, listed, runs_of
from curiobench.analysis.report_goals import last_evaluations
from curiobench.analysis.statistics import ENOUGH_SEEDS, seed_warnings

if TYPE_CHECKING:
    import pandas as pd

    from curiobench.analysis.frames import Results

FAR_BELOW = 0.5
"""Share of the paper's steps below which the scale of runs is warned of."""
MOST_NAMES = 3
"""Names in a sentence, before it only counts."""


@dataclass(frozen=True)
class Summary:
    """The beginning of a report."""

    sentences: tuple[str, ...]
    """What was run and what came of it."""
    warnings: tuple[str, ...]
    """Why the numbers may show less than they seem to; lines without a full stop."""


def summary(results: "Results") -> Summary:
    """Sum up runs, of which there is at least one."""
    tasks = [(str(task), runs) for task, runs in results.runs.groupby("task", observed=True)]
    sentences = [part for task, runs in tasks for part in (_what(task, runs), _scale(runs))]
    sentences += [_when(results.runs), *_outcomes(results)]
    return Summary(tuple(sentences), tuple(_warnings(results)))


def title_of(results: "Results") -> str:
    """What a report is called unless its author says otherwise."""
    return f"Curiosity methods on {listed(sorted(map(str, results.runs['task'].unique())))}"


def _what(task: str, runs: "pd.DataFrame") -> str:
    methods, cells = runs["method"].nunique(), cells_of(runs)
    variants = f" in {len(cells)} variants" if len(cells) > methods else ""
    complete = int(runs["complete"].sum())
    kind = "all complete" if complete == len(runs) else f"{complete} of them complete"
    total = f"{count(len(runs), 'run')}, {kind}" if len(runs) > 1 else f"1 run, {'' if complete else 'not '}complete"
    return f"{task}: {count(methods, 'method')}{variants} × {_seeds(runs)}, {total}."


def _seeds(runs: "pd.DataFrame") -> str:
    sizes = _seeds_of_cells(runs).values()
    low, high = min(sizes), max(sizes)
    return count(low, "seed") if low == high else f"{low} to {high} seeds"


def _seeds_of_cells(runs: "pd.DataFrame") -> dict[Cell, int]:
    return {cell: int(runs_of(runs, cell)["seed"].nunique()) for cell in cells_of(runs)}


def _scale(runs: "pd.DataFrame") -> str:
    text = scale_of(runs)
    return f"{text[0].upper()}{text[1:]}."


def _when(runs: "pd.DataFrame") -> str:
    begun = sorted(filter(None, _texts(runs["created"])))
    ended = sorted(filter(None, _texts(runs["finished"]))) or begun
    machines = sorted(filter(None, set(_texts(runs["machine"]))))
    parts = []
    if begun:
        first, last = begun[0][:10], max(begun[-1][:10], ended[-1][:10])
        parts.append(f"run on {first}" if first == last else f"run from {first} to {last}")
    if machines:
        parts.append(f"on {listed(machines) if len(machines) <= MOST_NAMES else count(len(machines), 'machine')}")
    hours = runs["hours"].sum()
    parts.append(f"in {f'{hours:,.1f} hours' if hours >= 1 else count(round(60 * hours), 'minute')} of work")
    text = " ".join(parts)
    return f"{text[0].upper()}{text[1:]}."


def _texts(column: "pd.Series") -> list[str]:
    return [str(value) for value in column.dropna()]


def _outcomes(results: "Results") -> list[str]:
    """For every task which methods have learned most goals, and fewest."""
    rows = last_evaluations(results)
    learned = rows.groupby(["task", "method", "variant", "run"])["learned"].sum()
    means = learned.groupby(["task", "method", "variant"]).mean()
    found = []
    for task, of_task in rows.groupby("task"):
        seeds = _seeds_of_cells(results.runs[results.runs["task"] == task]).values()
        average = " on average over seeds" if max(seeds) > 1 else ""
        by_cell = {cell: float(means.loc[tuple(cell)]) for cell in cells_of(of_task)}
        found.append(_outcome(str(task), by_cell, of_task["bits"].nunique(), average))
        if len(by_cell) > 1 and min(seeds) < ENOUGH_SEEDS:
            found.append("So few seeds do not rank them.")
    return found


def _outcome(task: str, means: dict[Cell, float], goals: int, average: str) -> str:
    most, fewest = max(means.values()), min(means.values())
    if len(means) == 1:
        return f"On {task} {next(iter(means)).label} has learned {most:.3g} of {count(goals, 'goal')}{average}."
    if most == fewest:
        return f"On {task} every method has learned {most:.3g} of {count(goals, 'goal')}{average}."
    leaders, others = ([cell.label for cell, mean in means.items() if mean == end] for end in (most, fewest))
    return (
        f"On {task} most goals{average} were learned by {_few(leaders)} ({most:.3g} of {goals}), "
        f"fewest by {_few(others)} ({fewest:.3g})."
    )


def _few(names: list[str]) -> str:
    return listed(names) if len(names) <= MOST_NAMES else f"{len(names)} methods"


def _too_few(runs: "pd.DataFrame") -> list[str]:
    """Which methods have too few seeds; of which task, if that is not the same everywhere."""
    by_task = {}
    for task, of_task in runs.groupby("task", observed=True):
        by_task[str(task)] = seed_warnings([(cell.label, seeds) for cell, seeds in _seeds_of_cells(of_task).items()])
    first = next(iter(by_task.values()))
    if all(lines == first for lines in by_task.values()):
        return first
    return [f"{task}: {line}" for task, lines in by_task.items() for line in lines]


def _warnings(results: "Results") -> list[str]:
    sizes = _seeds_of_cells(results.runs).values()
    found = _too_few(results.runs)
    if len(set(sizes)) > 1:
        found.append(f"methods have {min(sizes)} to {max(sizes)} seeds, so that their intervals are not equally wide")
    most = results.runs["steps"].max()
    if most < FAR_BELOW * PAPER_STEPS:
        found.append(
            f"the runs are far below the paper's scale, {millions(most)} steps at most, which is "
            f"{100 * most / PAPER_STEPS:.2g} % of the paper's {millions(PAPER_STEPS)}: longer runs may rank otherwise"
        )
    return found + cautions(results.runs)
