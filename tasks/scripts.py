"""Scripted controllers, which use the observation and the actions of an agent, for N worlds at once.

A script is a list of stages. Each world goes through them at its own pace. In a stage the grip site moves to a target
and the fingers to an opening, until the target is reached or the stage times out. Scripts assume blocks that are
upright and aligned with the table, as in plain starts.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from curiobench.tasks import observation as obs
from curiobench.tasks.placements import BLOCK_SIZE
from curiobench.tasks.scene import BLOCK_REST_HEIGHT, TABLE_CENTRE, TABLE_HALF_SIZE
from curiobench.tasks.spec import ACTION_SIZE

_STEP_REACH = 0.031
"""Distance that the hand moves in one step from rest with an action of 1 (metres)."""
_TRAVEL_HEIGHT = 0.075
"""Height of the grip above a block's centre at which an empty hand passes over it (metres)."""
_CLEARANCE = 0.012
"""Gap between a carried block and a block that it passes over (metres)."""
_BACK = 0.04
"""Approximate distance from a block's centre at which closed fingers touch it (metres)."""
_REACH = 1.49
"""The arm gets slow beyond this x (metres)."""
_OPEN, _SHUT = 0.03, -1.0
"""Finger positions of a stage (metres): wide enough for a block, and closed on what is between the fingers."""
_FINGER_GAIN, _FINGER_DAMPING = 2.0, 3.3
"""Gains from the fingers' position error, and from their velocity per step, to the action."""


class ObservationParts:
    """The parts of N observations by name. Block numbers start at 0."""

    def __init__(self, observation: np.ndarray):
        self._observation = observation
        self.grip = observation[:, obs.BODY_PARTS["grip_position"]]
        self.fingers = observation[:, obs.BODY_PARTS["finger_positions"]]
        self.finger_velocities = observation[:, obs.BODY_PARTS["finger_velocities"]]

    def block(self, block: int) -> np.ndarray:
        """Centres `(N, 3)` of a block in metres."""
        return self._observation[:, obs.BODY_SIZE + obs.BLOCK_SIZE * block :][:, obs.BLOCK_PARTS["position"]]


Target = Callable[[ObservationParts], np.ndarray]
"""Computes the target position of the grip, `(N, 3)` metres."""


@dataclass(frozen=True)
class Stage:
    """One stage of a script.

    It ends when every coordinate is within `tolerance` of the target and at least `min_steps` steps were made in it,
    or after `max_steps` steps.
    """

    target: Target
    fingers: float
    """Finger position to hold (metres); a negative one closes the fingers with full force."""
    tolerance: float = 0.006
    """Largest distance from the target in each coordinate (metres)."""
    min_steps: int = 0
    """Least number of steps."""
    max_steps: int = 15
    """Largest number of steps."""


class Script:
    """Carries out stages in N worlds. Create a new one for new episodes."""

    def __init__(self, stages: Sequence[Stage]):
        self._stages = [*stages, Stage(lambda view: view.grip, _OPEN, tolerance=-1, max_steps=1 << 30)]
        self.stage: np.ndarray | None = None
        """`(N,)` index of the current stage of each world. In the last stage the hand rests."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Actions `(N, 4)` for observations `(N, 10 + 15 n)`."""
        view = ObservationParts(np.asarray(observation, np.float64))
        if self.stage is None:
            self.stage = np.zeros(len(observation), int)
            self._steps = np.zeros(len(observation), int)
        action = np.zeros((len(observation), ACTION_SIZE))
        for number, stage in enumerate(self._stages):
            here = self.stage == number
            if not here.any():
                continue
            error = stage.target(view) - view.grip
            reached = (np.abs(error) <= stage.tolerance).all(axis=1) & (self._steps >= stage.min_steps)
            over = here & (reached | (self._steps >= stage.max_steps))
            # a world that has reached its target continues with the next stage in the same step
            self.stage[over] += 1
            self._steps[over] = 0
            here &= ~over
            action[here, :3] = error[here] / _STEP_REACH
            action[here, 3] = _finger_action(view, stage.fingers)[here]
        self._steps += 1
        return action.clip(-1, 1)


def _finger_action(view: ObservationParts, position: float) -> np.ndarray:
    if position < 0:
        return np.full(len(view.grip), -1.0)
    error = position - view.fingers.mean(axis=1)
    return _FINGER_GAIN * error - _FINGER_DAMPING * view.finger_velocities.mean(axis=1)


def stack_two(upper: int = 0, lower: int = 1) -> Script:
    """Picks block `upper` and places it on block `lower`."""
    return Script([*_pick(upper), *_place(upper, lambda view: view.block(lower) + _up(BLOCK_SIZE)), *_leave()])


def stack_three(top: int = 0, middle: int = 1, bottom: int = 2) -> Script:
    """Places block `middle` on `bottom`, then `top` on `middle`."""
    return Script(
        [
            *_pick(middle),
            *_place(middle, lambda view: view.block(bottom) + _up(BLOCK_SIZE)),
            *_pick(top),
            *_place(top, lambda view: view.block(middle) + _up(BLOCK_SIZE)),
            *_leave(),
        ]
    )


def pyramid(top: int = 0, left: int = 1, right: int = 2) -> Script:
    """Places block `left` beside `right`, then `top` on both."""
    return Script(
        [
            *_pick(left),
            *_place(left, lambda view: _beside(view, right, comes_from=left, avoids=top)),
            *_pick(top),
            *_place(top, lambda view: (view.block(left) + view.block(right)) / 2 + _up(BLOCK_SIZE)),
            *_leave(),
        ]
    )


