"""Cells as processes of this machine."""

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from curiobench.grid import launcher

_TETHER = Path(__file__).with_name("tether.py")


class LocalJob:
    """A process in a session of its own: Ctrl-C in the terminal reaches the grid alone, which passes it on."""

    def __init__(self, command: Sequence[str], log: Path, folder: Path | None = None) -> None:
        """Starts the command in a working folder, this process' own if None; output goes to the log. Raises OSError."""
        with launcher.open_log(log, command) as file:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", str(_TETHER), str(os.getpid()), *command],
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                cwd=folder,
                env=launcher.environment(os.environ),
                start_new_session=True,
            )

    def poll(self) -> int | None:
        """Exit code, or None."""
        return self._process.poll()

    def signal(self, number: int) -> None:
        """Pass a signal on."""
        self._process.send_signal(number)

    def kill(self) -> None:
        """End the whole session at once, and wait for the process."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()


class LocalLauncher:
    """Starts processes, as many at a time as there are jobs."""

    def __init__(self, jobs: int, program: Sequence[str] = launcher.PROGRAM) -> None:
        """
        Args:
            jobs: processes at a time.
            program: what Python runs, before `train` and its arguments.
        """
        self._jobs, self._program = jobs, program

    def slots(self) -> int:
        """Processes at a time."""
        return self._jobs

    def start(self, arguments: Sequence[str], log: Path) -> LocalJob:
        """Start a process."""
        return LocalJob([sys.executable, *self._program, "train", *arguments], log)

    def close(self) -> None:
        """Nothing to give back."""


def physical_cores() -> int:
    """Physical cores that this process may use; threads of one core count once, they would share it."""
    if not hasattr(os, "sched_getaffinity"):
        return os.cpu_count() or 1
    cores = set()
    for cpu in os.sched_getaffinity(0):
        topology = Path(f"/sys/devices/system/cpu/cpu{cpu}/topology")
        try:
            cores.add(tuple((topology / name).read_text() for name in ("physical_package_id", "core_id")))
        except OSError:
            cores.add((str(cpu),))
    return len(cores)
