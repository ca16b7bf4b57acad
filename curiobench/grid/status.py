"""State of a cell in a running grid, and estimates of the time that is left."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean

from curiobench.files import size_of
from curiobench.grid.cells import Cell
from curiobench.grid.disk import Progress, State, cell_state, read_progress
from curiobench.grid.launcher import Job

OPEN = (State.WAITING, State.RUNNING, State.ELSEWHERE, State.STOPPED)
"""States of cells that are still to be finished, here or by another grid."""


@dataclass(eq=False)
class Status:
    """State of a cell, and the process that trains it if this grid does."""

    cell: Cell
    state: State = State.WAITING
    reason: str = ""
    """Why it is broken or in conflict."""
    failures: int = 0
    """How often its process has failed."""
    job: Job | None = None
    log_start: int = 0
    """Bytes in the log when the process was started."""
    epoch_at_start: int = 0
    """Epochs completed when the process was started."""
    progress: Progress = field(default_factory=Progress)
    """Progress of the run."""

    def read_progress(self) -> None:
        """Read the progress from the folder."""
        self.progress = read_progress(self.cell.path, self.progress)

    def refresh(self) -> State:
        """Read the state from the folder; only for a cell that this grid does not run now."""
        self.state, self.reason = cell_state(self.cell)
        self.read_progress()
        return self.state

    def begins(self, job: Job, log_start: int) -> None:
        """Note that a process of this grid trains the cell now."""
        self.job, self.log_start, self.state, self.reason = job, log_start, State.RUNNING, ""
        self.read_progress()
        self.epoch_at_start = self.progress.epoch

    @property
    def has_begun(self) -> bool:
        """Whether its process runs and is not waiting for a place in a cluster."""
        return self.job is not None and size_of(self.cell.log) > self.log_start


Paces = Mapping[object, float]
"""Mean seconds per epoch, by the shared properties of cells in `_ALIKE`."""

_ALIKE: Sequence[Callable[[Cell], object]] = (
    lambda cell: (cell.config.task, cell.method, cell.variant),
    lambda cell: (cell.config.task, cell.variant),
    lambda cell: cell.config.task,
)
"""Shared properties of similar cells, the most similar first."""


def paces(statuses: Iterable[Status]) -> Paces:
    """How fast cells have been so far, for those that have not begun."""
    found: dict[object, list[float]] = {}
    for status in statuses:
        if status.progress.epoch:
            for alike in _ALIKE:
                found.setdefault(alike(status.cell), []).append(status.progress.seconds / status.progress.epoch)
    return {key: fmean(values) for key, values in found.items()}


def seconds_left(status: Status, paces: Paces, now: float) -> float | None:
    """Time that a cell still needs on one core; None where nothing comparable has completed an epoch.

    Args:
        status: of the cell.
        paces: of all cells; one that has not begun is assumed to be as fast as the most similar ones.
        now: seconds since 1970.
    """
    epochs, progress = status.cell.config.epochs, status.progress
    if progress.epoch:
        pace = progress.seconds / progress.epoch
        running = status.state in (State.RUNNING, State.ELSEWHERE)
        # what is done of the present epoch; longer ago than that, the row is from before an interruption
        done = min(max(0.0, now - progress.written), pace) if running else 0.0
        return max(0.0, (epochs - progress.epoch) * pace - done)
    known = (paces[key] for alike in _ALIKE if (key := alike(status.cell)) in paces)
    pace = next(known, None)
    return None if pace is None else epochs * pace


def grid_seconds_left(statuses: Sequence[Status], slots: int, now: float) -> float | None:
    """Time until the last cell is finished, `slots` at a time; None where a cell's time is not known."""
    known = paces(statuses)
    left = {status: seconds_left(status, known, now) for status in statuses if status.state in OPEN}
    if not left or None in left.values():
        return None
    ours = sum(seconds for status, seconds in left.items() if status.state is not State.ELSEWHERE)
    return max(max(left.values()), ours / max(1, slots))
