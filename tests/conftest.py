"""A finished run, made once, and the command line in this process."""

import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")


@pytest.fixture(autouse=True)
def _no_width(monkeypatch):
    """pytest-xdist sets COLUMNS, by which commands break their lines."""
    monkeypatch.delenv("COLUMNS", raising=False)


@pytest.fixture(scope="session")
def finished(tmp_path_factory) -> Path:
    """Folder of a finished run of TINY; not to be altered."""
    from tiny_runs import TINY  # needs torch, which many tests do not

    from curiobench.training import train

    path = tmp_path_factory.mktemp("runs") / "finished"
    train(TINY, path)
    return path


@pytest.fixture
def cli(monkeypatch, capsys):
    """Runs a command in this process; gives exit code, stdout and stderr."""
    from curiobench.cli import main

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["curiobench", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, *capsys.readouterr()

    return call
