"""Arguments of `curiobench grid`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True)
class GridArguments:
    """Train tasks × methods × seeds, a run folder each, several at a time. Give the same command again to continue.

    Finished cells are skipped; broken ones are reported, tried again, and stop no other. Ctrl-C ends every cell after
    a checkpoint. Several grids may work in one folder at once, each on cells of its own.
    """

    out: Path
    """Folder of the run folders."""
    file: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[FILE.yaml]")] = None
    """Tasks, methods, seeds, preset, robot, options and variants, as docs/grids.md explains; flags override it."""
    tasks: Annotated[str | None, tyro.conf.arg(metavar="A,B")] = None
    """Tasks, such as stack2,stack3."""
    methods: Annotated[str | None, tyro.conf.arg(metavar="A,B")] = None
    """Method specs, such as sac,icm+hm; `curiobench list` shows them all."""
    seeds: Annotated[str | None, tyro.conf.arg(metavar="N|A,B")] = None
    """How many seeds, counted from 0, or the seeds themselves (one alone: 4,). 3 unless the file says otherwise."""
    preset: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Preset of all cells; laptop unless the file says otherwise."""
    robot: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Robot of all cells; gripper unless the file says otherwise."""
    options: Annotated[str | None, tyro.conf.arg(metavar="A=X,B=Y")] = None
    """Options of `curiobench train` for all cells, such as epochs=12,sac.gamma=0.9; added to the file's."""
    jobs: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Cells at a time, one thread each; by default the physical cores that may be used here, or all of the cluster."""
    retries: Annotated[int, tyro.conf.arg(metavar="N")] = 1
    """How often a broken cell is tried again, after the others."""
    launcher: Literal["local", "ray"] = "local"
    """Where cells run: processes of this machine, or tasks of a Ray cluster (needs the extra `ray`)."""
    address: Annotated[str | None, tyro.conf.arg(metavar="HOST:PORT")] = None
    """Ray cluster that is up, or auto to find it; without it one starts on this machine and ends with the grid."""
    dry_run: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Show every cell, its state and its command, and start nothing."""
