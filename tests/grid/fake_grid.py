"""Grids with `fake_cell.py` as cells: in this process, or as a program `fake_grid.py OUT JOBS|slurm [FLAGS…]`."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from curiobench.cli.arguments import GridArguments
from curiobench.cli.parsing import parse_arguments
from curiobench.errors import Interrupted, RunFailed, StopRequest
from curiobench.grid.cells import Cell, cells_of, write_record
from curiobench.grid.definition import define
from curiobench.grid.disk import State
from curiobench.grid.launcher import Launcher, LocalLauncher
from curiobench.grid.overview import PlainGridView
from curiobench.grid.run import train_cells
from curiobench.grid.scheduler import Scheduler
from curiobench.grid.slurm_launcher import SlurmLauncher
from curiobench.grid.status import Status
from curiobench.run_folder import RUN_FORMAT

FAKE = (str(Path(__file__).with_name("fake_cell.py")),)
SLURM = ("time=9", "partition=cpu")
"""Options of jobs."""


def make_cells(out: Path, *flags: str) -> list[Cell]:
    """Cells of a grid by its flags; by default two methods and two seeds."""
    flags = flags or ("--methods", "sac,icm", "--seeds", "2")
    arguments = ["--out", str(out), "--tasks", "stack2", "--preset", "smoke", *flags]
    return cells_of(define(parse_arguments(GridArguments, "grid", arguments)), out)


def set_up_fakes(cells: list[Cell], pace: float = 0.02, **behaviour: dict) -> None:
    """Write what the fakes do: seconds an epoch, and `behaviour` by folder, with _ for -."""
    planned = {}
    for cell in cells:
        record = {"format": RUN_FORMAT, "config_version": 1, "config": cell.config.to_json(), "versions": {}}
        planned[cell.folder] = {"record": record, "pace": pace, **behaviour.get(cell.folder.replace("-", "_"), {})}
    cells[0].out.parent.mkdir(parents=True, exist_ok=True)
    (cells[0].out.parent / "fake.json").write_text(json.dumps(planned))


class Watching(PlainGridView):
    """Passes the states of the cells to a function whenever they are shown."""

    def __init__(self, watch: Callable[[list[Status]], None]) -> None:
        super().__init__()
        self.watch = watch

    def show(self, statuses: list[Status], slots: int) -> None:
        self.watch(statuses)


def run_on(
    launcher: Launcher,
    cells: list[Cell],
    view: PlainGridView | None = None,
    stop: StopRequest | None = None,
    retries: int = 1,
    poll: float = 0.1,
) -> Scheduler:
    """Run cells to their end in this process; those of other grids are asked for every five polls."""
    cells[0].out.mkdir(parents=True, exist_ok=True)
    scheduler = Scheduler(cells, launcher, retries, view or PlainGridView(), stop or StopRequest(), poll, 5 * poll)
    try:
        scheduler.run()
    finally:
        launcher.close()
    return scheduler


def schedule(cells: list[Cell], jobs: int = 2, retries: int = 1, view: PlainGridView | None = None) -> Scheduler:
    """`run_on` this machine."""
    return run_on(LocalLauncher(jobs, FAKE), cells, view, retries=retries, poll=0.02)


def states(scheduler: Scheduler) -> dict[str, State]:
    """States of the cells by folder."""
    return {status.cell.folder: status.state for status in scheduler.statuses}


def starts(cell: Cell) -> list[str]:
    """A line for each time that a cell was started, which begins with its process."""
    path = cell.path / "starts"
    return path.read_text().splitlines() if path.exists() else []


def start(out: Path, jobs: int | str, *flags: str) -> subprocess.Popen:
    """A grid of fakes, set up already, in a process group of its own."""
    command = [sys.executable, __file__, str(out), str(jobs), *flags]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )


def rows(out: Path) -> dict[str, str]:
    """Everything in the progress of all cells, by folder."""
    return {path.parent.name: path.read_text() for path in sorted(out.glob("*/progress.csv"))}


def undisturbed(cells: list[Cell]) -> dict[str, str]:
    """What `rows` gives of cells that all ran to their end."""
    value, lines = 1, ["epoch,goals_learned,value,seconds"]
    for epoch in range(1, cells[0].config.epochs + 1):
        value = value * 31 % 9973
        lines.append(f"{epoch},{epoch % 4},{value},{epoch / 50}")
    return {cell.folder: "\n".join([*lines, ""]) for cell in cells}


def main() -> None:
    """`curiobench grid` with fakes."""
    out = Path(sys.argv[1])
    cells = make_cells(out, *sys.argv[3:])
    write_record(out, cells, ["grid"])
    try:
        slurm = sys.argv[2] == "slurm"
        launcher = SlurmLauncher(None, SLURM, out, FAKE) if slurm else LocalLauncher(int(sys.argv[2]), FAKE)
        train_cells(cells, launcher, 1, PlainGridView())
    except RunFailed as error:
        print(error)
        sys.exit(1)
    except Interrupted as error:
        print(error)
        sys.exit(128 + error.signal_number)


if __name__ == "__main__":
    main()
