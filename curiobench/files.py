"""Files written atomically: after a kill at any moment there is the old file or the new one."""

import errno
import json
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

MAX_JSON_BYTES = 1 << 24  # of a file that is read: configs, results and records of grids take far less
_NO_SYNC = (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP)
"""What fsync answers on file systems without it, such as some network ones."""


def size_of(path: Path) -> int:
    """Bytes in a file, 0 where there is none."""
    return path.stat().st_size if path.exists() else 0


def replace_file(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Write a temporary file, then rename it: a kill or power cut at any moment leaves the old file or the new one.

    Raises OSError where there is no space or no right to write; the old file is kept and the attempt removed.
    """
    partial = path.with_name(path.name + ".partial")
    try:
        with open(partial, "wb") as file:
            write(file)
            file.flush()
            sync(file.fileno())
        os.replace(partial, path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Make renames in a folder survive a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        sync(descriptor)
    finally:
        os.close(descriptor)


def sync(descriptor: int) -> None:
    """Wait until a file is on its disk, where the file system can tell; raises OSError where it cannot be written."""
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _NO_SYNC:
            raise


def writing_to(path: Path) -> AbstractContextManager[None]:
    """Turn an OSError into a ValueError, one line, that names what could not be written."""
    return _named(f"cannot write to {path}")


def reading(path: Path) -> AbstractContextManager[None]:
    """Turn an OSError into a ValueError, one line, that names what could not be read."""
    return _named(f"cannot read {path}")


def read_content(path: Path) -> bytes:
    """The bytes of a file. Raises ValueError if it cannot be read."""
    with reading(path):
        return path.read_bytes()


@contextmanager
def _named(what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise ValueError(f"{what}: {error.strerror or error}") from None


def now() -> str:
    """The time in UTC, to the second, as records hold it."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def write_json(path: Path, values: Any) -> None:
    """Replace a file by plain values as JSON; raises ValueError on NaN or infinity, OSError as `replace_file`."""
    text = json.dumps(values, indent=2, allow_nan=False, ensure_ascii=False)
    replace_file(path, lambda file: file.write(utf8(text + "\n")))


def utf8(text: str) -> bytes:
    r"""Text as UTF-8. A byte of a path that is not UTF-8, such as 0xff, becomes `\udcff`, which JSON reads back."""
    return text.encode(errors="backslashreplace")


def check_size(path: Path, most: float) -> None:
    """Raises ValueError unless a path is a regular file of at most `most` bytes."""
    if not (path.is_file() and path.stat().st_size <= most):
        raise ValueError(f"not a regular file, or larger than {most / 2**20:g} MiB")


def read_json(path: Path, most: float = MAX_JSON_BYTES) -> dict[str, Any]:
    """Read a JSON object from a file of at most `most` bytes; otherwise raise ValueError naming the file."""
    try:
        if path.exists():
            check_size(path, most)
        values = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"cannot read {path}: {error}") from None
    if not isinstance(values, dict):
        raise ValueError(f"cannot read {path}: it does not hold a JSON object")
    return values
