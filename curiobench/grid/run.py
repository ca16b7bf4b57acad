"""`curiobench grid`: read the definition, choose the launcher, train, report."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from curiobench.cli.arguments import GridArguments
from curiobench.display import Terminal
from curiobench.errors import Interrupted, RunFailed, StopRequest, pasted
from curiobench.grid.cells import Cell, cells_of, write_record
from curiobench.grid.definition import define
from curiobench.grid.disk import State, cell_state
from curiobench.grid.launcher import Launcher, LocalLauncher, physical_cores
from curiobench.grid.overview import LiveGridView, PlainGridView, status_line
from curiobench.grid.scheduler import Scheduler
from curiobench.methods.checks import check_at_least
from curiobench.terminal import draws


def run_grid(arguments: GridArguments, command: Sequence[str] = ()) -> None:
    """Train the cells of a grid that are not finished.

    Args:
        arguments: of the command.
        command: the command line, for the record.

    Raises:
        ValueError: before any start: a task, method, option, file or number is wrong; one line.
        RunFailed: cells stay broken or in conflict; each has been reported.
        Interrupted: on Ctrl-C or SIGTERM, after the checkpoints of all cells.
    """
    check_at_least(arguments, 1, "jobs")
    check_at_least(arguments, 0, "retries")
    if arguments.address is not None and arguments.launcher != "ray":
        raise ValueError("--address needs --launcher ray")
    if arguments.slurm and arguments.launcher != "slurm":
        raise ValueError("--slurm needs --launcher slurm")
    out = arguments.out if arguments.launcher == "local" else arguments.out.resolve()
    cells = cells_of(define(arguments), out)
    if arguments.dry_run:
        for cell in cells:
            state = ": ".join(filter(None, cell_state(cell)))
            print(f"{cell.folder}: {state}\n  {shlex.join(cell.command)}")
        return
    launcher = _launcher(arguments, out)
    try:
        write_record(out, cells, command)
        train_cells(cells, launcher, arguments.retries, LiveGridView() if draws() else PlainGridView())
    finally:
        launcher.close()
    Terminal().say(f"all {len(cells)} cells are finished; `curiobench table {pasted(arguments.out)}` shows them")


def train_cells(cells: Sequence[Cell], launcher: Launcher, retries: int, view: PlainGridView) -> None:
    """Train cells and report faults; raises as `run_grid`."""
    with StopRequest() as stop:
        scheduler = Scheduler(cells, launcher, retries, view, stop)
        slots = launcher.slots()
        try:
            view.event(f"{len(cells)} cells in {cells[0].out}, {slots} at a time")
            scheduler.run()
        finally:
            view.close()
    statuses = scheduler.statuses
    faults = [status for status in statuses if status.state in (State.BROKEN, State.CONFLICT)]
    terminal = Terminal()
    for status in faults:
        log = f"; log: {status.cell.log}" if status.state is State.BROKEN else ""
        terminal.say(f"{status.cell.folder}: {status.state}: {status.reason}{log}")
    if stop.count:
        raise Interrupted(f"{status_line(statuses, slots)}; the same command continues", stop.number)
    if faults:
        raise RunFailed(f"{len(faults)} of {len(cells)} cells are not finished")


def _launcher(arguments: GridArguments, out: Path) -> Launcher:
    if arguments.launcher == "ray":
        from curiobench.grid.ray_launcher import RayLauncher

        return RayLauncher(arguments.jobs, arguments.address)
    if arguments.launcher == "slurm":
        from curiobench.grid.slurm_launcher import SlurmLauncher

        return SlurmLauncher(arguments.jobs, arguments.slurm, out)
    return LocalLauncher(arguments.jobs or physical_cores())
