"""The command line. Commands import what they need as they run: `curiobench --help` needs neither torch nor MuJoCo."""

import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import NoReturn

from curiobench.errors import CheckFailed, Interrupted, RunFailed, one_line

USAGE = """usage: curiobench COMMAND [OPTIONS]

Which curiosity method helps a robot arm that is rewarded only at its goal?

  list       tasks, robots, methods and presets
  train      train one run in a folder; it may be stopped and resumed at any time
  grid       train tasks × methods × seeds, several runs at a time
  evaluate   test a run's agent on every goal
  video      film a run's agent while it pursues a goal
  table      what methods learned, over seeds, beside the paper, or run by run
  figure     learning curves, heat maps and comparisons of many runs, as PDF and PNG
  report     tables, figures, goals and commands of many runs as one HTML page
  probe      curiosity of several runs along scripted episodes, and their controllability scores
  new-method write a curiosity method of your own to start from
  check      examine whether a curiosity method keeps the rules
  publish    finished runs as one folder of rows, tables, figures and a report
  submit-check examine whether runs can stand beside the published ones

`curiobench COMMAND --help` explains a command. To begin:

  curiobench train --task stack2 --method sac --preset smoke --out runs/demo

Exit codes: 0 done, 1 a run or check failed, 2 bad input, 130 or 143 stopped by Ctrl-C or SIGTERM after a checkpoint."""


def list_choices(arguments: Sequence[str]) -> None:
    """Print what can be trained."""
    from curiobench.arguments import ListArguments, parse

    parse(ListArguments, "list", arguments)
    from curiobench.listing import listing

    print(listing())


def train(arguments: Sequence[str]) -> None:
    """Train a run."""
    from curiobench.train_arguments import parse_train

    parsed = parse_train(arguments)
    from curiobench.train import train

    train(parsed.config, parsed.out, parsed.resume, ["curiobench", "train", *arguments])


def grid(arguments: Sequence[str]) -> None:
    """Train a grid of runs."""
    from curiobench.arguments import parse
    from curiobench.grid.arguments import GridArguments

    parsed = parse(GridArguments, "grid", arguments)
    from curiobench.grid.run import run_grid

    run_grid(parsed, ["curiobench", "grid", *arguments])


def evaluate(arguments: Sequence[str]) -> None:
    """Test a run's agent and print its learned goals."""
    from curiobench.arguments import EvaluateArguments, parse

    parsed = parse(EvaluateArguments, "evaluate", arguments)
    from curiobench.evaluation import Evaluator
    from curiobench.learned_goals import format_goals, format_layers
    from curiobench.saved_agent import load_agent

    config, agent = load_agent(parsed.run, {parsed.method})
    episodes = config.episodes_per_goal if parsed.episodes is None else parsed.episodes
    evaluation = Evaluator(config.task, config.robot, episodes, parsed.threads).evaluate(agent)
    if parsed.goals:
        print(format_goals(evaluation.rows()), end="\n\n")
    print(format_layers(evaluation.learned_by_layer()))


def video(arguments: Sequence[str]) -> None:
    """Film a run's agent."""
    from curiobench.arguments import VideoArguments, parse

    parsed = parse(VideoArguments, "video", arguments)
    from curiobench.saved_agent import load_agent
    from curiobench.video import film

    config, agent = load_agent(parsed.run, {parsed.method})
    path, successes = film(agent, config, parsed.goal, parsed.out, parsed.run, parsed.episodes, parsed.seed)
    print(f"{path}: {successes} of {parsed.episodes} episodes reached the goal")


def table(arguments: Sequence[str]) -> None:
    """Print tables of runs; raises ValueError, after them, that names the folders that are not in them."""
    from curiobench.arguments import TableArguments, parse

    parsed = parse(TableArguments, "table", arguments)
    from curiobench.analysis.frames import check_named

    check_named(parsed.runs)
    from curiobench.analysis.formats import show_tables

    show_tables(parsed)


def figure(arguments: Sequence[str]) -> None:
    """Draw the figures of runs; raises ValueError, after them, that names the paths that gave no run."""
    from curiobench.arguments import FigureArguments, parse

    parsed = parse(FigureArguments, "figure", arguments)
    from curiobench.analysis.frames import check_named, tell_faults

    check_named(parsed.runs)
    from curiobench.analysis.figures import draw_figures
    from curiobench.analysis.frames import read_results
    from curiobench.analysis.samples import LOGGED
    from curiobench.analysis.style import preload
    from curiobench.workers import cores

    results = read_results(parsed.runs, parsed.partial, False, LOGGED, cores(), preload)
    for file in draw_figures(results, parsed.out, parsed.like, parsed.format.split(","), cores()):
        print(file)
    tell_faults(results, "figures")


