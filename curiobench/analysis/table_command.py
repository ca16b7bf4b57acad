"""What `curiobench table` does: reads runs, makes the tables that were asked for, and writes them."""

import os
import shutil
import sys
from collections.abc import Callable, Sequence
from os.path import isfile
from pathlib import Path
from typing import TYPE_CHECKING

from curiobench.analysis.frames import Results, read_results, tell_faults
from curiobench.analysis.paper_tables import flat_paper_table, paper_tables
from curiobench.analysis.summaries import summarise
from curiobench.analysis.table_formats import comma_separated, latex, markdown, terminal
from curiobench.analysis.tables import Table, flat_table, method_tables, run_table
from curiobench.files import replace_file
from curiobench.methods.specs import shown
from curiobench.workers import cores

if TYPE_CHECKING:
    from curiobench.arguments import TableArguments

SUFFIXES = {"terminal": "txt", "markdown": "md", "latex": "tex", "csv": "csv"}
"""File names of the formats."""
RUN_COLUMNS = ("run", "task", "method", "variant", "seed", "epoch", "steps", "complete", "git_commit", "command")
"""What is written down about the runs that a table was made from."""

_WRITERS: dict[str, Callable[[Sequence[Table]], str]] = {
    "terminal": terminal,
    "markdown": markdown,
    "latex": latex,
}


def show_tables(arguments: "TableArguments") -> None:
    """Print tables of runs, and write them where asked to; then name on stderr the runs that are not in them.

    Raises ValueError, after the tables, where a path that was asked for is not in them, or there is nothing to show.
    """
    if arguments.like and arguments.each_run:
        raise ValueError("--like paper and --each-run are different tables; ask for one of them")
    single = len(arguments.runs) == 1 and isfile(arguments.runs[0] / "config.json")
    each_run = arguments.each_run or (single and arguments.like is None)
    if arguments.baseline and (each_run or arguments.like):
        other = "--like paper" if arguments.like else "single runs"
        raise ValueError(f"--baseline is for the tables of methods, not for {other}")
    partial = arguments.partial or each_run
    results = read_results(arguments.runs, partial, every_goal=False, progress=False, processes=cores())
    if not results.runs.empty:
        tables, flat, name = _tables(arguments, results, each_run)
        if arguments.format == "csv":
            print(comma_separated(flat))
        elif arguments.format == "terminal":
            print(terminal(tables, shutil.get_terminal_size().columns if sys.stdout.isatty() else None, _colour()))
        else:
            print(_WRITERS[arguments.format](tables))
        if arguments.out is not None:
            _write(arguments.out, name, tables, flat, results)
    tell_faults(results, "table")
    if results.runs.empty:
        raise ValueError("there is no run to show")


def _colour() -> bool:
    return sys.stdout.isatty() and "NO_COLOR" not in os.environ


def _tables(arguments: "TableArguments", results: Results, each_run: bool) -> tuple[list[Table], Table, str]:
    """Tables to look at, one that holds all their numbers, and a name for their files."""
    if each_run:
        return [run_table(results)], run_table(results, flat=True), "runs"
    if arguments.like == "paper":
        tables = paper_tables(results)
        return tables, flat_paper_table(tables), "paper"
    baseline = shown(arguments.baseline or "sac")
    methods = list(dict.fromkeys(results.runs["method"]))
    if arguments.baseline and baseline not in methods:
        raise ValueError(f"no run is of the baseline {baseline!r}; there are {', '.join(methods)}")
    summaries = summarise(results, baseline)
    return method_tables(results, summaries, baseline), flat_table(summaries, baseline), "table"


def _write(folder: Path, name: str, tables: list[Table], flat: Table, results: Results) -> None:
    """Write tables in all formats, which runs are in them, and which are not; raises ValueError where it cannot."""
    *others, last = tables
    left_out = tuple(f"left out: {fault}" for fault in results.faults)
    tables = [*others, Table(last.title, last.columns, last.rows, (*last.notes, *left_out))]
    texts = {form: write(tables) for form, write in _WRITERS.items()} | {"csv": comma_separated(flat)}
    files = {f"{name}.{SUFFIXES[form]}": text + "\n" for form, text in texts.items()}
    files[f"{name}_made_from.csv"] = results.runs[list(RUN_COLUMNS)].to_csv(index=False, lineterminator="\n")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file, text in files.items():
            replace_file(folder / file, lambda stream, text=text: stream.write(text.encode()))
    except OSError as error:
        raise ValueError(f"cannot write to {folder}: {error.strerror}") from None
