"""Episodes on disk: written once, in segments, with manifests that say which of them make up a saved state.

A segment `episodes-FIRST-END.npz` holds the episodes number FIRST to END - 1, counted from the first ever added. A save
writes one segment of what is new and a manifest `replay-ADDED.json`. All files are written atomically, and the last two
saves stay loadable: a kill between the save of the replay and that of the agent leaves a replay that fits the older
agent. No pickles.
"""

from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from curiobench.files import read_json


def read_segment(folder: Path, first: int, end: int) -> dict[str, np.ndarray]:
    """Arrays of the episodes first … end - 1, saved together. Raises ValueError where the file is damaged."""
    path = folder / f"episodes-{first}-{end}.npz"
    try:
        with np.load(path, allow_pickle=False) as saved:
            return dict(saved)
    except BadZipFile as error:
        raise ValueError(f"cannot read {path}: {error}") from None


def prune(folder: Path, keep: set[str]) -> None:
    """Delete all states but these, and what a killed save left."""
    needed = set(keep)
    for name in keep:
        if (folder / name).exists():
            needed |= {f"episodes-{a}-{b}.npz" for a, b in read_json(folder / name)["segments"]}
    for pattern in ("replay-*", "episodes-*"):
        for path in folder.glob(pattern):
            if path.name not in needed:
                path.unlink()
