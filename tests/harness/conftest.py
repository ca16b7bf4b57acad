"""A finished run, made once."""

from pathlib import Path

import pytest
from tiny_runs import TINY

from curiobench.train import train


@pytest.fixture(scope="session")
def finished(tmp_path_factory) -> Path:
    """Folder of a finished run of TINY; not to be altered."""
    path = tmp_path_factory.mktemp("runs") / "finished"
    train(TINY, path)
    return path
