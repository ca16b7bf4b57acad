"""Typical commands, as a user gives them in a shell."""

import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from tiny_runs import TINY

from curiobench.cli.train_arguments import flags_of
from curiobench.options import flatten

COMMAND = (str(Path(sys.executable).with_name("curiobench")),)
"""The installed command."""
OPTIONS = {
    name.replace("_", "-"): value
    for name, value in flatten(TINY.to_json()).items()
    if name not in ("task", "method", "seed", "robot", "preset", "method_config")
}
"""Options of the run `finished`."""
TRAIN = (
    *("train", "--task", "stack2", "--preset", "smoke"),
    *(word for option in OPTIONS.items() for word in flags_of(*option)),
)
"""Trains that run; `--out` is lacking."""
GRID = (
    *("grid", "--tasks", "stack2", "--methods", "sac", "--seeds", "1", "--preset", "smoke", "--out", "grid"),
    *("--options", ",".join(f"{name}={value}" for name, value in OPTIONS.items())),
)
"""Trains it as `grid/stack2-sac-0`."""


def reading(run: Path) -> dict[str, tuple[str, ...]]:
    """Commands that read a run, by name; they write into the working folder."""
    return {
        "list": ("list",),
        "table": ("table", str(run), "--out", "tables"),
        "evaluate": ("evaluate", str(run), "--episodes", "1"),
        "report": ("report", str(run), "--out", "report.html"),
        "submit-check": ("submit-check", str(run)),
    }


def call(
    words: tuple[str, ...], folder: Path, environment: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[bytes]:
    """Carry out a command in a folder."""
    return subprocess.run(
        [*COMMAND, *words], cwd=folder, env=environment, capture_output=True, check=False, timeout=300
    )


def files(folder: Path) -> dict[str, bytes]:
    """All files below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def wait_for(condition: Callable[[], object], seconds: float = 180) -> None:
    """Wait until a condition holds."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it never came about"
        time.sleep(0.02)
