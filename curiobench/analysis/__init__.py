"""From runs to results: frames, statistics, tables, figures, reports, and the published sets, which `load` reads."""

from pathlib import Path
from typing import TYPE_CHECKING

from curiobench.analysis.folders import available, locate
from curiobench.errors import needs_train

if TYPE_CHECKING:
    from curiobench.analysis.frames import Results

__all__ = ["available", "load"]


def load(name: str | Path) -> "Results":
    """Published results by name, one of `available()` such as "v2", or by the path of a published set.

    Raises ValueError where there is no such set, or a file of it is damaged, ImportError without the extra `train`.
    """
    with needs_train():
        from curiobench.analysis.frames import read_results  # pandas takes half a second to import
    results = read_results([locate(name)])
    if results.faults:
        raise ValueError("; ".join(results.faults))
    return results
