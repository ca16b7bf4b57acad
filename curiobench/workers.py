"""The same work on several cores: processes that are forked, and so have imported everything already."""

import gc
import math
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

Item, Result = TypeVar("Item"), TypeVar("Result")

MOST = 8
"""More processes than this wait for each other's memory."""
_TOKEN = 8
"""Bytes of a number in the pipe from which work is taken."""
_TOKENS = 4096 // _TOKEN
"""As many as any pipe holds."""


def cores() -> int:
    """Number of processes for `parallel_map`: the cores that this process may use, at most `MOST`."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(usable, quota(), MOST)


def quota(root: Path = Path("/sys/fs/cgroup"), membership: Path = Path("/proc/self/cgroup")) -> int:
    """Cores that control groups (version 2) leave this process, rounded up; a container's limit is one of these.

    Args:
        root: where control groups are mounted.
        membership: the file that names this process's own.
    """
    lines = membership.read_text(encoding="utf-8").splitlines() if membership.exists() else []
    own = next((line.removeprefix("0::/") for line in lines if line.startswith("0::/")), "")
    limits = []
    for group in (root / own, *(root / own).parents):
        with suppress(OSError, ValueError):
            most, period = map(int, (group / "cpu.max").read_bytes().split())  # "max 100000" is no number
            limits.append(max(1, math.ceil(most / period)))
        if group == root:
            break
    return min(limits, default=sys.maxsize)


@contextmanager
def no_collection() -> Iterator[None]:
    """Without garbage collection, which takes a tenth of the time where many objects are made; then with one."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
            gc.collect(0)  # the young objects, which were made in the block


def parallel_map(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    processes: int,
    least: int = 1,
    meanwhile: Callable[[], object] = lambda: None,
) -> list[Result]:
    """`[function(item) for item in items]`, where each process takes the next item when it is done with one.

    Args:
        function: gives the same result in any process, one that can be pickled.
        items: in the order in which they are taken.
        processes: this one among them. With 1 nothing is forked, nor where the system cannot fork safely.
        least: items a process for which it is worth forking.
        meanwhile: what this process does before it takes an item, while the others have begun.

    Returns:
        Results in the order of the items.

    Raises:
        Exception: what the function raised, of any of the items. Items of a forked process that failed or
            died are done again in this process.
    """
    processes = min(processes, len(items) // least) if _may_fork() else 1
    known: dict[int, Result] = {}
    if processes > 1:
        known = _share(_Work(function, items), processes - 1, meanwhile)
    else:
        meanwhile()
    return [known[i] if i in known else function(item) for i, item in enumerate(items)]


def _may_fork() -> bool:
    """Whether forking is safe here and this process may have children."""
    return sys.platform == "linux" and not multiprocessing.current_process().daemon


def _share(work: "_Work", helpers: int, meanwhile: Callable[[], object]) -> dict[int, Any]:
    """Results by position, as far as they arrived."""
    with ExitStack() as stack:
        stack.callback(work.close)
        started: list[_Helper] = []
        with suppress(OSError):  # no more processes available: the existing ones do the work
            while len(started) < helpers:
                started.append(_Helper(work))
                stack.callback(started[-1].stop)
        meanwhile()
        known = dict(work.results())
        for helper in started:
            known.update(helper.results())
        return known


class _Work:
    """Items that processes take in turn from a pipe. A lock would not be released by a process that is killed."""

    def __init__(self, function: Callable[[Any], Any], items: Sequence[Any]) -> None:
        self._function, self._items = function, items
        self._step = max(1, -(-len(items) // _TOKENS))
        self._queue, end = os.pipe()
        for start in range(0, len(items), self._step):
            os.write(end, start.to_bytes(_TOKEN, "little"))
        os.close(end)

    def results(self) -> Iterator[tuple[int, Any]]:
        """Take items until none is left; gives their positions and results."""
        while token := os.read(self._queue, _TOKEN):
            start = int.from_bytes(token, "little")
            for position in range(start, min(start + self._step, len(self._items))):
                yield position, self._function(self._items[position])

    def close(self) -> None:
        """Close the pipe."""
        os.close(self._queue)


class _Helper:
    """A forked process that takes items, and sends its results when none is left."""

    def __init__(self, work: _Work) -> None:
        """Raises OSError where no process can be started."""
        context = multiprocessing.get_context("fork")
        self._receiver, sender = context.Pipe(duplex=False)
        self._process = context.Process(target=_help, args=(self._receiver, sender, work), daemon=True)
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])  # Ctrl-C reaches this process alone
        try:
            self._process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            sender.close()  # so that the end of the process ends the pipe

    def results(self) -> Iterator[tuple[int, Any]]:
        """Positions and results; fewer where it failed or died."""
        with suppress(Exception):  # a result that cannot be received is computed again
            while True:
                yield self._receiver.recv()

    def stop(self) -> None:
        """Kill it."""
        self._process.kill()
        self._process.join()
        self._receiver.close()


def _help(receiver: Connection, sender: Connection, work: _Work) -> None:
    """What a helper does. It reports no errors: its parent does the same items again, and meets them, too."""
    receiver.close()  # so that sending fails when the other process is gone
    helped = os.getppid()
    done = []
    try:
        for result in work.results():
            done.append(result)
            if os.getppid() != helped:
                os._exit(1)
        for result in done:  # not before: the parent does not receive yet, and sending would block
            sender.send(result)
    except BaseException:
        os._exit(1)
