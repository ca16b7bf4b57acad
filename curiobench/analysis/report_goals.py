"""Cards of a report: a goal each, with its picture and how often every method reaches it."""

import base64
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from curiobench.analysis.report_cells import Cell, cells_of
from curiobench.tasks.registration import n_blocks_of

if TYPE_CHECKING:
    import pandas as pd

    from curiobench.analysis.frames import Results

MOST_CARDS = 100
"""Goals of the largest task that is shown goal by goal; four blocks have hundreds."""
BLOCKS = (("a", "#a02f2a"), ("b", "#38763f"), ("c", "#345499"))
"""Blocks, and the colours of their fronts in the pictures."""


@dataclass(frozen=True)
class Bar:
    """Final success of a cell on a goal, over its seeds."""

    cell: Cell
    mean: float
    low: float
    """Smallest success among the seeds."""
    high: float
    """Largest success among the seeds."""
    learned: int
    """Seeds that learned the goal."""
    seeds: int


@dataclass(frozen=True)
class Card:
    """A goal."""

    name: str
    layer: int
    """Height of its tallest stack, in blocks."""
    picture: str
    """Data URI of a picture; "" where there is none."""
    bars: tuple[Bar, ...]


@dataclass(frozen=True)
class TaskCards:
    """The goals of a task."""

    task: str
    goals: int
    """Number of goals."""
    cards: tuple[Card, ...]
    """None where there are more than `MOST_CARDS` goals."""

    @property
    def blocks(self) -> tuple[tuple[str, str], ...]:
        """Names and colours of the blocks in the pictures; none where there are no pictures."""
        return BLOCKS[: n_blocks_of(self.task)] if any(card.picture for card in self.cards) else ()


def task_cards(results: "Results") -> list[TaskCards]:
    """The goals of every task, at the last evaluation of each run."""
    final = last_evaluations(results)
    return [_cards_of(str(task), rows) for task, rows in final.groupby("task", observed=True)]


def last_evaluations(results: "Results") -> "pd.DataFrame":
    """Rows of `results.evaluations` that are of their run's last evaluation, text as `str`."""
    rows = results.evaluations
    last = rows.groupby("run", observed=True)["epoch"].transform("max")
    final = rows[rows["epoch"] == last]
    return final.astype({name: str for name in ("run", "task", "method", "variant", "goal", "bits")})


def _cards_of(task: str, rows: "pd.DataFrame") -> TaskCards:
    goals = rows.drop_duplicates("bits")
    if len(goals) > MOST_CARDS:
        return TaskCards(task, len(goals), ())
    bars = {bits: _bars(of_goal) for bits, of_goal in rows.groupby("bits")}
    cards = [
        Card(goal.goal, int(goal.layer), picture(goal.bits), bars[goal.bits]) for goal in goals.itertuples(index=False)
    ]
    return TaskCards(task, len(goals), tuple(cards))


def _bars(rows: "pd.DataFrame") -> tuple[Bar, ...]:
    grouped = rows.groupby(["task", "method", "variant"], observed=True)
    success = grouped["success"].agg(["mean", "min", "max", "size"])
    learned = grouped["learned"].sum()
    found = []
    for cell in cells_of(rows):
        mean, low, high, seeds = success.loc[tuple(cell)]
        found.append(Bar(cell, float(mean), float(low), float(high), int(learned.loc[tuple(cell)]), int(seeds)))
    return tuple(found)


@cache
def picture(bits: str) -> str:
    """Data URI of the picture of a goal, which docs/make_goal_pictures.py has drawn; "" where there is none."""
    if not set(bits) <= {"0", "1"}:
        return ""
    file = files("curiobench.analysis") / "goal_pictures" / f"{bits}.webp"
    return f"data:image/webp;base64,{base64.b64encode(file.read_bytes()).decode()}" if file.is_file() else ""
