"""Results: runs as frames, statistics, tables, figures and reports; `load` gives the published sets."""

from curiobench.analysis.published import available, load

__all__ = ["available", "load"]
