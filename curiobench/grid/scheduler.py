"""Runs the cells of a grid, several at a time, until each is finished, broken or in conflict."""

import signal
import time
from collections import deque
from collections.abc import Sequence

from curiobench.errors import StopRequest
from curiobench.files import size_of
from curiobench.grid.cells import Cell
from curiobench.grid.disk import State
from curiobench.grid.launcher import LOST, Launcher, tail
from curiobench.grid.overview import PlainGridView
from curiobench.grid.status import OPEN, Status
from curiobench.run_folder import is_locked

_TAKEN = "is already running"
"""Part of the message of `train` if another process uses the folder."""


class Scheduler:
    """The loop of a grid. It reads a cell's folder before each start, because other grids may work there."""

    def __init__(
        self, cells: Sequence[Cell], launcher: Launcher, retries: int, view: PlainGridView, stop: StopRequest,
        poll: float = 0.5, elsewhere_poll: float = 5.0,
    ) -> None:  # fmt: skip
        """
        Args:
            cells: to finish, in this order.
            launcher: starts their processes.
            retries: how often a broken cell is tried again.
            view: shows what happens.
            stop: counts the requests to end.
            poll: seconds between two polls of the processes; a cell takes minutes to days.
            elsewhere_poll: seconds between two readings of the cells of other processes.
        """
        self.statuses = [Status(cell) for cell in cells]
        self._launcher, self._retries, self._view, self._stop = launcher, retries, view, stop
        self._poll, self._elsewhere_poll = poll, elsewhere_poll
        self._queue: deque[Status] = deque()
        self._looked = 0.0
        self._signals_passed_on = 0

    def run(self) -> None:
        """Train until no cell is left, or until all cells have ended after a stop request."""
        self._queue.extend(filter(self._is_waiting, self.statuses))
        try:
            while self._running() or (not self._stop.count and any(s.state in OPEN for s in self.statuses)):
                self._pass_signals_on()
                if not self._stop.count:
                    self._look_elsewhere()
                    self._start_waiting()
                self._collect_ended()
                self._view.show(self.statuses, self._launcher.slots())
                time.sleep(self._poll)
        finally:
            self._end_all()

    def _running(self) -> list[Status]:
        return [status for status in self.statuses if status.job]

    def _is_waiting(self, status: Status) -> bool:
        """Read the state of a cell from its folder; whether it is to be trained."""
        if status.refresh() is State.CONFLICT:
            self._view.event(f"{status.cell.folder}: left alone: {status.reason}")
        return status.state is State.WAITING

    def _look_elsewhere(self) -> None:
        """Find cells that another process has taken, finished or left."""
        if time.monotonic() - self._looked < self._elsewhere_poll:
            return
        self._looked = time.monotonic()
        for status in self.statuses:
            if status.state is State.WAITING and is_locked(status.cell.path):
                self._queue.remove(status)
            elif status.state is not State.ELSEWHERE:
                continue
            if self._is_waiting(status):
                self._queue.append(status)

    def _start_waiting(self) -> None:
        while self._queue and len(self._running()) < self._launcher.slots():
            status = self._queue.popleft()
            if not self._is_waiting(status):
                continue
            start = size_of(status.cell.log)
            try:
                job = self._launcher.start(status.cell.arguments, status.cell.log)
            except OSError as error:
                self._failed(status, f"cannot be started: {error}", [])
                continue
            status.begins(job, start)
            self._view.started(status)

    def _collect_ended(self) -> None:
        for status in self._running():
            status.read_progress()
            if (code := status.job.poll()) is not None:
                status.job = None
                self._ended(status, code)

    def _ended(self, status: Status, code: int) -> None:
        """Set the state of a cell whose process has ended from its folder, and queue it if it is to be tried again."""
        lines = tail(status.cell.log, status.log_start)
        if code == LOST and not self._stop.count:
            self._view.event(f"{status.cell.folder}: {_cause(code)}")
        if not self._is_waiting(status):
            self._view.ended(status)
        elif self._stop.count:
            status.state = State.STOPPED
            self._view.ended(status)
        elif code == 2 and lines and _TAKEN in lines[-1]:
            self._queue.append(status)  # another process was first, and has ended since
        elif code == LOST and status.progress.epoch > status.epoch_at_start:
            self._queue.appendleft(status)
        else:
            self._failed(status, _cause(code), lines)

    def _failed(self, status: Status, cause: str, lines: Sequence[str]) -> None:
        status.failures += 1
        again = status.failures <= self._retries
        status.state = State.WAITING if again else State.BROKEN
        status.reason = f"{cause}: {lines[-1]}" if lines else cause
        if again:
            self._queue.append(status)
        what = "to be tried again" if again else f"broken after {status.failures} attempts"
        self._view.event("\n".join([f"{status.cell.folder}: {cause}; {what}", *(f"    {line}" for line in lines)]))

    def _pass_signals_on(self) -> None:
        """Ask every cell once to end after a checkpoint; at the second signal, end all at once."""
        count = min(self._stop.count, 2)
        if count == self._signals_passed_on:
            return
        self._signals_passed_on = count
        running = self._running()
        if count == 1:
            self._view.event(f"stopping after checkpoints: {len(running)} running; again to stop at once")
        for status in running:
            if count == 1:
                status.job.signal(self._stop.number)
            else:
                status.job.kill()

    def _end_all(self) -> None:
        """End all cells, also when this process fails."""
        running = self._running()
        for status in running:
            status.job.signal(signal.SIGTERM)
        while running and any(status.job.poll() is None for status in running):
            time.sleep(self._poll)


def _cause(code: int) -> str:
    if code == LOST:
        return "its worker went away"
    if code < 0:
        return f"ended by signal {-code} ({signal.strsignal(-code)})"
    return f"exit code {code}"
