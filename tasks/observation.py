"""The observation: the paper's state vector, the same for every robot, computed for any number of worlds at once.

Lengths are in metres, angles in radians, in the world frame. Velocities are per control step: SI values times 0.04 s.
This module does not import MuJoCo.
"""

from dataclasses import dataclass

import numpy as np

CONTROL_TIMESTEP = 0.04
"""Seconds per action: 25 Hz."""
BODY_SIZE, BLOCK_SIZE = 10, 15
BODY_PARTS = {
    "grip_position": slice(0, 3),
    "finger_positions": slice(3, 5),
    "grip_velocity": slice(5, 8),
    "finger_velocities": slice(8, 10),
}
"""Slices of an observation that hold the parts of the hand's state."""
BLOCK_PARTS = {
    "position": slice(0, 3),
    "relative_position": slice(3, 6),
    "euler_angles": slice(6, 9),
    "relative_velocity": slice(9, 12),
    "angular_velocity": slice(12, 15),
}
"""Slices that hold the parts of a block's state, relative to the block's first entry, `10 + 15 i` for block i."""


@dataclass(frozen=True)
class HandState:
    """State of the hand in N worlds, in metres and metres per second, in the world frame."""

    grip_position: np.ndarray
    """`(N, 3)`"""
    grip_velocity: np.ndarray
    """`(N, 3)`"""
    finger_positions: np.ndarray
    """`(N, 2)`, right and left. The opening between the fingers is their sum plus 1.8 mm."""
    finger_velocities: np.ndarray
    """`(N, 2)`"""
    target_origin: np.ndarray
    """`(N, k)` current pose to which an action adds a displacement; its format depends on the robot."""


@dataclass(frozen=True)
class BlockStates:
    """Free-joint states of n blocks in N worlds, in MuJoCo's conventions."""

    positions: np.ndarray
    """`(N, n, 3)` centres."""
    quaternions: np.ndarray
    """`(N, n, 4)` orientations (w, x, y, z)."""
    velocities: np.ndarray
    """`(N, n, 3)` metres per second."""
    angular_velocities: np.ndarray
    """`(N, n, 3)` radians per second, in each block's own frame."""


def observation_size(n_blocks: int) -> int:
    """Length of the state vector: 55 for three blocks."""
    return BODY_SIZE + BLOCK_SIZE * n_blocks


def observation(hand: HandState, blocks: BlockStates) -> np.ndarray:
    """The state vector `(N, 10 + 15 n)`, float32."""
    n_worlds, n_blocks = blocks.positions.shape[:2]
    vector = np.empty((n_worlds, observation_size(n_blocks)), np.float32)
    vector[:, BODY_PARTS["grip_position"]] = hand.grip_position
    vector[:, BODY_PARTS["finger_positions"]] = hand.finger_positions
    vector[:, BODY_PARTS["grip_velocity"]] = hand.grip_velocity * CONTROL_TIMESTEP
    vector[:, BODY_PARTS["finger_velocities"]] = hand.finger_velocities * CONTROL_TIMESTEP
    rotation = rotation_matrices(blocks.quaternions)
    part = vector[:, BODY_SIZE:].reshape(n_worlds, n_blocks, BLOCK_SIZE)
    part[..., BLOCK_PARTS["position"]] = blocks.positions
    part[..., BLOCK_PARTS["relative_position"]] = blocks.positions - hand.grip_position[:, None]
    part[..., BLOCK_PARTS["euler_angles"]] = euler_angles(rotation)
    relative_velocity = blocks.velocities - hand.grip_velocity[:, None]
    part[..., BLOCK_PARTS["relative_velocity"]] = relative_velocity * CONTROL_TIMESTEP
    world_angular = np.matvec(rotation, blocks.angular_velocities)
    part[..., BLOCK_PARTS["angular_velocity"]] = world_angular * CONTROL_TIMESTEP
    return vector


def rotation_matrices(quaternions: np.ndarray) -> np.ndarray:
    """Rotation matrices `(..., 3, 3)` of unit quaternions `(..., 4)` in MuJoCo's order w, x, y, z."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def euler_angles(rotation: np.ndarray) -> np.ndarray:
    """Angles `(..., 3)` about x, y and z of rotation matrices `(..., 3, 3)`, in the convention of gym's `mat2euler`.

    The matrix is R_x(a) R_y(b) R_z(c). Where b is ±90° (gimbal lock), only c - a or c + a is defined, and a is set
    to 0.
    """
    cos_y = np.hypot(rotation[..., 2, 2], rotation[..., 1, 2])
    regular = cos_y > 4 * np.finfo(np.float64).eps
    angles = np.empty(rotation.shape[:-1])
    angles[..., 0] = np.where(regular, np.arctan2(-rotation[..., 1, 2], rotation[..., 2, 2]), 0.0)
    angles[..., 1] = np.arctan2(rotation[..., 0, 2], cos_y)
    angles[..., 2] = np.where(
        regular,
        np.arctan2(-rotation[..., 0, 1], rotation[..., 0, 0]),
        np.arctan2(rotation[..., 1, 0], rotation[..., 1, 1]),
    )
    return angles
