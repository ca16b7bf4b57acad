"""The commands. Each imports what it needs when it runs: `curiobench --help` needs neither torch nor MuJoCo."""

import io
import os
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn, get_type_hints

from curiobench import terminal
from curiobench.cli.arguments import (
    CheckArguments,
    EvaluateArguments,
    FigureArguments,
    GridArguments,
    ListArguments,
    NewMethodArguments,
    ProbeArguments,
    PublishArguments,
    ReportArguments,
    SubmitCheckArguments,
    TableArguments,
    VideoArguments,
)
from curiobench.cli.parsing import parse_arguments
from curiobench.errors import CheckFailed, Interrupted, RunFailed, missing_extra, one_line
from curiobench.tasks.registration import check_name


def list_choices(arguments: ListArguments) -> None:
    """Print what can be trained."""
    from curiobench.cli.listing import listing

    print(listing())


def train(arguments: Any) -> None:
    """Train a run."""
    from curiobench.training import train

    train(arguments.config, arguments.out, arguments.resume, ["curiobench", *sys.argv[1:]])
    terminal.settle(sys.stdout)  # a closed pipe is no failure of a finished run


def grid(arguments: GridArguments) -> None:
    """Train a grid of runs."""
    from curiobench.grid.run import run_grid

    run_grid(arguments, ["curiobench", *sys.argv[1:]])
    if not arguments.dry_run:
        terminal.settle(sys.stdout)


def evaluate(arguments: EvaluateArguments) -> None:
    """Test a run's agent and print its learned goals."""
    from curiobench.evaluation import Evaluator, format_goals, format_layers, learned_by_layer
    from curiobench.saved_agent import load_agent

    config, agent = load_agent(arguments.run, arguments.method)
    episodes = config.episodes_per_goal if arguments.episodes is None else arguments.episodes
    rows = Evaluator(config.task, config.robot, episodes, arguments.threads).evaluate(agent).rows()
    if arguments.goals:
        print(format_goals(rows), end="\n\n")
    print(format_layers(learned_by_layer(rows)))


def video(arguments: VideoArguments) -> None:
    """Film a run's agent, or a published one."""
    from curiobench.analysis.folders import named_agent
    from curiobench.saved_agent import load_agent
    from curiobench.video import film

    run = named_agent(arguments.run, arguments.task, arguments.method)
    config, agent = load_agent(run, arguments.method)
    folder = run if run.is_dir() else Path()  # nothing is written into published sets
    path, successes = film(agent, config, arguments.goal, arguments.out, folder, arguments.episodes, arguments.seed)
    print(f"{path}: {successes} of {arguments.episodes} episodes reached the goal")


def table(arguments: TableArguments) -> None:
    """Print tables of runs; then raises ValueError if a given path is not in them."""
    from curiobench.analysis.formats import show_tables

    show_tables(arguments)


def figure(arguments: FigureArguments) -> None:
    """Draw the figures of runs; then raises ValueError if a given path is not in them."""
    from curiobench.analysis.figures import draw_figures
    from curiobench.analysis.frames import print_faults, read_results
    from curiobench.analysis.samples import LOGGED
    from curiobench.workers import cores

    results = read_results(arguments.runs, arguments.partial, False, LOGGED, cores())
    formats = [name.strip() for name in arguments.format.split(",")]
    for file in draw_figures(results, arguments.out, arguments.like, formats, cores()):
        print(file)
    print_faults(results, "figures")


def report(arguments: ReportArguments) -> None:
    """Write a report on runs; then raises ValueError if a given path is not in it."""
    from curiobench.analysis.frames import print_faults
    from curiobench.analysis.report import write_report
    from curiobench.workers import cores

    options = arguments.title, arguments.partial, arguments.baseline
    results = write_report(arguments.runs, arguments.out, *options, cores())
    print(arguments.out)
    print_faults(results, "report")


def probe(arguments: ProbeArguments) -> None:
    """Print controllability scores of runs, and draw intrinsic rewards along scripted episodes."""
    from curiobench.probe.report import probe

    scores, notes, files = probe(arguments)
    print("\n".join([*notes, scores, "", *map(str, files)]))


def new_method(arguments: NewMethodArguments) -> None:
    """Write a template of a curiosity method, and print how to check and train it."""
    from curiobench.check.new_method import write_method

    path, spec = write_method(arguments.name, arguments.out)
    print(f"{path}: trains as it is. From its folder:\n")
    print(f"  curiobench check {spec}")
    print(f"  curiobench train --task stack2 --method {spec} --preset smoke --out runs/{arguments.name}")


def check(arguments: CheckArguments) -> None:
    """Check a method and print the findings; then raises CheckFailed if a property fails."""
    from curiobench.check.goal_properties import examine_goals
    from curiobench.check.properties import examine
    from curiobench.methods.plugins import file_of
    from curiobench.methods.process import tune_process
    from curiobench.methods.registry import parse_spec

    spec = parse_spec(arguments.method)
    if spec.method is None:
        raise ValueError(f"{arguments.method} is the agent without a curiosity method, so there is nothing to check")
    tune_process()
    findings = examine_goals(spec.method) if spec.reward is None else examine(spec.reward)
    _show_findings(f"{spec.method.__name__} in {file_of(spec.method)}", findings, arguments.method)


