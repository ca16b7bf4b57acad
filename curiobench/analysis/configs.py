"""The config.json files behind the runs of a frame."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from curiobench.analysis.reading import MAX_JSON_BYTES
from curiobench.files import read_json

if TYPE_CHECKING:
    from curiobench.analysis.frames import Results


def config_files(results: "Results") -> dict[str, Path]:
    """Where the config.json of each run is.

    Raises:
        ValueError: a run of a published set whose config is not there.
    """
    for run, file in results.config_files.items():
        if not file.is_file() or file.stat().st_size > MAX_JSON_BYTES:
            raise ValueError(f"there is no config.json of {run}, of at most {MAX_JSON_BYTES:,} bytes")
    return results.config_files


def read_records(results: "Results") -> dict[str, dict[str, Any]]:
    """What config.json of each run holds; raises ValueError as `config_files`, and where one cannot be read."""
    return {run: read_json(file) for run, file in config_files(results).items()}
