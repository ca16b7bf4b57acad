"""Checkpoints: plain JSON, and tensors that load with `weights_only=True`. Nothing in them can run code.

A checkpoint number N is two files. `agent-N.pt` comes first; `checkpoint-N.json`, which holds its digest and everything
else, makes it valid. Both are written atomically. The checkpoint before it is kept, with the replay it refers to.
"""

import hashlib
import io
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from pickle import UnpicklingError
from typing import Any
from zipfile import BadZipFile

import torch

from curiobench.files import read_json, replace_file, write_json
from curiobench.methods.guard import MethodError

CHECKPOINT_FORMAT = "curiobench checkpoint 4"
KEPT = 2
"""Checkpoints kept: the newest, and the one before in case that is damaged."""

_MANIFEST = re.compile(r"checkpoint-(\d{1,9})\.json")
_REPLAY_MANIFEST = re.compile(r"replay-\d{1,18}\.json")
_FAULTS = (
    OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError, EOFError, UnpicklingError, BadZipFile
)  # fmt: skip
"""What damaged JSON, tensors and arrays raise when they are read or taken over."""


class _OtherFormat(ValueError):
    """A checkpoint of another version of this package; those before it are, too."""


def save(folder: Path, fingerprint: str, agent: dict[str, Any], values: dict[str, Any]) -> None:
    """Write the next checkpoint, then delete all but the last two.

    Args:
        folder: created if it does not exist.
        fingerprint: of the run's config, `RunConfig.fingerprint`; `load` demands the same.
        agent: nested dicts of tensors and plain values.
        values: plain values, among them `replay`, the name of the replay's manifest.

    Raises OSError where there is no space or no right to write; the checkpoints before are kept then.
    """
    folder.mkdir(parents=True, exist_ok=True)
    number = max(_numbers(folder), default=0) + 1
    buffer = io.BytesIO()
    torch.save(agent, buffer)
    replace_file(_agent_path(folder, number), lambda file: file.write(buffer.getbuffer()))
    digest = hashlib.sha256(buffer.getbuffer()).hexdigest()
    head = {"format": CHECKPOINT_FORMAT, "fingerprint": fingerprint, "agent_sha256": digest}
    write_json(_manifest_path(folder, number), head | {"values": values})
    for old in sorted(_numbers(folder))[:-KEPT]:
        _manifest_path(folder, old).unlink()
    kept = {_agent_path(folder, number) for number in _numbers(folder)}
    for agent_file in set(folder.glob("agent-*.pt")) - kept:  # also those that a kill just here has left behind
        agent_file.unlink()


def load(folder: Path, fingerprint: str) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """The newest checkpoint's agent and values, or None where there is none.

    Raises ValueError where it is truncated, altered, of another run, or no checkpoint at all. The message names
    the checkpoint before it, if there is one: without the damaged one, a run resumes from there.
    """
    number = max(_numbers(folder), default=None)
    if number is None:
        return None
    with errors_named(folder):
        manifest = read_json(_manifest_path(folder, number), math.inf)  # the state of a curriculum has any size
        if (found := manifest.get("format")) != CHECKPOINT_FORMAT:
            kind = _OtherFormat if str(found).startswith("curiobench checkpoint") else ValueError
            raise kind(f"its format is {found!r}; this curiobench reads {CHECKPOINT_FORMAT!r} only")
        if manifest["fingerprint"] != fingerprint:
            raise ValueError("it belongs to a run with another config")
        values = manifest["values"]
        if not _REPLAY_MANIFEST.fullmatch(values["replay"]):
            raise ValueError(f"{values['replay']!r} is not the name of a replay")
        return _load_agent(_agent_path(folder, number), manifest["agent_sha256"]), values


def _load_agent(path: Path, digest: str) -> dict[str, Any]:
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != digest:
        raise ValueError(f"{path.name} is truncated or altered")
    return torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)


@contextmanager
def errors_named(folder: Path) -> Iterator[None]:
    """Turn whatever a damaged or foreign checkpoint provokes into one ValueError that names it."""
    try:
        yield
    except _FAULTS as error:
        readable = isinstance(error, ValueError | MethodError)
        first_line = error if readable else f"{type(error).__name__} {error}".splitlines()[0]
        *before, newest = sorted(_numbers(folder))
        # where it is the method that raises, the file is as it was written
        go_back = before and not isinstance(error, MethodError | _OtherFormat)
        advice = f"; delete it to go back to checkpoint {before[-1]}" if go_back else ""
        raise ValueError(f"cannot use {_manifest_path(folder, newest)}: {first_line}{advice}") from error


def _numbers(folder: Path) -> list[int]:
    if not folder.is_dir():
        return []
    return [int(match[1]) for path in folder.iterdir() if (match := _MANIFEST.fullmatch(path.name))]


def _manifest_path(folder: Path, number: int) -> Path:
    return folder / f"checkpoint-{number}.json"


def _agent_path(folder: Path, number: int) -> Path:
    return folder / f"agent-{number}.pt"
