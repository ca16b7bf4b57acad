"""Versions of all that decides the numbers of a run, for its record."""

import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

from curiobench.protocol import EVALUATION_SEED
from curiobench.tasks.registration import TASK_VERSION

PACKAGES = ("curiobench", "mujoco", "dm_control", "torch", "numpy")
"""Packages whose versions decide the numbers of a run, with Python's own, as tables compare them."""
ENVIRONMENT_VARIABLES = (
    *("ATEN_CPU_CAPABILITY", "DNNL_MAX_CPU_ISA", "ONEDNN_MAX_CPU_ISA", "MKL_CBWR", "MKL_ENABLE_INSTRUCTIONS"),
    *("NPY_DISABLE_CPU_FEATURES", "NPY_ENABLE_CPU_FEATURES", "OPENBLAS_CORETYPE"),
    *("NUMBA_CPU_FEATURES", "NUMBA_CPU_NAME", "NUMBA_DISABLE_JIT", "NUMBA_OPT"),
)
"""Environment variables by which those packages choose their code, and with it the last bits of numbers."""


def versions(method: str) -> dict[str, str | int | None]:
    """Versions of Python, of the packages that decide the numbers and of the tasks, the seed of the test episodes, the
    variables of `ENVIRONMENT_VARIABLES` that are set, and the git commit of this package if it has any.

    If the method `method` is not built in, also its file and the file's digest.
    """
    from curiobench.methods.registry import traced  # needs torch, which reading a run folder does not

    packages = {name: version(name) for name in (*PACKAGES, "numba")}  # which older runs did not record
    protocol = {"task_version": TASK_VERSION, "evaluation_seed": EVALUATION_SEED}
    environment = " ".join(f"{name}={os.environ[name]}" for name in ENVIRONMENT_VARIABLES if os.environ.get(name))
    own = {"environment": environment, "git_commit": git_commit()}
    return {"python": platform.python_version(), **packages, **protocol, **own, **traced(method)}


def git_commit() -> str | None:
    """Commit of the working copy that this package is imported from, "-dirty" if altered; None where there is none."""
    root = Path(__file__).resolve().parent.parent
    if not (root / ".git").exists():
        return None  # an installed package; a repository further up is not its own
    command = ["git", "-C", str(root), "describe", "--always", "--abbrev=40", "--dirty", "--exclude=*"]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip()
