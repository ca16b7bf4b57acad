"""curiobench: which curiosity method helps a robot arm that is rewarded only at its goal?"""

from curiobench.tasks.registration import register

__version__ = "0.1.0"

register()  # gymnasium.make("curiobench/SemanticStack3-v0") works once curiobench is imported


def __getattr__(name: str):
    # imported on first use, so that `import curiobench` stays quick
    if name == "analysis":
        import curiobench.analysis

        return curiobench.analysis
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
