"""The same work on several cores: processes that are forked, and so have imported everything already."""

import gc
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any, TypeVar

Item, Result = TypeVar("Item"), TypeVar("Result")

MOST = 8
"""More processes than this wait for each other's memory."""


def cores() -> int:
    """Number of processes for `parallel_map`: the cores that this process may use, at most `MOST`."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(usable, MOST)


@contextmanager
def no_collection() -> Iterator[None]:
    """Without garbage collection, which takes a tenth of the time of work that makes many objects and keeps most."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def parallel_map(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    processes: int,
    least: int = 1,
    meanwhile: Callable[[], object] | None = None,
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
        Exception: what the function raised. Where a forked process failed or died, its items are done here once more.
    """
    processes = min(processes, len(items) // least) if sys.platform == "linux" else 1
    meanwhile = meanwhile or (lambda: None)
    if processes < 2:
        meanwhile()
        return [function(item) for item in items]
    context = multiprocessing.get_context("fork")
    taken = context.Value("l", 0)
    helpers = [_Helper(context, function, items, taken) for _ in range(processes - 1)]
    try:
        meanwhile()
        results = dict(_work(function, items, taken))
        for helper in helpers:
            results.update(helper.results())
    finally:
        for helper in helpers:
            helper.stop()
    return [results[i] if i in results else function(item) for i, item in enumerate(items)]


class _Helper:
    """A forked process that takes items, too, and hands over its results when none is left."""

    def __init__(self, context: Any, function: Callable[[Any], Any], items: Sequence[Any], taken: Any) -> None:
        self._receiver, sender = context.Pipe(duplex=False)
        arguments = (self._receiver, sender, function, items, taken)
        self._process = context.Process(target=_help, args=arguments, daemon=True)
        self._process.start()
        sender.close()  # so that the end of the process ends the pipe

    def results(self) -> Iterator[tuple[int, Any]]:
        """Position and result of what it did; less where it failed."""
        try:
            while True:
                yield self._receiver.recv()
        except EOFError:
            return

    def stop(self) -> None:
        """End it, whatever it is at."""
        self._process.kill()
        self._process.join()
        self._receiver.close()


def _help(
    receiver: Connection, sender: Connection, function: Callable[[Any], Any], items: Sequence[Any], taken: Any
) -> None:
    """What a helper does. It tells nobody of errors: the one it helps does the same once more, and meets them, too."""
    receiver.close()  # so that sending fails when the other process is gone
    helped = os.getppid()
    done = []
    try:
        for result in _work(function, items, taken):
            done.append(result)
            if os.getppid() != helped:
                os._exit(1)
        for result in done:  # not before: nobody receives as yet, and sending would wait
            sender.send(result)
    except BaseException:
        os._exit(1)


def _work(function: Callable[[Any], Any], items: Sequence[Any], taken: Any) -> Iterator[tuple[int, Any]]:
    """Take items until none is left; gives their positions and results."""
    while True:
        with taken.get_lock():
            position = taken.value
            taken.value += 1
        if position >= len(items):
            return
        yield position, function(items[position])
