"""The folder of a run: config.json, progress.csv, evaluations.csv, checkpoint/, result.json; see docs/training.md."""

import csv
import fcntl
import io
import os
import shutil
import time
from collections.abc import Container, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from curiobench.config import CONFIG_VERSION, RunConfig, differences
from curiobench.errors import pasted
from curiobench.files import now, read_json, size_of, sync, write_json, writing_to
from curiobench.versions import versions

RUN_FORMAT = "curiobench run"
CHECKPOINT = Path("checkpoint")
"""Folder of the checkpoints, within the run's."""
REPLAY = CHECKPOINT / "replay"
"""Folder of the episodes that the checkpoints refer to, within the run's."""
_LOCK = ".lock"
_BEFORE_CONFIG = {_LOCK, "config.json.partial"}
"""Files that may exist before config.json, if the run was killed early."""
_LOCK_ATTEMPTS, _LOCK_PAUSE = 4, 0.05
"""`is_locked` holds the lock for an instant."""
CSV_FILES = ("progress.csv", "evaluations.csv")


class RunFolder(AbstractContextManager):
    """A run folder opened for training, locked against a second process; close it, or use it in a with statement."""

    def __init__(self, path: Path, config: RunConfig, resume: bool, command: Sequence[str] = ()) -> None:
        """
        Args:
            path: of the folder; created if it does not exist.
            config: of the run.
            resume: continue the run in the folder, which has the same config or fewer epochs; start one if the folder
                has none.
            command: the command line, for the record.

        Raises ValueError if the folder cannot be written, is in use, is finished, or holds something else.
        """
        self.path, self.config = path, config
        self._longer: dict[str, Any] | None = None
        self._created, self._begun = not path.exists(), False
        self._new_lock = not (path / _LOCK).exists()
        with writing_to(path):
            path.mkdir(parents=True, exist_ok=True)
            self._lock = _lock(path / _LOCK)
        try:
            self._claim(resume, command)
        except BaseException:
            self.withdraw()
            raise

    def withdraw(self) -> None:
        """Close the folder, and remove what this process made in it, where the run could not be begun."""
        if self._begun:  # in a folder that held nothing else
            (self.path / "config.json").unlink(missing_ok=True)
            shutil.rmtree(self.mapped_replay, ignore_errors=True)
        if self._new_lock:
            (self.path / _LOCK).unlink(missing_ok=True)
        if self._created:
            with suppress(OSError):  # files of somebody else
                self.path.rmdir()
        self.close()

    @property
    def mapped_replay(self) -> Path:
        """Folder of the memory-mapped replay, scratch space of the process."""
        return self.path / "replay"

    def _claim(self, resume: bool, command: Sequence[str]) -> None:
        """Write config.json, or check that the existing one allows this run."""
        if (self.path / "config.json").exists():
            self._continue(resume, command)
        elif foreign := sorted({path.name for path in self.path.iterdir()} - _BEFORE_CONFIG):
            raise ValueError(
                f"{self.path} is not empty and is not a run folder (it holds {foreign[0]!r}, but no config.json); "
                "choose a new or empty folder"
            )
        else:
            record = {"format": RUN_FORMAT, "config_version": CONFIG_VERSION, "config": self.config.to_json()}
            record |= {"versions": versions(self.config.method), "command": list(command), "created": now()}
            self._write_record(record)
            self._begun = True

    def _continue(self, resume: bool, command: Sequence[str]) -> None:
        """Check that the run in the folder may continue. `lengthen` writes the record of one with more epochs."""
        finished = (self.path / "result.json").exists()
        if not resume and not finished:
            raise ValueError(
                f"{self.path} holds an unfinished run; add --resume to continue it, or choose another --out"
            )
        begun = read_config(self.path, {self.config.method})
        longer = resume and self.config.epochs > begun.epochs
        if finished and not longer:
            lengthen = ", or --resume with a larger --epochs to lengthen it" if (self.path / REPLAY).is_dir() else ""
            raise ValueError(
                f"the run in {self.path} is finished (`curiobench table {pasted(self.path)}` shows its result); choose "
                f"another --out{lengthen}"
            )
        if why := conflict(self.path, begun, self.config):
            raise ValueError(why)
        if longer:
            self._longer = self._longer_record(begun, finished, command)

    def _longer_record(self, begun: RunConfig, finished: bool, command: Sequence[str]) -> dict[str, Any]:
        """The record of the run with more epochs. Its rows will be those of a run that had them from the start."""
        if finished and not (self.path / REPLAY).is_dir():
            raise ValueError(
                f"{self.path} is finished and its replay deleted; only runs trained with --machine.keep-replay can be "
                "lengthened"
            )
        tested = [int(row["epoch"]) for row in read_rows(self.path / "evaluations.csv")]
        if tested and tested[-1] % begun.evaluate_every:
            raise ValueError(
                f"{self.path} cannot be lengthened: it was evaluated after epoch {tested[-1]}, where a longer run with "
                f"evaluate_every {begun.evaluate_every} is not"
            )
        record = read_record(self.path)
        head = {"epochs": begun.epochs, "command": list(command), "versions": versions(begun.method), "at": now()}
        return record | {"config": self.config.to_json(), "lengthened": [*record.get("lengthened", []), head]}

    def lengthen(self) -> None:
        """Write the record of a run with more epochs, if it is one. To be called once the checkpoint has been read."""
        if self._longer is not None:
            # in this order: after a kill in between, the old run can be finished again
            (self.path / "result.json").unlink(missing_ok=True)
            self._write_record(self._longer)

    def _write_record(self, record: dict[str, Any]) -> None:
        with writing_to(self.path):
            write_json(self.path / "config.json", record)

    def append(self, name: str, rows: Sequence[dict[str, Any]]) -> None:
        """Add rows to a csv file, which gets the first row's names as its header. None becomes an empty field.

        Raises ValueError where the names are not those of the header, OSError where there is no space.
        """
        path = self.path / name
        names = list(rows[0])
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, names, lineterminator="\n")
        if size_of(path):
            with open(path, encoding="utf-8", newline="") as file:
                header = next(csv.reader(file))
            if header != names:
                raise ValueError(f"{path} has the columns {header}; the new row has {names}")
        else:
            writer.writeheader()
        writer.writerows(rows)
        with open(path, "a", encoding="utf-8") as file:
            file.write(text.getvalue())
            file.flush()
            sync(file.fileno())

    def csv_sizes(self) -> dict[str, int]:
        """Bytes in each csv file, for the checkpoint."""
        return {name: size_of(self.path / name) for name in CSV_FILES}

    def truncate(self, sizes: dict[str, int]) -> None:
        """Cut off rows written after a checkpoint; the run writes them again.

        Raises ValueError where a file is shorter than it was at the checkpoint.
        """
        for name, found in self.csv_sizes().items():
            path = self.path / name
            if found < sizes[name]:
                raise ValueError(f"{path} has {found} bytes, fewer than the {sizes[name]} it had at the checkpoint")
            if found > sizes[name]:
                os.truncate(path, sizes[name])

    def close(self) -> None:
        """Release the lock."""
        self._lock.close()

    def __exit__(self, *exception: object) -> None:
        self.close()