def push_together(pushed: int = 0, other: int = 1) -> Script:
    """Pushes block `pushed` along the table until it is close to `other`."""
    return Script(
        [
            Stage(lambda view: _behind(view, pushed, _direction(view, pushed, other)) + _up(0.06), _SHUT, 0.012),
            Stage(lambda view: _behind(view, pushed, _direction(view, pushed, other)), _SHUT, 0.008, max_steps=6),
            Stage(lambda view: _push_target(view, pushed, other), _SHUT, max_steps=30),
            *_leave(),
        ]
    )


def push_off_table(block: int = 0) -> Script:
    """Pushes a block over the nearer of the table's two long sides (those that face along y)."""

    def outwards(view: ObservationParts) -> np.ndarray:
        side = np.where(view.block(block)[:, 1] < TABLE_CENTRE[1], -1.0, 1.0)
        return np.stack([np.zeros_like(side), side, np.zeros_like(side)], axis=1)

    def over_the_edge(view: ObservationParts) -> np.ndarray:
        edge = np.broadcast_to(TABLE_CENTRE, view.grip.shape) + outwards(view) * TABLE_HALF_SIZE[1]
        return np.stack([view.block(block)[:, 0], edge[:, 1], np.full(len(edge), BLOCK_REST_HEIGHT)], axis=1)

    return Script(
        [
            Stage(lambda view: _behind(view, block, outwards(view)) + _up(0.06), _SHUT, 0.012),
            Stage(lambda view: _behind(view, block, outwards(view)), _SHUT, 0.008, max_steps=6),
            Stage(over_the_edge, _SHUT, max_steps=25),
            *_leave(),
        ]
    )


def _up(height: float) -> np.ndarray:
    return np.array([0.0, 0.0, height])


def _pick(block: int) -> list[Stage]:
    """Approaches the block from above with open fingers and closes them."""
    return [
        Stage(lambda view: _over(view, view.block(block) + _up(_TRAVEL_HEIGHT)), _OPEN, tolerance=0.012),
        Stage(lambda view: view.block(block), _OPEN, tolerance=0.004, max_steps=6),
        Stage(lambda view: view.block(block), _SHUT, tolerance=0.02, min_steps=1, max_steps=1),
    ]


def _place(block: int, spot: Target) -> list[Stage]:
    """Carries a held block above the position `spot` of its centre, lowers it and opens the fingers."""

    def grip_for(view: ObservationParts, height: float) -> np.ndarray:
        return spot(view) + (view.grip - view.block(block)) + _up(height)

    def carried(view: ObservationParts) -> np.ndarray:
        target = grip_for(view, _CLEARANCE)
        lowest = BLOCK_REST_HEIGHT + BLOCK_SIZE + _CLEARANCE + (view.grip - view.block(block))[:, 2]
        target[:, 2] = np.maximum(target[:, 2], lowest)
        return target

    def lifted(view: ObservationParts) -> np.ndarray:
        return np.concatenate([view.grip[:, :2], carried(view)[:, 2:]], axis=1)

    return [
        Stage(lifted, _SHUT, tolerance=0.012, max_steps=6),
        Stage(carried, _SHUT, tolerance=0.005),
        Stage(lambda view: grip_for(view, 0.002), _SHUT, tolerance=0.003, max_steps=5),
        Stage(lambda view: view.grip, 0.06, tolerance=1, min_steps=1, max_steps=1),
        Stage(lambda view: view.block(block) + _up(0.055), _OPEN, tolerance=0.01, max_steps=4),
    ]


def _leave() -> list[Stage]:
    return [Stage(lambda view: view.grip + _up(0.03), _OPEN, tolerance=-1, max_steps=3)]


def _over(view: ObservationParts, target: np.ndarray) -> np.ndarray:
    """The target, but at least at the hand's current height until the hand is nearly above the target.

    This avoids collisions with a tower that the hand has just left.
    """
    far = np.linalg.norm((target - view.grip)[:, :2], axis=1) > 0.03
    height = np.where(far, np.maximum(target[:, 2], view.grip[:, 2]), target[:, 2])
    return np.concatenate([target[:, :2], height[:, None]], axis=1)


def _beside(view: ObservationParts, block: int, comes_from: int, avoids: int) -> np.ndarray:
    """A position 57 mm from a block along x, on the side that the fingers can reach and no other block obstructs."""
    centre, side = view.block(block), np.array([0.057, 0.0, 0.0])
    nearer = np.where(view.block(comes_from)[:, :1] < centre[:, :1], -side, side)
    gap = np.linalg.norm((view.block(avoids) - centre - nearer)[:, :2], axis=1)
    bad = (gap < 0.075) | ((centre + nearer)[:, 0] > _REACH)
    return centre + np.where(bad[:, None], -nearer, nearer)


def _direction(view: ObservationParts, pushed: int, other: int) -> np.ndarray:
    offset = view.block(other) - view.block(pushed)
    return offset / np.linalg.norm(offset, axis=1, keepdims=True)


def _behind(view: ObservationParts, block: int, direction: np.ndarray) -> np.ndarray:
    """Position of closed fingers just before they push a block along a horizontal direction `(N, 3)`."""
    return view.block(block) - (_BACK + 0.015) * direction


def _push_target(view: ObservationParts, pushed: int, other: int) -> np.ndarray:
    """Grip target slightly past the block's rear side, behind its centre. The hand stops once the blocks are close."""
    direction = _direction(view, pushed, other)
    gap = np.linalg.norm(view.block(other) - view.block(pushed), axis=1, keepdims=True)
    return np.where(gap < 0.08, view.grip, view.block(pushed) - (_BACK - 0.018) * direction)
