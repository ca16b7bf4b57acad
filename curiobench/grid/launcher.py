"""How a cell's training process is started and ended: the interface, and processes of this machine."""

import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from curiobench.files import now, utf8
from curiobench.workers import quota

PROGRAM = ("-P", "-m", "curiobench")
"""What Python runs, before `train` and its arguments. With -P, files of the working folder take no module's place."""

ONE_THREAD = {
    name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
} | {"PYTHONUNBUFFERED": "1"}
"""Environment of a cell: libraries otherwise start a thread a core in every one of them."""

_POLL_SECONDS = 0.2
"""Interval at which a worker polls its training process."""

_TETHER = Path(__file__).with_name("tether.py")

LOST = 256
"""Exit code, beyond those of processes, of a cell whose machine or worker went away."""


class Job(Protocol):
    """A cell's training process."""

    def poll(self) -> int | None:
        """Its exit code, -N if signal N ended it, `LOST`; None while it runs."""

    def signal(self, number: int) -> None:
        """Ask it to end after a checkpoint, by SIGINT or SIGTERM; called once."""

    def kill(self) -> None:
        """Kill it."""


class Launcher(Protocol):
    """Starts jobs."""

    def slots(self) -> int:
        """How many jobs may run at a time."""

    def start(self, arguments: Sequence[str], log: Path) -> Job:
        """Start `curiobench train` with its output appended to a file; raises OSError where that is impossible."""

    def close(self) -> None:
        """Release resources; every job has ended."""


def log_failure(path: Path, reason: str) -> None:
    """Write why a cell cannot be started to its log, if that can be written."""
    with suppress(OSError), open(path, "a", encoding="utf-8") as log:
        log.write(f"curiobench: {reason}\n")


def tail(path: Path, start: int, lines: int = 6) -> list[str]:
    """The last lines of a log that are not empty.

    Args:
        path: of the log.
        start: byte to begin at; the line that `LocalJob` writes there is left out.
        lines: how many at most.
    """
    try:
        with open(path, "rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(start, size - 20_000))
            text = file.read().decode(errors="replace")
    except OSError:
        return []
    found = [line.rstrip() for line in text.splitlines() if line.strip() and not line.startswith("--- ")]
    return found[-lines:]


class LocalJob(Job):
    """A process in a session of its own: Ctrl-C in the terminal reaches the grid alone, which passes it on."""

    def __init__(self, command: Sequence[str], log: Path, folder: Path | None = None) -> None:
        """Starts the command in a working folder, this process' own if None; output goes to the log. Raises OSError."""
        with open(log, "ab", buffering=0) as file:  # two processes may append
            file.write(utf8(f"--- {now()} {os.uname().nodename}: {shlex.join(command)}\n"))
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", str(_TETHER), str(os.getpid()), *command],
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                cwd=folder,
                env=os.environ | ONE_THREAD,
                start_new_session=True,
            )

    def poll(self) -> int | None:
        return self._process.poll()

    def signal(self, number: int) -> None:
        self._process.send_signal(number)

    def kill(self) -> None:
        """Kill the session, and wait for the process."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()


class LocalLauncher(Launcher):
    """Starts processes, as many at a time as there are jobs."""

    def __init__(self, jobs: int, program: Sequence[str] = PROGRAM) -> None:
        """
        Args:
            jobs: processes at a time.
            program: what Python runs, before `train` and its arguments.
        """
        self._jobs, self._program = jobs, program

    def slots(self) -> int:
        return self._jobs

    def start(self, arguments: Sequence[str], log: Path) -> LocalJob:
        return LocalJob([sys.executable, *self._program, "train", *arguments], log)


def train_in_worker(
    program: Sequence[str], arguments: Sequence[str], log: str, folder: str, signals: Sequence[int] = (signal.SIGINT,)
) -> int:
    """Train a cell on a machine of a cluster, from a process that the cluster started.

    Args:
        program: what that machine's Python runs, before `train` and its arguments.
        arguments: of `curiobench train`.
        log: path to append its output to.
        folder: working folder, used where it exists.
        signals: by which the cluster asks this process to end. The first is passed on, as SIGINT.

    Returns the exit code of the training process, which gets SIGTERM when this process dies.
    """
    command = [sys.executable, *program, "train", *arguments]
    requests: list[int] = []
    asked = False
    # not as an exception, which could lose the process in the midst of being started
    before = {number: signal.signal(number, lambda number, _: requests.append(number)) for number in signals}
    try:
        job = LocalJob(command, Path(log), Path(folder) if os.path.isdir(folder) else None)
        while (code := job.poll()) is None:
            if requests and not asked:
                job.signal(signal.SIGINT)  # a second SIGTERM beside the cluster's own would end it at once
                asked = True
            time.sleep(_POLL_SECONDS)
        return code
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def physical_cores() -> int:
    """Physical cores that this process may use; threads of one core count once, they would share it."""
    if not hasattr(os, "sched_getaffinity"):
        return min(os.cpu_count() or 1, quota())
    cores = set()
    for cpu in os.sched_getaffinity(0):
        topology = Path(f"/sys/devices/system/cpu/cpu{cpu}/topology")
        try:
            cores.add(tuple((topology / name).read_bytes() for name in ("physical_package_id", "core_id")))
        except OSError:
            cores.add((cpu,))
    return min(len(cores), quota())
