"""Events in a scripted episode: the steps that lift a block in the hand, the steps in which it falls, key moments.

Events depend on the motion of the block, not on the script, so an episode in which the grip slips counts as observed.
Step t leads from state t to state t + 1.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from curiobench.tasks.placements import BLOCK_SIZE
from curiobench.tasks.scene import TABLE_CENTRE, TABLE_HALF_SIZE
from curiobench.tasks.scripts import ObservationParts

CHANGE = 0.01
"""Least change of height in a lifting or falling step (metres): a pushed block jitters by half of that, a full action
lifts by 0.03, and a block that is let go has lost 0.03 after two steps."""
IN_HAND = 0.02
"""A block is in the hand if its centre is no farther from the grip site (metres): a held one stays within 0.005, a
pushed one keeps 0.035."""
MOVED = 0.005
"""Least motion in a step that counts as lowering or being pushed, and of the fingers as opening (metres)."""
CLOSED = 0.002
"""Least motion of the fingers in a step that counts as closing on a block (metres)."""


@dataclass(frozen=True)
class Track:
    """Where a block and the hand were in T + 1 states, of one episode or of many (leading axes)."""

    block: np.ndarray
    """(…, T + 1, 3) centres of the block in metres."""
    grip: np.ndarray
    """(…, T + 1, 3) grip site in metres."""
    opening: np.ndarray
    """(…, T + 1) mean finger position in metres; larger is wider."""

    @classmethod
    def of(cls, observation: np.ndarray) -> Self:
        """The track of block a in observations (…, T + 1, D)."""
        view = ObservationParts(observation.reshape(-1, observation.shape[-1]).astype(np.float64))
        lead = observation.shape[:-1]
        return cls(*(a.reshape(*lead, 3) for a in (view.block(0), view.grip)), view.fingers.mean(1).reshape(lead))

    def __getitem__(self, episode: int) -> "Track":
        return Track(self.block[episode], self.grip[episode], self.opening[episode])

    @property
    def rise(self) -> np.ndarray:
        """(…, T) change of the block's height in each step, in metres."""
        return np.diff(self.block[..., 2], axis=-1)

    @property
    def in_hand(self) -> np.ndarray:
        """(…, T + 1) bool, states with the block in the hand."""
        return np.linalg.norm(self.block - self.grip, axis=-1) <= IN_HAND


def lifting(track: Track) -> np.ndarray:
    """(…, T) bool, controlled lifting: the block rises by `CHANGE` or more and is in the hand before and after."""
    return (track.rise >= CHANGE) & track.in_hand[..., :-1] & track.in_hand[..., 1:]


def falling(track: Track) -> np.ndarray:
    """(…, T) bool, falling: the block sinks by `CHANGE` or more and is out of the hand afterwards.

    The step in which it hits the ground is the last.
    """
    return (track.rise <= -CHANGE) & ~track.in_hand[..., 1:]


def stack_moments(track: Track) -> dict[str, int]:
    """Key moments of one "pick and stack": names, and the states (0…T) at which they have just happened."""
    fingers = np.diff(track.opening)
    held = track.in_hand[1:]
    closes = _first(held & (fingers <= -CLOSED))
    lifts = _first(lifting(track), closes)
    lowers = _first(held & (track.rise <= -MOVED), lifts)
    releases = _first(fingers >= MOVED, lowers)
    return _found({"gripper closes": closes, "block lifts": lifts, "block lowers": lowers, "releases": releases})


def push_moments(track: Track) -> dict[str, int]:
    """Key moments of one "push off the table", as `stack_moments`."""
    across = np.linalg.norm(np.diff(track.block[:, :2], axis=0), axis=1)
    beyond = np.abs(track.block[1:, :2] - TABLE_CENTRE[:2]) + BLOCK_SIZE / 2 >= TABLE_HALF_SIZE[:2]
    starts = _first(across >= MOVED)
    edge = _first(beyond.any(axis=1), starts)
    falls = _first(falling(track), edge)
    return _found({"push starts": starts, "block at the edge": edge, "block falls": falls})


def _first(happens: np.ndarray, after: int | None = 0) -> int | None:
    """The state that the first of these steps (T,) leads to, from the state `after` on; None where there is none."""
    if after is None:
        return None
    steps = np.flatnonzero(happens[after:])
    return after + int(steps[0]) + 1 if len(steps) else None


def _found(moments: dict[str, int | None]) -> dict[str, int]:
    return {name: state for name, state in moments.items() if state is not None}
