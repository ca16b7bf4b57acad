"""Text for terminals of any width, and streams that nobody reads any longer.

What has to be pasted, such as a path or a command, is never broken.
"""

import os
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence
from typing import TextIO

ROOM = 30
"""Columns that a description needs beside its name; with fewer it stands below."""


def draws() -> bool:
    """Whether output goes to a terminal that understands control codes."""
    return sys.stdout.isatty() and os.environ.get("TERM") != "dumb"


def settle(stream: TextIO) -> None:
    """Flush a stream. If that fails, redirect it to /dev/null, so that the flush at the exit does not fail too."""
    try:
        stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def width() -> int | None:
    """Columns of the terminal, or what the variable COLUMNS says; None if the output is not a terminal."""
    return shutil.get_terminal_size((0, 0)).columns or None


def wrapped(text: str, columns: int | None, first: str = "", rest: str = "") -> str:
    """Text broken between words, its lines indented by `first` and `rest`; one line where `columns` is None."""
    if columns is None:
        return first + text
    return textwrap.fill(
        text,
        columns,
        initial_indent=first,
        subsequent_indent=rest,
        break_long_words=False,
        break_on_hyphens=False,
    )


def described(lines: Mapping[str, str], columns: int | None) -> str:
    """A name and its description a line, the names indented by two."""
    left = max(map(len, lines)) + 4
    if columns is None or columns >= left + ROOM:
        shown = (wrapped(text, columns, f"  {name:<{left - 2}}", " " * left) for name, text in lines.items())
    else:
        shown = (f"  {name}\n{wrapped(text, columns, ' ' * 4, ' ' * 4)}" for name, text in lines.items())
    return "\n".join(shown)


def align(lines: Sequence[Sequence[str]], left: int) -> str:
    """Columns side by side, the first `left` of them flush left."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(
            cell.ljust(w) if i < left else cell.rjust(w) for i, (cell, w) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    )
