"""Stands in for a SLURM cluster of one CPU on this machine: run as `sbatch`, `srun`, `sacct` or `scancel`.

A job is a file in $FAKE_SLURM that holds its state and, once it runs, its process.
"""

import fcntl
import os
import signal
import subprocess
import sys
from pathlib import Path

HOME = Path(os.environ["FAKE_SLURM"])


def sbatch(script: str) -> None:
    number = len(list(HOME.glob("*.job"))) + 1
    (HOME / f"{number}.job").write_text("PENDING")
    (HOME / f"{number}.script").write_text(Path(script).read_text())
    runner, nowhere = [sys.executable, __file__, "run", str(number), script], subprocess.DEVNULL
    subprocess.Popen(runner, stdout=nowhere, stderr=nowhere, start_new_session=True)
    print(f"Submitted batch job {number}")


def run(number: str, script: str) -> None:
    job = HOME / f"{number}.job"
    with open(HOME / "cpu", "a") as cpu:
        fcntl.flock(cpu, fcntl.LOCK_EX)
        if job.read_text() == "CANCELLED":
            return
        process = subprocess.Popen(["bash", script], env=os.environ | {"SLURM_JOB_ID": number})
        job.write_text(f"RUNNING {process.pid}")  # until it is that of srun
        process.wait()
        job.write_text("COMPLETED")


def srun(_: str, __: str, output: str, *command: str) -> None:
    """Called as `srun --unbuffered --output FILE COMMAND…`."""
    (HOME / f"{os.environ['SLURM_JOB_ID']}.job").write_text(f"RUNNING {os.getpid()}")
    with open(output.replace("%j", os.environ["SLURM_JOB_ID"]).replace("%t", "0"), "a") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        os.execvp(command[0], command)


def sacct(*_: str) -> None:
    print("JobID|State|NodeList")
    for job in HOME.glob("*.job"):
        print(f"{job.stem}|{job.read_text().split()[0]}|here")


def scancel(number: str) -> None:
    job = HOME / f"{number}.job"
    state, *process = job.read_text().split()
    if state == "PENDING":
        job.write_text("CANCELLED")
    elif process:
        os.kill(int(process[0]), signal.SIGTERM)


def install(folder: Path) -> None:
    """Put the commands into a folder for $PATH."""
    for name in ("sbatch", "srun", "sacct", "scancel"):
        (folder / name).write_text(f'#!/bin/sh\nexec {sys.executable} {__file__} {name} "$@"\n')
        (folder / name).chmod(0o755)


if __name__ == "__main__":
    {"sbatch": sbatch, "run": run, "srun": srun, "sacct": sacct, "scancel": scancel}[sys.argv[1]](*sys.argv[2:])
