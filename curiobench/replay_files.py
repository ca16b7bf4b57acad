"""Episodes on disk: written once, in segments, with manifests that say which of them make up a saved state.

A segment `episodes-FIRST-END.npz` holds the episodes number FIRST to END - 1, counted from the first ever added. A save
writes one segment of what is new and a manifest `replay-ADDED.json`. All files are written atomically,
and the last two saves stay loadable: a kill between the save of the replay and that of the
agent leaves a replay that fits the older agent. No pickles.
"""

from collections.abc import Callable
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from curiobench.files import read_json, replace_file, write_json

Arrays = dict[str, np.ndarray]


def save_episodes(
    folder: Path,
    saved: int,
    oldest: int,
    added: int,
    episodes: Callable[[int, int], Arrays],
    shapes: dict[str, list[int]],
) -> str:
    """Write a new state on top of the one with `saved` episodes (0: none), in the same folder.

    Without new episodes nothing is written, so that the save before this one stays.

    Args:
        folder: created if it does not exist.
        saved: episodes added until the previous save.
        oldest: number of the oldest episode still held; segments that end before it are dropped.
        added: episodes added until now.
        episodes: arrays of the episodes from a first number up to, not including, a last.
        shapes: for the manifest.

    Returns:
        The name of the manifest, a JSON object of `added`, `segments` and `shapes`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    previous = f"replay-{saved}.json"
    if saved == added and (folder / previous).exists():
        return previous
    segments = read_json(folder / previous)["segments"] if saved else []
    segments = [segment for segment in segments if segment[1] > oldest]
    first = max(saved, oldest)
    if first < added:
        path = folder / f"episodes-{first}-{added}.npz"
        replace_file(path, lambda file: np.savez(file, **episodes(first, added)))
        segments.append([first, added])
    name = f"replay-{added}.json"
    write_json(folder / name, {"added": added, "segments": segments, "shapes": shapes})
    _prune(folder, {name, previous})
    return name


def read_segment(folder: Path, first: int, end: int) -> Arrays:
    """Arrays of the episodes first … end - 1, saved together. Raises ValueError where the file is damaged."""
    path = folder / f"episodes-{first}-{end}.npz"
    try:
        with np.load(path, allow_pickle=False) as saved:
            return dict(saved)
    except BadZipFile as error:
        raise ValueError(f"cannot read {path}: {error}") from None


def _prune(folder: Path, keep: set[str]) -> None:
    """Delete all states but these, and what a killed save left."""
    needed = set(keep)
    for name in keep:
        if (folder / name).exists():
            needed |= {f"episodes-{a}-{b}.npz" for a, b in read_json(folder / name)["segments"]}
    for pattern in ("replay-*", "episodes-*"):
        for path in folder.glob(pattern):
            if path.name not in needed:
                path.unlink()
