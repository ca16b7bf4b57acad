"""curiobench: which curiosity method helps a robot arm that is rewarded only at its goal?"""

from curiobench.errors import needs_train
from curiobench.tasks.registration import register

__version__ = "0.2.0"

register()  # gymnasium.make("curiobench/SemanticStack3-v0") works once curiobench is imported


_API = ("Agent", "Run", "load_agent", "load_run", "train")


def __getattr__(name: str):
    # imported on first use, so that `import curiobench` stays quick
    if name in _API:
        with needs_train():
            from curiobench import api
        return getattr(api, name)
    if name == "analysis":
        import curiobench.analysis

        return curiobench.analysis
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
