"""Output of a running grid: a row per cell on a terminal, otherwise a line per change."""

import time
from collections import Counter
from collections.abc import Sequence
from datetime import datetime

from rich.console import Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from curiobench.display import Terminal, duration
from curiobench.grid.disk import State
from curiobench.grid.status import Paces, Status, grid_seconds_left, paces, seconds_left

REPORT_SECONDS = 300.0
"""Interval between lines about progress if there is no terminal."""

_STYLES = {
    State.RUNNING: "cyan",
    State.BROKEN: "bold red",
    State.CONFLICT: "red",
    State.ELSEWHERE: "magenta",
    State.STOPPED: "yellow",
    State.WAITING: "dim",
    State.FINISHED: "green",
}
"""Colours by state. If a terminal has too few lines for all cells, the first states are shown."""


class PlainGridView:
    """Lines with the time of day, for logs; a line on all cells every few minutes. The scheduler calls it."""

    def __init__(self) -> None:
        self._console = Terminal()
        self._reported = time.monotonic()

    def event(self, text: str) -> None:
        """A message of one line or several."""
        self._console.say(f"{datetime.now():%H:%M:%S} {text}")

    def started(self, status: Status) -> None:
        """Called when a cell's process has been started."""
        self.event(f"{status.cell.folder}: started at epoch {status.progress.epoch + 1} of {status.cell.config.epochs}")

    def ended(self, status: Status) -> None:
        """A cell is finished, stopped, in conflict, or taken by another process."""
        learned = f", {_learned(status)} goals learned" if status.state is State.FINISHED else ""
        self.event(f"{status.cell.folder}: {_phrase(status)}{learned}")

    def show(self, statuses: Sequence[Status], slots: int) -> None:
        """The states of all cells, `slots` of which run at a time; called often."""
        if time.monotonic() - self._reported >= REPORT_SECONDS:
            self._reported = time.monotonic()
            self.event(status_line(statuses, slots))

    def close(self) -> None:
        """Release the terminal."""


class LiveGridView(PlainGridView):
    """A table on the terminal, drawn once a second; messages are printed above it."""

    def __init__(self) -> None:
        super().__init__()
        self._shown: tuple[Sequence[Status], int] | None = None
        self._live = Live(console=self._console, get_renderable=self._draw, refresh_per_second=1)
        self._live.start()

    def started(self, status: Status) -> None:
        """Nothing to print: the table shows it."""

    def ended(self, status: Status) -> None:
        """Nothing to print: the table shows it."""

    def show(self, statuses: Sequence[Status], slots: int) -> None:
        self._shown = statuses, slots

    def close(self) -> None:
        """Draw the last state, which stays on the terminal."""
        self._live.stop()

    def _draw(self) -> Group | str:
        return overview(*self._shown, self._console.height) if self._shown else ""


def overview(statuses: Sequence[Status], slots: int, height: int) -> Group:
    """A row per cell, as many as fit in `height` lines, a count of the rest, and a line on the grid."""
    room = max(1, height - 4)
    shown, rest = list(statuses), []
    if len(statuses) > room:
        order = list(_STYLES)
        by_importance = sorted(statuses, key=lambda status: order.index(status.state))
        shown, rest = by_importance[: room - 1], by_importance[room - 1 :]
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("cell")  # the one that gives way where the terminal is narrow
    for name in ("state", "", "epoch", "learned", "left"):
        table.add_column(name, no_wrap=True, justify="left" if name in ("state", "") else "right")
    known = paces(statuses)
    for status in shown:
        table.add_row(*_cells_of_row(status, known))
    more = [Text(f"… and {len(rest)} more: {_counts(rest)}", style="dim")] if rest else []
    return Group(table, *more, Text(status_line(statuses, slots)))


def _cells_of_row(status: Status, known: Paces) -> list[Text | ProgressBar | str]:
    epoch, epochs = status.progress.epoch, status.cell.config.epochs
    is_open = status.state in (State.RUNNING, State.ELSEWHERE)
    word = "queued" if status.job and not status.has_begun else str(status.state)
    return [
        Text(status.cell.folder, no_wrap=True, overflow="ellipsis"),
        Text(word, style=_STYLES[status.state]),
        ProgressBar(epochs, epoch, width=10),
        f"{epoch}/{epochs}",
        _learned(status),
        duration(seconds_left(status, known, time.time())) if is_open else "",
    ]


def status_line(statuses: Sequence[Status], slots: int) -> str:
    """One line on all cells."""
    finished = sum(status.state is State.FINISHED for status in statuses)
    others = _counts([status for status in statuses if status.state is not State.FINISHED])
    left = grid_seconds_left(statuses, slots, time.time())
    parts = [f"{finished} of {len(statuses)} cells finished", others, f"{duration(left)} left" if left else ""]
    return ", ".join(filter(None, parts))


def _counts(statuses: Sequence[Status]) -> str:
    counts = Counter(status.state for status in statuses)
    return ", ".join(f"{counts[state]} {state}" for state in _STYLES if counts[state])


def _phrase(status: Status) -> str:
    if status.state is State.ELSEWHERE:
        return "runs elsewhere"
    if status.state is State.STOPPED:
        return f"stopped, {status.progress.epoch} of {status.cell.config.epochs} epochs done"
    return str(status.state)


def _learned(status: Status) -> str:
    progress = status.progress
    return "-" if progress.learned is None else f"{progress.learned}/{progress.goals or '?'}"
