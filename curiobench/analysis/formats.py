"""Conversion of tables to text for the terminal, markdown, LaTeX and csv, and the command `curiobench table`."""

import io
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from os.path import isfile
from pathlib import Path

import numpy as np
import pandas as pd
from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table as Grid
from rich.text import Text

from curiobench.analysis.frames import Results, print_faults, read_results
from curiobench.analysis.paper import flat_paper_table, paper_tables
from curiobench.analysis.rows import IDENTITY
from curiobench.analysis.samples import task_samples
from curiobench.analysis.tables import Column, Estimate, Table, Value, flat_table, method_tables, run_tables, summarise
from curiobench.cli.arguments import TableArguments
from curiobench.files import replace_file, utf8, writing_to
from curiobench.methods.specs import display_name
from curiobench.terminal import draws, wrapped
from curiobench.terminal import width as terminal_width
from curiobench.workers import cores

MISSING = "–"  # printed for a missing value
MADE_FROM = [*IDENTITY, "epoch", "steps", "complete", "git_commit", "command"]
"""Columns of the csv file that lists the runs in a table."""
_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "–": "--",
} | {character: f"\\{character}" for character in "&%$#_{}"}

_TO_FIT = r"  \resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%"  # scale only tables wider than the text

Tables = tuple[str, Sequence[Table], pd.DataFrame]
"""Name of the files, tables for readers, and one frame with all numbers for csv."""


def terminal(tables: Sequence[Table], width: int | None = None, colour: bool = False) -> str:
    """Tables as plain text, with escape codes for bold text if `colour`.

    Cells and notes are wrapped between words to at most `width` columns per line. A table whose words do not fit is
    wider. Names of runs are not wrapped.
    """
    console = Console(file=io.StringIO(), width=10_000, force_terminal=colour, no_color=True, highlight=False)
    for place, table in enumerate(tables):
        if place:
            console.print()
        console.print(Text(wrapped(table.title, width), "bold"), end="\n\n")
        grid = _grid(table)
        least = Measurement.get(console, console.options, grid).minimum
        console.print(grid, width=max(width or console.width, least))
        for note in table.notes:
            console.print(Text(wrapped(note, width, "  ", "  ")))
    return re.sub(r" +$", "", console.file.getvalue().rstrip("\n"), flags=re.MULTILINE)


def _grid(table: Table) -> Grid:
    """A rich table. Each column is at least as wide as its longest word."""
    grid, rows = Grid(box=box.SIMPLE, pad_edge=False, show_edge=False), _cells(table)
    for column, cells in zip(table.columns, zip(*rows, strict=True), strict=True):
        texts = [column.heading, *(text for text, _ in cells)]
        unbroken = texts if column.key == "run" else " ".join(texts).split()
        justify = "right" if _is_number(table, column) else "left"
        grid.add_column(Text(column.heading), justify=justify, min_width=max(map(len, unbroken)))
    for cells in rows:
        grid.add_row(*(Text(text, "bold" if best else "") for text, best in cells))
    return grid


def markdown(tables: Sequence[Table]) -> str:
    """Tables in GitHub-flavoured markdown."""
    parts = []
    for table in tables:
        heads = [_markdown(column.heading) for column in table.columns]
        rules = ["---:" if _is_number(table, column) else "---" for column in table.columns]
        rows = [[f"{'**' * best}{_markdown(text)}{'**' * best}" for text, best in cells] for cells in _cells(table)]
        lines = [f"| {' | '.join(cells)} |" for cells in (heads, rules, *rows)]
        notes = [f"- {_markdown(note)}" for note in table.notes]
        parts += filter(None, (f"**{_markdown(table.title)}**", "\n".join(lines), "\n".join(notes)))
    return "\n\n".join(parts)


def _markdown(text: str) -> str:
    return re.sub(r"([\\`*_|<>\[\]])", r"\\\1", text)


def latex(tables: Sequence[Table]) -> str:
    r"""Tables in LaTeX, for `\input`, with labels made from titles. They need the packages booktabs and graphicx."""
    parts = []
    for table in tables:
        kinds = "".join("r" if _is_number(table, column) else "l" for column in table.columns)
        rows = [[_latex(column.heading) for column in table.columns]]
        for cells in _cells(table):
            rows.append([rf"\textbf{{{_latex(text)}}}" if best else _latex(text) for text, best in cells])
        head, *body = [f"    {' & '.join(cells)} \\\\" for cells in rows]
        caption = _latex(". ".join([table.title, *table.notes]) + ".")
        label = "-".join(re.findall(r"[a-z0-9]+", table.title.lower()))
        lines = [r"\begin{table}", r"  \centering", rf"  \caption{{{caption}}}", rf"  \label{{tab:{label}}}", _TO_FIT]
        lines += [rf"  \begin{{tabular}}{{{kinds}}}", r"    \toprule", head, r"    \midrule", *body, r"    \bottomrule"]
        parts.append("\n".join([*lines, r"  \end{tabular}}", r"\end{table}"]))
    return "\n\n".join(["% needs \\usepackage{booktabs,graphicx}", *parts])


