"""What a command says of the folders that its result leaves out."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from curiobench.errors import one_line

if TYPE_CHECKING:
    from curiobench.analysis.frames import Results


def check_named(paths: Sequence[Path]) -> None:
    """Raise ValueError where no path was given."""
    if not paths:
        raise ValueError("name at least one run folder, folder of run folders or published set")


def tell_faults(results: "Results", what: str) -> None:
    """Print a line on each folder that is left out to stderr.

    Raises ValueError, one line, that names those which were asked for by their path: they are not in the `what`.
    """
    for fault in results.faults:
        if fault not in results.absent:
            print(f"curiobench: {one_line(fault)}", file=sys.stderr)
    if results.absent:
        raise ValueError(f"not in the {what}: " + "; ".join(results.absent))
