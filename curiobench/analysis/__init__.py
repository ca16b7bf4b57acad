"""From runs to results: frames, statistics, tables, figures, reports, and the published sets, which `load` reads."""

from typing import TYPE_CHECKING

from curiobench.analysis.folders import available

if TYPE_CHECKING:
    from curiobench.analysis.frames import load

__all__ = ["available", "load"]


def __getattr__(name: str):
    if name == "load":  # imported on first use: pandas takes half a second
        from curiobench.analysis.frames import load

        return load
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
