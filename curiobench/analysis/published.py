"""The published results that come with this package, as pandas frames; no network is needed."""

import hashlib
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from curiobench.analysis.folders import PUBLISHED_FILES

if TYPE_CHECKING:
    from curiobench.analysis.frames import Results

SUMS = "SHA256SUMS"
"""Digests of a set's files, as `sha256sum --check` reads them."""
_VERSION = re.compile(r"v[1-9]\d*")
_MAX_SUMS_BYTES = 1 << 20


def available() -> list[str]:
    """Names of the published sets that come with this package, oldest first."""
    home = _home()
    names = [path.name for path in home.iterdir() if _VERSION.fullmatch(path.name)] if home.is_dir() else []
    return sorted(
        (name for name in names if all((home / name / file).is_file() for file in PUBLISHED_FILES)),
        key=lambda name: int(name[1:]),
    )


def load(name: str | Path) -> "Results":
    """Published results as pandas frames.

    Args:
        name: one of `available()`, such as "v1", or the path of a published set.

    Returns:
        `Results` with the frames `runs` (a row a run), `evaluations` (a row a run, evaluation and goal), `layers` (a
        row a run, evaluation and layer) and `progress` (a row a run and epoch); docs/results.md tells their columns.

    Raises:
        ValueError: there is no such set, or a file of it is damaged.
    """
    from curiobench.analysis.frames import read_results  # pandas takes half a second to import

    folder = locate(name)
    results = read_results([folder])
    if results.faults:
        raise ValueError("; ".join(results.faults))
    return results


def locate(name: str | Path) -> Path:
    """Folder of a published set by its name or path; raises ValueError where there is none."""
    if isinstance(name, str) and name in available():
        return _home() / name
    path = Path(name)
    if all((path / file).is_file() for file in PUBLISHED_FILES):
        return path
    names = ", ".join(available()) or "none yet"
    raise ValueError(
        f"there are no published results {str(name)!r}: available are {names}, and paths of published sets"
    )


def by_name(path: Path) -> Path:
    """The folder of the set that comes with this package under a name such as v1; any other path as it is."""
    name = str(path)
    return _home() / name if _VERSION.fullmatch(name) and not os.path.lexists(path) and name in available() else path


def check_sums(folder: Path, files: tuple[str, ...] = PUBLISHED_FILES) -> None:
    """Raises ValueError where files of a published set are not those that its SHA256SUMS tell of."""
    sums = read_sums(folder)
    for file in files:
        try:
            if not (folder / file).is_file():
                raise ValueError(f"{folder / file} is no file")
            found = hashlib.sha256((folder / file).read_bytes()).hexdigest()
        except OSError as error:
            raise ValueError(f"cannot read {folder / file}: {error.strerror}") from None
        if sums.get(file) != found:
            raise ValueError(f"{folder / file} is not the file that was published: {SUMS} has another digest of it")


def read_sums(folder: Path) -> dict[str, str]:
    """Digest by file, from a set's SHA256SUMS; raises ValueError where it cannot be read."""
    path = folder / SUMS
    try:
        if path.exists() and not (path.is_file() and path.stat().st_size <= _MAX_SUMS_BYTES):
            raise ValueError(f"{path} is no file of at most {_MAX_SUMS_BYTES:,} bytes")
        lines = path.read_text("utf-8", errors="replace").splitlines()
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror}") from None
    return {file: digest for digest, _, file in (line.partition("  ") for line in lines)}


def _home() -> Path:
    """Folder of the published sets: `curiobench/published` where installed, `results` in a working copy."""
    package = Path(__file__).resolve().parents[1]
    working_copy = package.parent / "pyproject.toml"
    return package.parent / "results" if working_copy.exists() else package / "published"