def _latex(text: str) -> str:
    return "".join(_LATEX.get(character, character) for character in text)


WRITERS = {"terminal": (terminal, "txt"), "markdown": (markdown, "md"), "latex": (latex, "tex")}
"""Formats of the tables for readers: the function that writes each, and the suffix of its files."""


def comma_separated(frame: pd.DataFrame) -> str:
    """One table as csv, with a header row and unrounded numbers. Intervals are in the columns `…_low` and `…_high`."""
    columns = {}
    for name, values in frame.items():
        columns[name] = values
        if any(isinstance(value, Estimate) for value in values):
            ends = pd.DataFrame([value if isinstance(value, Estimate) else Estimate(value) for value in values])
            columns |= {name: ends["value"], f"{name}_low": ends["low"], f"{name}_high": ends["high"]}
    return pd.DataFrame(columns).to_csv(index=False, float_format="%.12g", lineterminator="\n").rstrip("\n")


def _is_number(table: Table, column: Column) -> bool:
    values = [row.get(column.key) for row in table.rows]
    return all(not isinstance(value, str) or value[:1].isdigit() for value in values)


def _cells(table: Table) -> list[list[tuple[str, bool]]]:
    """The values as text, each with whether it is bold."""
    best = {column.key: table.best(column) for column in table.columns}
    return [
        [
            (" ".join(filter(None, number_and_interval(row.get(column.key), column.digits))), best[column.key] == place)
            for column in table.columns
        ]
        for place, row in enumerate(table.rows)
    ]


def number_and_interval(value: Value, digits: int) -> tuple[str, str]:
    """A value and its interval as text; the interval is "" if there is none."""
    if value is None or value != value:
        return MISSING, ""
    if isinstance(value, Estimate):
        interval = "" if np.isnan(value.low) else f"[{value.low:.{digits}f}, {value.high:.{digits}f}]"
        return f"{value.value:.{digits}f}", interval
    return f"{value:.{digits}f}" if isinstance(value, float) else str(value), ""


def show_tables(arguments: TableArguments) -> None:
    """Print tables of runs and, with `--out`, write them to files. Then print the runs that are left out to stderr.

    Raises ValueError, after the tables, if a given path is not in them or there is no run.
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
        made = make_tables(results, arguments.like, arguments.baseline, each_run)
        print(_written(made, arguments.format))
        if arguments.out is not None:
            write_tables(arguments.out, made, results)
    print_faults(results, "table")
    if results.runs.empty:
        raise ValueError("there is no run to show")


def _written(made: Tables, form: str) -> str:
    _, tables, flat = made
    if form == "csv":
        return comma_separated(flat)
    if form != "terminal":
        return WRITERS[form][0](tables)
    return terminal(tables, terminal_width(), draws() and "NO_COLOR" not in os.environ)


def make_tables(
    results: Results, like: str | None = None, baseline: str | None = None, each_run: bool = False
) -> Tables:
    """The tables of at least one run. Raises ValueError if a baseline is given and has no run."""
    if each_run:
        table, flat = run_tables(results)
        return "runs", [table], flat
    chosen = check_baseline(results, baseline)
    summaries = summarise(task_samples(results), chosen)
    if like == "paper":
        tables = paper_tables(summaries)
        return "paper", tables, flat_paper_table(tables)
    return "table", method_tables(summaries, chosen), flat_table(summaries, chosen)


def check_baseline(results: Results, baseline: str | None) -> str:
    """The method that others are compared with, by default sac. Raises ValueError if `baseline` has no run."""
    methods, chosen = list(dict.fromkeys(results.runs["method"])), display_name(baseline or "sac")
    if baseline and chosen not in methods:
        raise ValueError(f"no run has the baseline {chosen!r}; the methods are {', '.join(methods)}")
    return chosen


def write_tables(folder: Path, made: Tables, results: Results) -> None:
    """Write tables in all formats, with notes on the runs left out, and a csv file of the runs in them.

    Raises ValueError if they cannot be written.
    """
    name, (*others, last), flat = made
    left_out = tuple(f"left out: {fault}" for fault in results.faults)
    tables = [*others, replace(last, notes=(*last.notes, *left_out))]
    files = {f"{name}.{suffix}": write(tables) + "\n" for write, suffix in WRITERS.values()}
    files[f"{name}.csv"] = comma_separated(flat) + "\n"
    files[f"{name}_made_from.csv"] = results.runs[MADE_FROM].to_csv(index=False, lineterminator="\n")
    with writing_to(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for file, text in files.items():
            replace_file(folder / file, lambda stream, text=text: stream.write(utf8(text)))
