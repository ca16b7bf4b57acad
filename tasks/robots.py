"""The two robots, which share one action layout and one observation layout.

`FreeGripper` (here) is a pair of fingers on a hand that slides freely in space. `FetchArm` (fetch.py) is the paper's
seven-joint arm. Both have four actions and ten entries of the observation, so that a policy can be transferred from one
to the other. Lengths are in metres, masses in kilograms, forces in newtons.

An action has four numbers in [-1, 1]: hand displacement (x, y, z) in units of `HAND_STEP`, and finger displacement
(positive opens).
"""

import abc
from collections.abc import Iterable

import mujoco
import numpy as np
from dm_control import composer, mjcf

from curiobench.tasks.observation import CONTROL_TIMESTEP, HandState

HAND_STEP = 0.05
"""Displacement of the hand's target at |action| = 1 (metres)."""
FINGER_TARGET_LIMIT = 0.2
"""Upper end of the finger servos' control range (metres). The lower end is 0."""
HAND_ROTATION = (1.0, 0.0, 1.0, 0.0)
"""Orientation of the hand (w, x, y, z, not normalised): its x axis points down, its y axis along world y."""
GRIP_IN_HAND = (0.02, 0.0, 0.0)
"""The grip site, between the finger tips, in the hand's frame."""
GRIP_START = (1.3419, 0.7491, 0.5347)
"""Position of the grip site when an episode starts (measured on the arm)."""

_FINGER_KP = 30_000.0
_FINGER_JOINT = dict(type="slide", armature=100, damping=1000, limited=True, range=(0, 0.05),
                     solreflimit=(0.01, 1), solimplimit=(0.99, 0.999, 0.01))  # fmt: skip
_CONTACT = dict(margin=0.001, solref=(0.01, 1), solimp=(0.99, 0.99, 0.01))
_METAL = (0.36, 0.36, 0.38, 1.0)
_PALE = (0.93, 0.93, 0.94, 1.0)


class Hand(abc.ABC):
    """A robot's hand in one compiled model. Reads the hand's state and turns actions into commands, for N worlds."""

    control_spec: int
    """Which parts of MuJoCo's state (`mjtState`) a command sets."""

    def __init__(self, model: mujoco.MjModel, finger_joints: tuple[str, str]):
        self.finger_qpos = [model.joint(name).qposadr[0] for name in finger_joints]
        self.finger_dofs = [model.joint(name).dofadr[0] for name in finger_joints]

    @abc.abstractmethod
    def state(self, qpos: np.ndarray, qvel: np.ndarray) -> HandState:
        """Reads the hands of N worlds from positions `(N, nq)` and velocities `(N, nv)`."""

    @abc.abstractmethod
    def command(self, state: HandState, action: np.ndarray) -> np.ndarray:
        """Values `(N, k)` for the `control_spec` parts of the state that carry out actions `(N, 4)`."""


class Robot(composer.Entity, abc.ABC):
    """A hand with two fingers. A task attaches it to its arena and controls it by commands."""

    timestep: float
    """Physics time step (seconds)."""

    @property
    def n_substeps(self) -> int:
        """Physics steps per action."""
        return round(CONTROL_TIMESTEP / self.timestep)

    @abc.abstractmethod
    def install(self, arena: composer.Arena) -> None:
        """Attaches the robot to `arena`. Call it once, before the model is compiled."""

    @abc.abstractmethod
    def bind(self, model: mujoco.MjModel) -> Hand:
        """The hand of this robot in the compiled `model`."""

    @abc.abstractmethod
    def start_configuration(self, model: mujoco.MjModel) -> np.ndarray:
        """Positions `(nq,)`: the hand at rest at `GRIP_START`, fingers closed, the others as in `model.qpos0`."""


def finger_targets(finger_positions: np.ndarray, action: np.ndarray) -> np.ndarray:
    """Servo targets `(N, 2)` in metres: the current positions plus the fourth action, unscaled, clamped to the range.

    An action of 1 is a displacement of one metre. In effect, positive actions open, negative ones close and 0 holds.
    """
    return np.clip(finger_positions + action[:, 3:4], 0.0, FINGER_TARGET_LIMIT)


