"""The config.json files behind the runs of a frame."""

from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from curiobench.files import read_json
from curiobench.results.folders import look
from curiobench.results.reading import MAX_JSON_BYTES

CONFIGS = "configs"
"""Folder of a published set with each run's config.json, named after the run."""


def config_files(runs: Sequence[str], paths: Sequence[Path]) -> dict[str, Path]:
    """Where the config.json of each run is.

    Args:
        runs: names, as `read_results(paths)` gives them.
        paths: run folders, folders of run folders, published sets.

    Raises:
        ValueError: a run of a published set whose config is not there.
    """
    homes: dict[tuple[str, ...], Path] = {}
    for path in paths:
        for folder, file in _homes(path).items():
            for depth in range(1, len(folder.parts) + 1):
                homes.setdefault(folder.parts[-depth:], file)
    found = {run: homes.get(PurePosixPath(run).parts) for run in runs}
    for run, file in found.items():
        if file is None or not file.is_file() or file.stat().st_size > MAX_JSON_BYTES:
            raise ValueError(f"there is no config.json of {run}, of at most {MAX_JSON_BYTES:,} bytes")
    return found


def _homes(path: Path) -> dict[Path, Path]:
    """Folders of the runs that a path stands for, and their config.json; none where it stands for none."""
    try:
        found = look(path)
    except ValueError:
        return {}
    if found.published:
        return {path / file.stem: file for file in sorted((path / CONFIGS).glob("*.json"))}
    return {folder: folder / "config.json" for folder in found.runs}


def read_records(runs: Sequence[str], paths: Sequence[Path]) -> dict[str, dict[str, Any]]:
    """What config.json of each run holds; raises ValueError as `config_files`, and where one cannot be read."""
    return {run: read_json(file) for run, file in config_files(runs, paths).items()}
