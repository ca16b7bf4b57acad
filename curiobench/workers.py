"""The same work on several cores: processes that are forked, and so have imported everything already."""

import ctypes
import gc
import math
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

Item, Result = TypeVar("Item"), TypeVar("Result")

MOST = 8
"""More processes than this wait for each other's memory."""
_PR_SET_PDEATHSIG = 1  # of Linux's <sys/prctl.h>
_work: tuple[Callable[[Any], Any], Sequence[Any]]
"""In a forked process: what it does, and with which items. They are inherited, and so need not be pickled."""


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
            most, period = map(int, (group / "cpu.max").read_bytes().split())  # "max 100000" is not a number
            limits.append(max(1, math.ceil(most / period)))
        if group == root:
            break
    return min(limits, default=sys.maxsize)


@contextmanager
def no_collection() -> Iterator[None]:
    """Suspend garbage collection, which takes a tenth of the time where many objects are made."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
            gc.collect(0)  # the young objects, which were made in the block


def parallel_map(
    function: Callable[[Item], Result], items: Sequence[Item], processes: int, least: int = 1
) -> list[Result]:
    """`[function(item) for item in items]`, on several processes.

    Args:
        function: gives the same result in any process, one that can be pickled.
        items: what it is called with.
        processes: with 1 nothing is forked, nor where the system cannot fork safely.
        least: items a process for which it is worth forking.

    Returns:
        Results in the order of the items. If a process dies or cannot be started, this process does all the work.

    Raises:
        Exception: what the function raised.
    """
    # elsewhere forking is not safe, and a daemon may have no children
    may_fork = sys.platform == "linux" and not multiprocessing.current_process().daemon
    processes = min(processes, len(items) // least) if may_fork else 1
    if processes > 1:
        others = set(multiprocessing.active_children())
        fork = multiprocessing.get_context("fork")
        try:
            with ProcessPoolExecutor(processes, fork, _begin, (function, items, os.getpid())) as pool:
                return list(pool.map(_do, range(len(items))))
        except (BrokenProcessPool, OSError):
            for child in set(multiprocessing.active_children()) - others:  # if only some could be started
                child.kill()
                child.join()
    return [function(item) for item in items]


def _begin(function: Callable[[Any], Any], items: Sequence[Any], parent: int) -> None:
    """Prepare a forked process, which ends with its parent, however that ends."""
    global _work
    _work = function, items
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the parent too
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it ended before
        os._exit(1)


def _do(position: int) -> Any:
    function, items = _work
    return function(items[position])
