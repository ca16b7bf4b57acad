"""Tables as text for the terminal, markdown, LaTeX and csv."""

import csv
import io
import re
from collections.abc import Sequence

from curiobench.analysis.summaries import Estimate
from curiobench.analysis.tables import Column, Table, Value

_NUMBERS = (int, float, Estimate)
_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "–": "--",
} | {character: f"\\{character}" for character in "&%$#_{}"}


def terminal(tables: Sequence[Table], width: int | None = None, colour: bool = False) -> str:
    """Tables as plain text.

    Args:
        tables: to show.
        width: columns of the screen, to which long cells are wrapped; None for as many as it takes.
        colour: bold by terminal codes.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table as Grid
    from rich.text import Text

    console = Console(file=io.StringIO(), width=width or 10_000, force_terminal=colour, no_color=True, highlight=False)
    for place, table in enumerate(tables):
        grid = Grid(box=box.SIMPLE, pad_edge=False, show_edge=False)
        for column in table.columns:
            grid.add_column(Text(column.heading), justify="right" if _is_number(table, column) else "left")
        for cells in _cells(table):
            grid.add_row(*(Text(text, "bold" if best else "") for text, best in cells))
        if place:
            console.print()
        if table.title:
            console.print(Text(table.title, "bold"), end="\n\n")
        console.print(grid)
        for note in table.notes:
            console.print(Text(f"  {note}"))
    return re.sub(r" +$", "", console.file.getvalue().rstrip("\n"), flags=re.MULTILINE)


def markdown(tables: Sequence[Table]) -> str:
    """Tables as GitHub's markdown has them."""
    parts = []
    for table in tables:
        heads = [_markdown(column.heading) for column in table.columns]
        rules = ["---:" if _is_number(table, column) else "---" for column in table.columns]
        rows = [[f"{'**' * best}{_markdown(text)}{'**' * best}" for text, best in cells] for cells in _cells(table)]
        lines = [f"| {' | '.join(cells)} |" for cells in (heads, rules, *rows)]
        notes = [f"- {_markdown(note)}" for note in table.notes]
        title = [f"**{_markdown(table.title)}**"] if table.title else []
        parts += filter(None, ["\n".join(title), "\n".join(lines), "\n".join(notes)])
    return "\n\n".join(parts)


def _markdown(text: str) -> str:
    return re.sub(r"([\\`*_|<>\[\]])", r"\\\1", text)


def latex(tables: Sequence[Table]) -> str:
    r"""Tables in LaTeX, for `\input`; they need the package booktabs."""
    parts = []
    for table in tables:
        kinds = "".join("r" if _is_number(table, column) else "l" for column in table.columns)
        rows = [[_latex(column.heading) for column in table.columns]]
        for cells in _cells(table):
            rows.append([rf"\textbf{{{_latex(text)}}}" if best else _latex(text) for text, best in cells])
        head, *body = [f"    {' & '.join(cells)} \\\\" for cells in rows]
        lines = [r"\begin{table}", r"  \centering", rf"  \caption{{{_latex(_sentence(table))}}}"]
        lines += [rf"  \begin{{tabular}}{{{kinds}}}", r"    \toprule", head, r"    \midrule", *body, r"    \bottomrule"]
        parts.append("\n".join([*lines, r"  \end{tabular}", r"\end{table}"]))
    return "\n\n".join(["% needs \\usepackage{booktabs}", *parts])


def _sentence(table: Table) -> str:
    return ". ".join([table.title, *table.notes]) + "."


def _latex(text: str) -> str:
    return "".join(_LATEX.get(character, character) for character in text)


def comma_separated(table: Table) -> str:
    """One table as csv: a header row, numbers in full, an interval in the columns `…_low` and `…_high`."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    intervals = {column.key for column in table.columns if any(_is_estimate(row, column) for row in table.rows)}
    writer.writerow([name for column in table.columns for name in _csv_names(column.key, column.key in intervals)])
    for row in table.rows:
        writer.writerow(
            [cell for column in table.columns for cell in _csv_cells(row.get(column.key), column.key in intervals)]
        )
    return text.getvalue().rstrip("\n")


def _is_estimate(row: dict[str, Value], column: Column) -> bool:
    return isinstance(row.get(column.key), Estimate)


def _csv_names(key: str, interval: bool) -> list[str]:
    return [key, f"{key}_low", f"{key}_high"] if interval else [key]


def _csv_cells(value: Value, interval: bool) -> list[str]:
    numbers = [value.value, value.low, value.high] if isinstance(value, Estimate) else [value, None, None]
    cells = ["" if number is None or number != number else _plain(number) for number in numbers]
    return cells if interval else cells[:1]


def _plain(value: str | int | float) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def _is_number(table: Table, column: Column) -> bool:
    values = [row.get(column.key) for row in table.rows]
    texts = [value for value in values if value is not None]
    return all(isinstance(value, _NUMBERS) or value[:1].isdigit() for value in texts)


def _cells(table: Table) -> list[list[tuple[str, bool]]]:
    """The values as text, and whether each is the best of its column beyond doubt."""
    best = {column.key: table.best(column) for column in table.columns}
    return [
        [(_show(row.get(column.key), column.digits), best[column.key] == place) for column in table.columns]
        for place, row in enumerate(table.rows)
    ]


def _show(value: Value, digits: int) -> str:
    if value is None or value != value:
        return "–"
    if isinstance(value, Estimate):
        if not value.has_interval:
            return f"{value.value:.{digits}f}"
        return f"{value.value:.{digits}f} [{value.low:.{digits}f}, {value.high:.{digits}f}]"
    return f"{value:.{digits}f}" if isinstance(value, float) else str(value)
