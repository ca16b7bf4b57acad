"""Ctrl-C and SIGTERM: the first asks the cells to end after a checkpoint, the second ends them at once."""

import signal
from types import FrameType
from typing import Self


class StopRequest:
    """Counts signals while it is entered."""

    def __init__(self) -> None:
        self.count = 0
        """Signals so far."""
        self.number = 0
        """The first of them."""

    def __enter__(self) -> Self:
        self._before = {s: signal.signal(s, self._note) for s in (signal.SIGINT, signal.SIGTERM)}
        return self

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.number = self.number or number
        self.count += 1

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
