"""Arguments of the commands but `train`; their docstrings are the help."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

Runs = Annotated[
    tyro.conf.Positional[tuple[Path, ...]],
    tyro.conf.arg(help="Run folders, folders of run folders (such as a grid's), or published sets."),
]
Baseline = Annotated[
    str | None,
    tyro.conf.arg(help="Method that the others are compared with; by default sac, if there are runs of it."),
]
Among = Literal["random", "replay"]
"""What a transition is scored among: random play, the same for all runs, or the run's own replay."""
Switch = Annotated[bool, tyro.conf.FlagCreatePairsOff]
Partial = Annotated[Switch, tyro.conf.arg(help="Also use runs that are not finished.")]


@dataclass(frozen=True)
class ListArguments:
    """Show the tasks, robots, methods and presets that `curiobench train` accepts."""


@dataclass(frozen=True)
class GridArguments:
    """Train tasks × methods × seeds, one run folder each, several at a time. Give the same command again to continue.

    Finished cells are skipped. Broken ones are reported and tried again; the others go on. Ctrl-C ends every cell after
    a checkpoint. Several grids may work in one folder at once, each on its own cells.
    """

    out: Path
    """Folder of the run folders."""
    file: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[FILE.yaml]")] = None
    """Tasks, methods, seeds, preset, robot, options and variants, as docs/grids.md in the repository explains; flags
    override it."""
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
    """Cells at a time, one thread each; by default the physical cores that may be used here, all of a Ray cluster, or
    100 jobs of SLURM, queued ones counted."""
    retries: Annotated[int, tyro.conf.arg(metavar="N")] = 1
    """How often a broken cell is tried again, after the others."""
    launcher: Literal["local", "ray", "slurm"] = "local"
    """Where cells run: processes of this machine, tasks of a Ray cluster, or jobs of SLURM (the last two need the extra
    of that name)."""
    address: Annotated[str | None, tyro.conf.arg(metavar="HOST:PORT")] = None
    """Address of a running Ray cluster, or auto to find it; without it one starts on this machine and ends with the
    grid."""
    slurm: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="KEY=VALUE")] = ()
    """Option of sbatch for every cell's job, such as time=240 (required) or partition=cpu; give --slurm once per
    option."""
    dry_run: Switch = False
    """Show every cell, its state and its command, and start nothing."""


@dataclass(frozen=True)
class EvaluateArguments:
    """Evaluate the agent of a run's newest checkpoint on every goal, from plain starts, with its deterministic policy.

    The run may still be training. With the run's own number of episodes, starts are those of its evaluations.
    """

    run: tyro.conf.Positional[Path]
    """Run folder, or an agent of a published set such as v2/stack3/mihm."""
    goals: Switch = False
    """Show every goal, not only the layers."""
    episodes: int | None = None
    """Test episodes of every goal; by default as many as in the run's own evaluations."""
    threads: int = 1
    """Threads that step the worlds; results do not depend on it."""
    method: str | None = None
    """For a method that is not built in: its spec. Required, because loading it runs its code."""


@dataclass(frozen=True)
class VideoArguments:
    """Film the agent of a run's newest checkpoint, or a published one, while it pursues a goal (needs the extra
    `video`)."""

    run: tyro.conf.Positional[Path]
    """Run folder, published set, or an agent of a set such as v2/stack3/mihm."""
    goal: str
    """The goal: a name such as "a on b, c apart", or bits such as 100100000. `curiobench evaluate RUN --goals` lists
    them."""
    out: Path | None = None
    """File to write, .mp4, .gif or .webp; by default an mp4 named after the goal, in the run folder or, of a published
    agent, in the current one."""
    episodes: int = 3
    """Episodes to show, one after the other."""
    seed: int = 0
    """Seed of the starts."""
    method: str | None = None
    """For a published set, the method of the agent. For a method that is not built in: its spec. Required, because
    loading it runs its code."""
    task: str | None = None
    """For a published set, the task of the agent; needed if the set has the method's agents on several tasks."""


