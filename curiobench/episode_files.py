"""Episodes on disk: written once, in segments, with manifests that say which of them make up a saved state.

A segment `episodes-FIRST-END.npz` holds the episodes number FIRST to END - 1, counted from the first ever added. A save
writes one segment of what is new and a manifest `replay-ADDED.json`. All files are written beside and then renamed, so
each is whole or absent, and the last two saves stay loadable: a kill between the save of the replay and that of the
agent leaves a replay that fits the older agent. No pickles.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from curiobench.files import read_json, replace_file, write_json

Arrays = dict[str, np.ndarray]

_INDEX = re.compile(r"index-\d{1,18}\.npz")


class EpisodeFiles:
    """The saved states of one replay, in one folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)

    def save(
        self,
        saved: int,
        oldest: int,
        added: int,
        episodes: Callable[[int, int], Arrays],
        index: Arrays,
        shapes: dict[str, list[int]],
    ) -> str:
        """Write a new state on top of the one with `saved` episodes (0: none), in the same folder; return its name.

        Without new episodes nothing is written, so that the save before this one stays.

        Args:
            saved: episodes added until the previous save.
            oldest: number of the oldest episode still held; segments that end before it are dropped.
            added: episodes added until now.
            episodes: arrays of the episodes from a first number up to, not including, a last.
            index: small arrays that are written whole.
            shapes: for the manifest.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        previous = f"replay-{saved}.json"
        if saved == added and (self.folder / previous).exists():
            return previous
        segments = self.manifest(previous)["segments"] if saved else []
        segments = [segment for segment in segments if segment[1] > oldest]
        first = max(saved, oldest)
        if first < added:
            path = self.folder / f"episodes-{first}-{added}.npz"
            replace_file(path, lambda file: np.savez(file, **episodes(first, added)))
            segments.append([first, added])
        name, index_name = f"replay-{added}.json", f"index-{added}.npz"
        replace_file(self.folder / index_name, lambda file: np.savez(file, **index))
        manifest = {"added": added, "segments": segments, "index": index_name, "shapes": shapes}
        write_json(self.folder / name, manifest)
        self._prune({name, previous})
        return name

    def manifest(self, name: str) -> dict[str, Any]:
        """The manifest of a saved state: added, segments, index, shapes. Raises ValueError where it is damaged."""
        manifest = read_json(self.folder / name)
        if not _INDEX.fullmatch(manifest["index"]):
            raise ValueError(f"{self.folder / name} names {manifest['index']!r} as its index")
        return manifest

    def segment(self, first: int, end: int) -> Arrays:
        """Arrays of the episodes first … end - 1, as they were saved together."""
        return self.arrays(f"episodes-{first}-{end}.npz")

    def arrays(self, name: str) -> Arrays:
        """All arrays of a file. Raises ValueError where it is damaged."""
        try:
            with np.load(self.folder / name, allow_pickle=False) as saved:
                return dict(saved)
        except BadZipFile as error:
            raise ValueError(f"cannot read {self.folder / name}: {error}") from None

    def _prune(self, keep: set[str]) -> None:
        """Delete all states but these, and what a killed save left."""
        needed = set(keep)
        for name in keep:
            if (self.folder / name).exists():
                manifest = self.manifest(name)
                needed |= {manifest["index"], *(f"episodes-{a}-{b}.npz" for a, b in manifest["segments"])}
        for pattern in ("replay-*", "index-*", "episodes-*"):
            for path in self.folder.glob(pattern):
                if path.name not in needed:
                    path.unlink()
