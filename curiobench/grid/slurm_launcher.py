"""Cells as jobs of SLURM, submitted by submitit, on a folder that all machines share.

The file `CELL.job` beside a cell's log names its job. Jobs outlive a grid that is killed; the next grid reads the file
and waits for the job instead of submitting another.
"""

import os
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from curiobench.grid.launcher import LOST, PROGRAM, Launcher, log_failure, train_in_worker

OPTIONS = (
    "account", "comment", "constraint", "cpus_per_task", "dependency", "exclude", "gpus_per_node", "gres", "mail_type",
    "mail_user", "mem", "mem_per_cpu", "nodelist", "partition", "qos", "signal_delay_s", "time", "wckey",
)  # fmt: skip
"""Options of a job, by their names in submitit, which are sbatch's with _ for -. A cell is one task on one node."""
_JOBS = 100
"""Default number of jobs at a time; clusters limit how many a user may submit."""
_STATE_SECONDS = 30
"""Between two questions to SLURM on the states of all jobs."""
_ENDING = (signal.SIGTERM, signal.SIGUSR2, signal.SIGINT)
"""Signals that SLURM ends jobs with; SIGUSR2 comes `signal_delay_s` before the time is up."""


class SlurmJob:
    """A cell's job, queued or running."""

    def __init__(self, job: Any, record: Path, log: Path) -> None:
        """
        Args:
            job: of submitit.
            record: the file that names it, deleted when it has ended.
            log: the cell's.
        """
        self._job, self._record, self._log = job, record, log

    def poll(self) -> int | None:
        """Exit code of the training process, `LOST` if SLURM ended the job, None while it is queued or runs."""
        if not self._job.done():
            return None
        self._record.unlink(missing_ok=True)
        if not self._job.paths.result_pickle.exists():
            return LOST
        if error := self._job.exception():
            log_failure(self._log, f"the job cannot start the cell: {error}")
            return 1
        code = self._job.result()
        stopped = (128 + signal.SIGINT, 128 + signal.SIGTERM)  # after a checkpoint: time was up, or it was preempted
        return LOST if code in stopped else code

    def signal(self, number: int) -> None:
        """Cancel it: SLURM takes it out of the queue, or asks it to end by SIGTERM and kills it soon after."""
        self._job.cancel(check=False)

    def kill(self) -> None:
        """Cancel it again; what still runs then ends when SLURM kills it."""
        self._job.cancel(check=False)


class SlurmLauncher(Launcher):
    """Submits one job per cell."""

    def __init__(
        self, jobs: int | None, options: Sequence[str], out: Path, program: Sequence[str] = PROGRAM,
        cluster: str = "Slurm",
    ) -> None:  # fmt: skip
        """
        Args:
            jobs: at a time, queued ones counted; `_JOBS` if None.
            options: of each job, as "time=240".
            out: folder of the grid; submitit's own files go to `.slurm` in it.
            program: what Python runs, before `train` and its arguments.
            cluster: name of submitit's executor; "Local" runs jobs on this machine, for tests.

        Raises ValueError where submitit or SLURM is missing or an option is wrong; one line.
        """
        parameters = _parameters(options)
        # otherwise importing submitit resets this process's logging and closes other loggers' streams
        os.environ.setdefault("SUBMITIT_LOG_LEVEL", "NOCONFIG")
        try:
            import submitit
        except ImportError:
            raise ValueError("--launcher slurm needs the extra `slurm`: pip install 'curiobench[slurm]'") from None
        try:
            self._executor = getattr(submitit, f"{cluster}Executor")(folder=out / ".slurm")
        except RuntimeError:
            raise ValueError("--launcher slurm finds no srun here; start it on a machine of the cluster") from None
        # SLURM must not start a job again by itself: the grid does, after it has read the folder
        own = {"job_name": "curiobench", "stderr_to_stdout": True, "additional_parameters": {"no_requeue": True}}
        self._executor.update_parameters(**own, **parameters)
        self._job_class = self._executor.job_class
        self._job_class.watcher = type(self._job_class.watcher)(delay_s=_STATE_SECONDS)
        self._jobs, self._program = jobs or _JOBS, program

    def slots(self) -> int:
        """Jobs at a time."""
        return self._jobs

    def start(self, arguments: Sequence[str], log: Path) -> SlurmJob:
        """Submit a job, or find the one that another grid has left queued or running; raises OSError."""
        record = log.with_suffix(".job")
        if record.exists():
            job = self._job_class(self._executor.folder, record.read_text(encoding="utf-8").strip())
            if not job.done():
                return SlurmJob(job, record, log)
        try:
            job = self._executor.submit(train_in_worker, self._program, arguments, str(log), os.getcwd(), _ENDING)
        except Exception as error:  # submitit raises its own, with all that sbatch said
            raise OSError(" ".join(str(error).split())) from None
        record.write_text(f"{job.job_id}\n", encoding="utf-8")
        return SlurmJob(job, record, log)


def _parameters(options: Sequence[str]) -> dict[str, str | int]:
    """Options of a job by name; raises ValueError where one is unknown, empty or twice there, or time is missing."""
    found: dict[str, str | int] = {}
    for option in options:
        name, _, value = option.partition("=")
        name = name.replace("-", "_")
        if name not in OPTIONS or not value or name in found:
            legal = ", ".join(OPTIONS)
            raise ValueError(f"slurm is {option!r}; expected KEY=VALUE, once for each KEY of {legal}")
        found[name] = int(value) if value.isdecimal() else value
    if "time" not in found:
        raise ValueError("--launcher slurm needs --slurm time=MINUTES; a cell whose time is up goes on in a new job")
    return found