@dataclass(frozen=True)
class TableArguments:
    """Print learned goals, success and cost by task and method, over seeds.

    A single run folder gives a line about that run. docs/results.md in the repository explains the numbers.
    """

    runs: Runs
    like: Literal["paper"] | None = None
    """Show the tables of the paper, with its numbers beside ours."""
    format: Literal["terminal", "markdown", "latex", "csv"] = "terminal"
    """Format of what is printed."""
    baseline: Baseline = None
    out: Path | None = None
    """Folder to write the tables to, in every format; files of the same names are replaced."""
    partial: Partial = False
    each_run: Switch = False
    """Show a line per run, finished or not."""


@dataclass(frozen=True)
class FigureArguments:
    """Draw runs: success and learned goals over training, goals × methods, performance profiles, a comparison.

    Each task has its own files. A method has the same colour in all. docs/figures.md in the repository explains them.
    """

    runs: Runs
    out: Path = Path("figures")
    """Folder of the files; those of the same names are replaced."""
    like: str | None = None
    """"paper" draws only the paper's Figures 4, 6C and 7."""
    partial: Partial = False
    format: str = "pdf,png"
    """File formats, comma-separated: pdf, png, svg."""


@dataclass(frozen=True)
class ReportArguments:
    """Write one HTML page about runs: tables that sort, figures, every goal with its picture, options, commands.

    The page needs no network and no other file.
    """

    runs: Runs
    out: Path = Path("report.html")
    """File to write; an existing one is replaced."""
    title: str | None = None
    """Title of the page; by default it names the tasks."""
    partial: Partial = False
    baseline: Baseline = None


@dataclass(frozen=True)
class PublishArguments:
    """Write a published set: rows, configs, agents, tables, figures and a report of finished runs in one folder.

    Publishes nothing if any run is missing, broken, partial, a duplicate or foreign. A lengthened run replaces its
    shorter version. A README and other files in the folder are kept. The agent of a task and method comes from its best
    run that still has a checkpoint.
    """

    runs: Runs
    out: Path
    """Folder of the set, such as results/v2."""
    allow_dirty: Switch = False
    """Also publish runs of code with uncommitted changes, or of an unknown commit."""
    replace: Switch = False
    """Overwrite an existing set even if runs or agents would be lost or numbers change."""
    method: tuple[str, ...] = ()
    """For each method that is not built in: its spec. Without it the method gets no agent, because loading one runs the
    method's code."""


@dataclass(frozen=True)
class SubmitCheckArguments:
    """Check whether runs are comparable with published ones: same tasks, test episodes and options, enough seeds.

    Prints a line per rule, which begins with pass, FAIL, skip (the rule does not apply) or warn (numbers may differ a
    little), and details below it.
    """

    runs: Runs
    against: str | None = None
    """Published set to compare with, by name or path, or "presets"; by default the newest that comes with curiobench,
    or the presets if there is none."""


@dataclass(frozen=True)
class ProbeArguments:
    """Compute intrinsic rewards along scripted episodes: figures, numbers, and a controllability score per run.

    Reads the newest checkpoints; the runs may still be training. All runs must have the same task and robot.
    """

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Run folders."""
    out: Path = Path("probe")
    """Folder for figures and tables; files of the same names are replaced."""
    starts: int = 20
    """Plain starts from which each script is played."""
    seed: int = 0
    """Seed of the starts and of the reference play."""
    among: Among = "random"
    """Score each step among random play, the same for all runs, or among transitions of the run's own replay, as in
    training (only while it lasts: see --machine.keep-replay)."""
    as_of_epoch: int | None = None
    """Epoch that methods get instead of their checkpoint's, on the paper's scale of 500. It changes MI's weight of
    conservativeness."""
    method: tuple[str, ...] = ()
    """For each method that is not built in: its spec. Required, because loading it runs its code."""


@dataclass(frozen=True)
class NewMethodArguments:
    """Write a curiosity method to start from: a commented file that trains as it is."""

    name: tyro.conf.Positional[str]
    """Name of the file, without .py; the class in it has the same name in CamelCase."""
    out: Path = Path(".")
    """Folder of the file; an existing file is not replaced."""


@dataclass(frozen=True)
class CheckArguments:
    """Check whether a curiosity method keeps the benchmark's rules, and print a line per rule.

    A line begins with pass, FAIL, skip (the rule does not apply) or warn (it costs more than it should).
    """

    method: tyro.conf.Positional[str]
    """Method spec, such as my_pkg.curiosity:Mine or rnd."""