def report(arguments: Sequence[str]) -> None:
    """Write a report on runs; raises ValueError, after it, that names the paths that gave no run."""
    from curiobench.arguments import ReportArguments, parse

    parsed = parse(ReportArguments, "report", arguments)
    from curiobench.analysis.frames import check_named, tell_faults

    check_named(parsed.runs)
    from curiobench.analysis.report import write_report
    from curiobench.workers import cores

    results = write_report(parsed.runs, parsed.out, parsed.title, parsed.partial, parsed.baseline, cores())
    print(parsed.out)
    tell_faults(results, "report")


def probe(arguments: Sequence[str]) -> None:
    """Print controllability scores of runs, and draw their curiosity along scripted episodes."""
    from curiobench.arguments import ProbeArguments, parse

    parsed = parse(ProbeArguments, "probe", arguments)
    from curiobench.probe_report import probe

    options = parsed.starts, parsed.seed, parsed.method, parsed.as_of_epoch, parsed.among
    table, notes, files = probe(parsed.runs, parsed.out, *options)
    print("\n".join([*notes, table, "", *map(str, files)]))


def new_method(arguments: Sequence[str]) -> None:
    """Write a curiosity method to start from, and say how it is tried."""
    from curiobench.arguments import NewMethodArguments, parse

    parsed = parse(NewMethodArguments, "new-method", arguments)
    from curiobench.new_method import write_method

    path, spec = write_method(parsed.name, parsed.out)
    print(f"{path}: trains as it is. From its folder:\n")
    print(f"  curiobench check {spec}")
    print(f"  curiobench train --task stack2 --method {spec} --preset smoke --out runs/{parsed.name}")


def check(arguments: Sequence[str]) -> None:
    """Print what the conformance suite finds in a method; raises CheckFailed, after it, where a property fails."""
    from curiobench.arguments import CheckArguments, parse

    parsed = parse(CheckArguments, "check", arguments)
    from curiobench.conformance import examine
    from curiobench.methods.plugins import file_of
    from curiobench.methods.process import tune_process
    from curiobench.methods.registry import parse_spec

    reward = parse_spec(parsed.method).reward
    if reward is None:
        raise ValueError(f"{parsed.method} has no curiosity method to check")
    tune_process()
    findings = examine(reward)
    print("\n".join([f"{reward.__name__} in {file_of(reward)}", *map(str, findings)]))
    if failed := sum(finding.verdict == "FAIL" for finding in findings):
        raise CheckFailed(f"{parsed.method} fails {failed} of {len(findings)} properties")


def publish(arguments: Sequence[str]) -> None:
    """Write a published set."""
    from curiobench.arguments import PublishArguments, parse

    parsed = parse(PublishArguments, "publish", arguments)
    from curiobench.analysis.publish import publish

    print("\n".join(publish(parsed.runs, parsed.out, parsed.allow_dirty, parsed.replace)))


def submit_check(arguments: Sequence[str]) -> None:
    """Print what is found in a submission; raises CheckFailed, after it, where a property fails."""
    from curiobench.arguments import SubmitCheckArguments, parse

    parsed = parse(SubmitCheckArguments, "submit-check", arguments)
    from curiobench.analysis.frames import check_named
    from curiobench.analysis.rules import submit_check

    check_named(parsed.runs)
    title, findings = submit_check(parsed.runs, parsed.against)
    print("\n".join([title, *map(str, findings)]))
    if failed := sum(finding.verdict == "FAIL" for finding in findings):
        raise CheckFailed(f"the submission fails {failed} of {len(findings)} properties")


COMMANDS: dict[str, Callable[[Sequence[str]], None]] = {
    "list": list_choices,
    "train": train,
    "grid": grid,
    "evaluate": evaluate,
    "video": video,
    "table": table,
    "figure": figure,
    "report": report,
    "probe": probe,
    "new-method": new_method,
    "check": check,
    "publish": publish,
    "submit-check": submit_check,
}


def main() -> NoReturn:
    """Run the command in `sys.argv` and exit with a code that `USAGE` explains; errors take one line on stderr."""
    command, *arguments = sys.argv[1:] or ["--help"]
    if command in ("-h", "--help"):
        print(USAGE)
        sys.exit(0)
    try:
        if command not in COMMANDS:
            raise ValueError(f"unknown command {command!r}; the commands are {', '.join(COMMANDS)}")
        COMMANDS[command](arguments)
        sys.stdout.flush()
    except BrokenPipeError:  # as in `curiobench list | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # which is flushed once more at exit
        sys.exit(128 + signal.SIGPIPE)
    except ValueError as error:
        _exit(error, 2)
    except (RunFailed, CheckFailed) as error:
        _exit(error, 1)
    except Interrupted as error:
        _exit(error, 128 + error.signal_number)
    except KeyboardInterrupt:
        _exit("stopped at once", 130)
    except OSError as error:  # such as a folder without the right to look into it
        _exit(f"{error.filename}: {error.strerror}" if error.filename else error, 2)
    sys.exit(0)


def _exit(message: object, code: int) -> NoReturn:
    print(f"curiobench: {one_line(message)}", file=sys.stderr)
    sys.exit(code)
