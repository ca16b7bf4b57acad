"""From runs to results: frames, statistics, tables, figures, reports, and the published sets, which `load` reads."""

from typing import TYPE_CHECKING

from curiobench.analysis.folders import available
from curiobench.errors import missing_extra

if TYPE_CHECKING:
    from curiobench.analysis.frames import load

__all__ = ["available", "load"]


def __getattr__(name: str):
    if name == "load":  # imported on first use: pandas takes half a second
        try:
            from curiobench.analysis.frames import load
        except ModuleNotFoundError as error:
            raise ImportError(missing_extra(error)) from None
        return load
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
