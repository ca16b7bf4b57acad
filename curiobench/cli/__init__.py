"""The command line. Importing it needs neither torch nor MuJoCo."""

from curiobench.cli.commands import main

__all__ = ["main"]
