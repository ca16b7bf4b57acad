"""How a run ends early: errors, and requests to stop."""

import shlex
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Self


class RunFailed(Exception):
    """A run stopped because of a fault in it; one line. What was written and its last checkpoint are kept."""


class CheckFailed(Exception):
    """A curiosity method or a submission breaks a rule; one line, after the report."""


class Interrupted(Exception):
    """A run stopped because it was asked to, after a checkpoint."""

    def __init__(self, message: str, signal_number: int) -> None:
        super().__init__(message)
        self.signal_number = signal_number


OF_TRAIN = ("torch", "numba", "scipy", "pandas", "matplotlib", "rich", "safetensors", "yaml", "jinja2")
"""Modules that the extra `train` installs. The environments need none of them."""


def missing_extra(error: ModuleNotFoundError) -> str:
    """What to install where a module of the extra `train` is missing, one line; raises the error if it is another."""
    module = (error.name or "").partition(".")[0]
    if module not in OF_TRAIN:
        raise error
    return f"{module} is not installed; training and results need the extra `train`: pip install 'curiobench[train]'"


@contextmanager
def needs_train() -> Iterator[None]:
    """Within a `with` block, a missing module of the extra `train` raises ImportError that says what to install."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise ImportError(missing_extra(error)) from None


class StopRequest:
    """Counts Ctrl-C and SIGTERM within a `with` block. They do not end the process.

    Attributes:
        count: signals so far.
        number: the first of them; 0 where there is none.
    """

    def __init__(self, once: bool = False) -> None:
        """With `once`, only the first of each signal is counted. The second ends the process as usual."""
        self.count = self.number = 0
        self._once = once

    def __enter__(self) -> Self:
        signals = (signal.SIGINT, signal.SIGTERM)
        here = threading.current_thread() is threading.main_thread()  # Python delivers signals to no other thread
        self._before = {s: signal.signal(s, self._note) for s in signals} if here else {}
        return self

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.number = self.number or number
        self.count += 1
        if self._once:
            signal.signal(number, self._before[number])

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)


def pasted(path: Path) -> str:
    """A path as a shell understands it in a command."""
    text = str(path)
    return shlex.quote(f"./{text}" if text.startswith("-") else text)


def one_line(message: object) -> str:
    """A message, which may hold text from files, as one line without control characters."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(message))