class FreeGripper(Robot):
    """The arm's fingers on a free-floating hand that always points straight down.

    The hand moves on three slide joints. Servos pull it to its current position plus the action, as the arm's mocap
    weld does. Stiffness, damping and the uncompensated part of the hand's weight are tuned to the arm's motion.
    docs/fidelity.md compares the two.
    """

    timestep = CONTROL_TIMESTEP / 7

    hand_mass = 10.0
    servo_stiffness = (32_500.0, 34_500.0, 34_500.0)
    """Newtons per metre, along x, y and z."""
    servo_damping = (1_385.0, 1_450.0, 1_435.0)
    """Newton seconds per metre, along x, y and z."""
    uncompensated_weight = 0.8
    """Part of the hand's mass that the servos carry (kilograms). It makes an idle hand sag as the arm's does."""

    def _build(self) -> None:
        self._mjcf_model = root = mjcf.RootElement(model="robot")
        root.compiler.angle = "radian"
        # the hand's x axis points down
        mount = root.worldbody.add("body", name="mount", pos=np.add(GRIP_START, (0, 0, GRIP_IN_HAND[0])))
        for axis, direction in zip("xyz", np.eye(3), strict=True):
            mount.add("joint", name=f"hand_{axis}", type="slide", axis=direction)
        hand = mount.add("body", name="hand", quat=HAND_ROTATION,
                         gravcomp=1 - self.uncompensated_weight / self.hand_mass)  # fmt: skip
        # a box around the arm's gripper link, which blocks can collide with
        hand.add("geom", name="palm", type="box", pos=(-0.093, 0, 0), size=(0.061, 0.063, 0.04), mass=self.hand_mass,
                 rgba=_PALE, **_CONTACT)  # fmt: skip
        hand.add("site", name="grip", pos=GRIP_IN_HAND, size=(0.005,), rgba=(0, 0, 0, 0))
        right = add_finger(hand, "right", side=1)
        left = add_finger(hand, "left", side=-1)
        root.contact.add("exclude", body1=right.parent, body2=left.parent)
        for axis, stiffness, damping in zip("xyz", self.servo_stiffness, self.servo_damping, strict=True):
            root.actuator.add("position", name=f"hand_{axis}", joint=f"hand_{axis}", kp=stiffness, kv=damping)
        add_finger_servos(root, (right, left))

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        return self._mjcf_model

    def install(self, arena: composer.Arena) -> None:
        arena.attach(self)

    def bind(self, model: mujoco.MjModel) -> Hand:
        return _SlidingHand(model)

    def start_configuration(self, model: mujoco.MjModel) -> np.ndarray:
        return model.qpos0.copy()  # the slides are zero at the start pose


class _SlidingHand(Hand):
    control_spec = int(mujoco.mjtState.mjSTATE_CTRL)

    def __init__(self, model: mujoco.MjModel):
        super().__init__(model, ("robot/right_finger", "robot/left_finger"))
        slides = [model.joint(f"robot/hand_{axis}") for axis in "xyz"]
        self._slide_qpos = [joint.qposadr[0] for joint in slides]
        self._slide_dofs = [joint.dofadr[0] for joint in slides]

    def state(self, qpos: np.ndarray, qvel: np.ndarray) -> HandState:
        slides = qpos[:, self._slide_qpos]
        return HandState(
            grip_position=slides + GRIP_START,
            grip_velocity=qvel[:, self._slide_dofs],
            finger_positions=qpos[:, self.finger_qpos],
            finger_velocities=qvel[:, self.finger_dofs],
            target_origin=slides,
        )

    def command(self, state: HandState, action: np.ndarray) -> np.ndarray:
        target = state.target_origin + HAND_STEP * action[:, :3]
        return np.hstack([target, finger_targets(state.finger_positions, action)])


def add_finger(hand: mjcf.Element, side_name: str, side: int) -> mjcf.Element:
    """Adds a finger of the Fetch gripper on the positive (1) or negative (-1) y side of `hand`; returns its joint."""
    finger = hand.add("body", name=f"{side_name}_finger", pos=(0, 0.0159 * side, 0), gravcomp=1)
    finger.add("inertial", pos=(-0.01, 0, 0), mass=4, diaginertia=(0.1, 0.1, 0.1))
    finger.add("geom", name=f"{side_name}_finger", type="box", pos=(0, -0.008 * side, 0), size=(0.0385, 0.007, 0.0135),
               condim=4, friction=(1, 0.05, 0.01), rgba=_METAL, **_CONTACT)  # fmt: skip
    return finger.add("joint", name=f"{side_name}_finger", axis=(0, side, 0), **_FINGER_JOINT)


def add_finger_servos(root: mjcf.RootElement, joints: Iterable[mjcf.Element]) -> None:
    """Adds a position servo for each finger joint to the robot's model, in the order of `joints`."""
    for joint in joints:
        root.actuator.add("position", name=joint.name, joint=joint, kp=_FINGER_KP,
                          ctrllimited=True, ctrlrange=(0, FINGER_TARGET_LIMIT))  # fmt: skip
