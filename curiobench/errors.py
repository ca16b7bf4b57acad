"""How a run ends early, and how that is told."""


class RunFailed(Exception):
    """A run stopped because of a fault in it; one line. What was written and its last checkpoint are kept."""


class CheckFailed(Exception):
    """A curiosity method breaks a rule; one line, after the report."""


class Interrupted(Exception):
    """A run stopped because it was asked to, after a checkpoint."""

    def __init__(self, message: str, signal_number: int) -> None:
        super().__init__(message)
        self.signal_number = signal_number


def one_line(message: object) -> str:
    """A message, which may hold text from files, as one line that a terminal shows and does not obey."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(message))
