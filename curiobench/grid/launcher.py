"""How a cell's training process is started and ended. The grid is the same whatever launches its cells."""

import os
import shlex
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO, Protocol

PROGRAM = ("-m", "curiobench")
"""What the Python of the machine runs, before `train` and its arguments."""

ONE_THREAD = {
    name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
} | {"PYTHONUNBUFFERED": "1"}
"""Environment of a cell: libraries otherwise start a thread a core in every one of them."""

LOST = 256
"""Exit code, beyond those of processes, of a cell whose machine or worker went away."""


class Job(Protocol):
    """A cell's training process."""

    def poll(self) -> int | None:
        """Its exit code, -N if signal N ended it, `LOST`; None while it runs."""

    def signal(self, number: int) -> None:
        """Ask it to end after a checkpoint, by SIGINT or SIGTERM; called once."""

    def kill(self) -> None:
        """End it at once."""


class Launcher(Protocol):
    """Starts jobs."""

    def slots(self) -> int:
        """How many jobs may run at a time."""

    def start(self, arguments: Sequence[str], log: Path) -> Job:
        """Start `curiobench train` with its output appended to a file; raises OSError where that is impossible."""

    def close(self) -> None:
        """Give back what was taken; every job has ended."""


def open_log(path: Path, command: Sequence[str]) -> BinaryIO:
    """A log to append to, with a line on what begins now. Each write is whole even if two processes append."""
    log = open(path, "ab", buffering=0)  # noqa: SIM115 - the process inherits it
    now = datetime.now(UTC).isoformat(timespec="seconds")
    log.write(f"--- {now} {os.uname().nodename}: {shlex.join(command)}\n".encode())
    return log


def tail(path: Path, start: int, lines: int = 6) -> list[str]:
    """The last lines of a log that are not empty.

    Args:
        path: of the log.
        start: byte to begin at; the line that `open_log` writes there is left out.
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


def size_of(path: Path) -> int:
    """Bytes in a file, 0 where there is none."""
    return path.stat().st_size if path.exists() else 0


def environment(inherited: Mapping[str, str]) -> dict[str, str]:
    """Environment of a cell's process."""
    return {**inherited, **ONE_THREAD}
