"""How the arguments of the commands are parsed."""

import inspect
import io
import os
import re
from collections.abc import Sequence
from contextlib import redirect_stderr
from itertools import pairwise
from typing import TypeVar

import tyro

from curiobench import terminal

Arguments = TypeVar("Arguments")


def parse_arguments(
    kind: type[Arguments], command: str, arguments: Sequence[str], default: Arguments | None = None
) -> Arguments:
    """Read the arguments of a command.

    Args:
        kind: dataclass of the command's arguments; its docstrings are the help.
        command: its name.
        arguments: what follows the command.
        default: values of what is not given.

    Raises:
        ValueError: an argument is unknown or has an illegal value; one line.
        SystemExit: on `--help`, after showing it.
    """
    for flag, argument in pairwise(["an argument", *arguments]):
        if argument == "" or re.fullmatch(r"--[\w.-]+=", argument):  # an empty path would mean the current folder
            raise ValueError(f"{(argument or flag).rstrip('=')} is empty")
    messages = io.StringIO()
    tyro._experimental_options["ansi_codes"] = "NO_COLOR" not in os.environ  # tyro ignores NO_COLOR
    try:
        with redirect_stderr(messages):
            return tyro.cli(
                kind, prog=f"curiobench {command}", description=_about(kind), args=list(arguments), default=default
            )
    except SystemExit as exit_:
        if not exit_.code:
            raise
        raise ValueError(_one_line(messages.getvalue())) from None


def _about(kind: type) -> str:
    """The docstring of a command's arguments, as wide as the terminal; tyro breaks the lines of options alone."""
    paragraphs = inspect.cleandoc(kind.__doc__ or "").split("\n\n")
    columns = terminal.width()
    # the indent keeps the breaks: tyro joins lines that begin with a letter
    return "\n\n".join(terminal.wrapped(" ".join(paragraph.split()), columns, "", "  ") for paragraph in paragraphs)


def _one_line(box: str) -> str:
    """The message in a box as tyro draws it: its first section, and the flag that it suggests."""
    rows = re.sub(r"\x1b\[[\d;]*m", "", box).splitlines()
    # where the output is not UTF-8 there is no box, but a headline, and a line of dashes between sections
    framed = [row for row in rows if row.startswith("│")] or [row for row in rows if row.strip()][2:]
    sections = re.split(r"\n[─-]+\n", "\n".join(row.strip("│ ") for row in framed))
    message = " ".join(sections[0].split())
    if suggested := re.search(r"Perhaps you meant:\n(\S+)", "\n".join(sections[1:])):
        message += f"; perhaps you meant {suggested[1]}"
    return message
