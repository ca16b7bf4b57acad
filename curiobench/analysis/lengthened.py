"""Runs that were made longer, beside what they were before."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from curiobench.analysis.reading import Run


def longest(runs: Sequence[Run]) -> list[Run]:
    """The runs without those that are the beginning of another one: the same config but for its length, and rows."""
    kin: dict[str, list[Run]] = defaultdict(list)
    for run in runs:
        kin[run.head.lineage()].append(run)
    return [run for run in runs if not any(_begins(run, other) for other in kin[run.head.lineage()])]


def _begins(run: Run, other: Run) -> bool:
    """Whether the rows of one run are the first of a longer one; they are compared as means of layers."""
    size = len(run.layers["epoch"])
    return size < len(other.layers["epoch"]) and all(
        np.array_equal(values, other.layers[name][:size], equal_nan=True) for name, values in run.layers.items()
    )