def publish(arguments: PublishArguments) -> None:
    """Write a published set."""
    from curiobench.analysis.publish import publish

    options = arguments.allow_dirty, arguments.replace, arguments.method
    print("\n".join(publish(arguments.runs, arguments.out, *options)))


def submit_check(arguments: SubmitCheckArguments) -> None:
    """Check a submission and print the findings; then raises CheckFailed if a rule is broken."""
    from curiobench.analysis.rules import submit_check

    title, findings = submit_check(arguments.runs, arguments.against)
    _show_findings(title, findings, "the submission")


def _show_findings(title: str, findings: Sequence[Any], subject: str) -> None:
    print("\n".join([title, *map(str, findings)]))
    if failed := sum(finding.verdict == "FAIL" for finding in findings):
        raise CheckFailed(f"{subject} fails {failed} of {len(findings)} properties")


COMMANDS: dict[str, tuple[Callable[[Any], None], str]] = {
    "list": (list_choices, "tasks, robots, methods and presets"),
    "train": (train, "train one run; it can be stopped and resumed at any time"),
    "grid": (grid, "train tasks × methods × seeds, several runs at a time"),
    "evaluate": (evaluate, "evaluate a run's agent on every goal"),
    "video": (video, "make a video of a run's agent pursuing a goal"),
    "table": (table, "results of methods over seeds, beside the paper, or run by run"),
    "figure": (figure, "learning curves, heat maps and comparisons of many runs, as PDF and PNG"),
    "report": (report, "tables, figures, goals and commands of many runs as one HTML page"),
    "probe": (probe, "intrinsic rewards along scripted episodes, and controllability scores"),
    "new-method": (new_method, "write a template of a curiosity method"),
    "check": (check, "check whether a curiosity method keeps the rules"),
    "publish": (publish, "write finished runs to one folder of rows, tables, figures and a report"),
    "submit-check": (submit_check, "check whether runs are comparable with the published ones"),
}
"""The function of each command, which takes the parsed arguments, and a line for the help."""

EXIT_CODES = (
    "Exit codes: 0 done, 1 a run or check failed, 2 bad input, 130 or 143 stopped by Ctrl-C or SIGTERM after a "
    "checkpoint."
)


def usage() -> str:
    """The help, as wide as the terminal."""
    columns = terminal.width()
    return f"""usage: curiobench COMMAND [OPTIONS]

{terminal.wrapped("Which curiosity method helps a robot arm that is rewarded only at its goal?", columns)}

{terminal.described({name: about for name, (_, about) in COMMANDS.items()}, columns)}

{terminal.wrapped("`curiobench COMMAND --help` explains a command. To begin:", columns)}

  curiobench train --task stack2 --method sac --preset smoke --out runs/demo

{terminal.wrapped(EXIT_CODES, columns)}"""


def run(words: Sequence[str]) -> None:
    """Parse and run one command; without words show the help. Raises ValueError on bad input."""
    name, *words = words or ["--help"]
    if name in ("-h", "--help"):
        print(usage())
        return
    if name == "--version":
        from curiobench import __version__

        print(f"curiobench {__version__}")
        return
    command, _ = COMMANDS[check_name("command", name, tuple(COMMANDS))]
    if command is train:  # whose arguments depend on the method
        from curiobench.cli.train_arguments import parse_train

        command(parse_train(words))
    else:
        command(parse_arguments(get_type_hints(command)["arguments"], name, words))


def main() -> NoReturn:
    """Run the command in `sys.argv` and exit with a code that `usage` explains; errors take one line on stderr."""
    _prepare_streams()
    try:
        run(sys.argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:  # as in `curiobench list | head -1`
        terminal.settle(sys.stdout)
        sys.exit(128 + signal.SIGPIPE)
    except ValueError as error:
        _exit(error, 2)
    except ModuleNotFoundError as error:
        _exit(missing_extra(error), 2)
    except (RunFailed, CheckFailed) as error:
        _exit(error, 1)
    except Interrupted as error:
        _exit(error, 128 + error.signal_number)
    except KeyboardInterrupt:
        _exit("stopped at once", 130)
    except OSError as error:  # such as a folder without the right to look into it
        _exit(f"{error.filename}: {error.strerror}" if error.filename else error, 2)
    sys.exit(0)


def _prepare_streams() -> None:
    """Let output go nowhere where a stream is closed, and replace characters that its encoding does not have."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 - for as long as the process
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _exit(message: object, code: int) -> NoReturn:
    terminal.settle(sys.stdout)
    with suppress(OSError):
        print(f"curiobench: {one_line(message)}", file=sys.stderr)
    terminal.settle(sys.stderr)
    sys.exit(code)
