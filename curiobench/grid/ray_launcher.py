"""Cells as tasks of a Ray cluster, on a folder that all of its machines share.

A task is a worker process that starts the training process and waits for it. States, logs and retries are the grid's:
a task whose worker or machine dies is not repeated by Ray, but found free in its folder and started again.
"""

import os
import socket
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from curiobench.grid.launcher import LOST, PROGRAM, log_failure, physical_cores, train_in_worker

_OBJECT_STORE_BYTES = 80_000_000
"""Of a cluster that starts for the grid, which keeps nothing there; Ray's default is a third of the memory."""


class RayJob:
    """A cell's task."""

    def __init__(self, ray: ModuleType, task: Any, log: Path) -> None:
        self._ray, self._task, self._log = ray, task, log

    def poll(self) -> int | None:
        """Exit code of the training process, `LOST` if its worker or machine died, None while it runs."""
        ended, _ = self._ray.wait([self._task], timeout=0)
        if not ended:
            return None
        try:
            return self._ray.get(self._task)
        except self._ray.exceptions.RayTaskError as error:
            log_failure(self._log, f"the worker cannot start the cell: {error.cause}")
            return 1
        except self._ray.exceptions.RayError:
            return LOST

    def signal(self, number: int) -> None:
        """Ask it to end after a checkpoint, by SIGINT whatever the number: Ray knows no other."""
        self._ray.cancel(self._task)

    def kill(self) -> None:
        """Kill its worker; the training process gets SIGTERM and ends after a checkpoint."""
        self._ray.cancel(self._task, force=True)


class RayLauncher:
    """Starts tasks of one CPU each, on a running cluster or on one that it starts."""

    def __init__(self, jobs: int | None, address: str | None, program: Sequence[str] = PROGRAM) -> None:
        """
        Args:
            jobs: tasks at a time; as many as the cluster has CPUs if None.
            address: of a cluster that is up; None starts one on this machine, which ends with `close`.
            program: what Python runs, before `train` and its arguments.

        Raises ValueError where Ray is not installed or the cluster cannot be reached.
        """
        self._ray = _connect(jobs, address)
        self._jobs, self._program = jobs, program
        self._train = self._ray.remote(num_cpus=1, max_retries=0)(train_in_worker)

    def slots(self) -> int:
        """Tasks at a time; machines may come and go."""
        cpus = int(self._ray.cluster_resources().get("CPU", 0))
        return cpus if self._jobs is None else min(self._jobs, cpus)

    def start(self, arguments: Sequence[str], log: Path) -> RayJob:
        """Submit a task; it waits in the cluster's queue where others use the CPUs."""
        log = log.resolve()
        task = self._train.remote(list(self._program), list(arguments), str(log), os.getcwd())
        return RayJob(self._ray, task, log)

    def close(self) -> None:
        """Leave the cluster, or stop it if the grid started it."""
        self._ray.shutdown()


def _connect(jobs: int | None, address: str | None) -> ModuleType:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # a cluster started here reports no usage
    try:
        import ray
    except ImportError:
        raise ValueError("--launcher ray needs the extra `ray`: pip install 'curiobench[ray]'") from None
    if address not in (None, "auto"):
        _check_answers(address)
    own = {"num_cpus": jobs or physical_cores(), "include_dashboard": False, "object_store_memory": _OBJECT_STORE_BYTES}
    try:
        ray.init(address or "local", **({} if address else own), log_to_driver=False, logging_level="ERROR")
    except Exception as error:  # Ray raises bare ones, where a node does not start in time
        first_line = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise ValueError(f"no Ray cluster at {address or 'this machine'}: {first_line}") from None
    return ray


def _check_answers(address: str) -> None:
    """Raise ValueError where no server answers at HOST:PORT; Ray itself tries for minutes."""
    host, colon, port = address.rpartition(":")
    if not (host and colon and port.isdecimal()):
        raise ValueError(f"address is {address!r}; expected auto, or a host and port such as 10.0.0.1:6379")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=10).close()
    except (OSError, OverflowError) as error:
        raise ValueError(f"no Ray cluster at {address}: {error}") from None