def _lock(path: Path) -> io.TextIOWrapper:
    """An open, locked file. The lock ends with the process, however that ends."""
    file = open(path, "a+", encoding="utf-8")  # noqa: SIM115 - stays open as long as the folder
    for attempt in range(_LOCK_ATTEMPTS):
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            break
        except BlockingIOError:
            if attempt < _LOCK_ATTEMPTS - 1:
                time.sleep(_LOCK_PAUSE)
                continue
            file.seek(0)
            holder = file.read().strip() or "unknown"
            file.close()
            raise ValueError(f"the run in {path.parent} is already running, in process {holder}") from None
    file.truncate(0)
    file.write(f"{os.getpid()}\n")
    file.flush()
    return file


def is_locked(path: Path) -> bool:
    """Whether a process trains in a run folder."""
    try:
        with open(path / _LOCK, encoding="utf-8") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def read_record(path: Path) -> dict[str, Any]:
    """The content of a run folder's config.json. Raises ValueError if there is no such file or it is not a run's."""
    if not (path / "config.json").exists():
        other = "is a file, not a folder" if path.exists() else "does not exist"
        raise ValueError(f"{path} {'is not a run folder: it has no config.json' if path.is_dir() else other}")
    record = read_json(path / "config.json")
    if record.get("format") != RUN_FORMAT:
        found = f"format is {record.get('format')!r:.80}, expected {RUN_FORMAT!r}"
        raise ValueError(f"{path / 'config.json'} was not written by `curiobench train`: {found}")
    return record


def conflict(path: Path, begun: RunConfig, wanted: RunConfig) -> str:
    """Why the run in a folder cannot go on under a config, which may have more epochs; "" if it can."""
    found = differences(replace(begun, epochs=max(begun.epochs, wanted.epochs)), wanted)
    return f"the run in {path} has other options: {'; '.join(found)}" if found else ""


def read_config(path: Path, trusted: Container[str] = ()) -> RunConfig:
    """The config of a run folder.

    Args:
        path: of the folder.
        trusted: methods that are not built in, as `package.module:Class`, and may be imported. A config from elsewhere
            must not decide which code runs here.

    Raises ValueError as `read_record`, if this version cannot read the config, or if its method is not trusted.
    """
    record = read_record(path)
    config = record.get("config")
    method = str(config.get("method", "")) if isinstance(config, dict) else ""
    if ":" in method and method not in trusted:
        advice = f"add --method {method} to allow importing its code"
        raise ValueError(f"{path}: the method {method} is not built in; {advice}")
    try:
        return RunConfig.from_json(config, record.get("config_version"))
    except ValueError as error:
        raise ValueError(f"{path / 'config.json'}: {error}") from None


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a csv file of a run, as text by column; none where it does not exist yet."""
    if not path.exists():
        return []
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
