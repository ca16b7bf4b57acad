"""The paper's arm: a Fetch robot whose hand is pulled by a mocap body.

Its MJCF and meshes come from the package gymnasium-robotics (MIT licence; extra `fetch`). Two changes make it move in
current MuJoCo as it did in the paper's version. Joints other than the fingers are unlimited. The weld's rotation is as
stiff as it was before MuJoCo 3.
"""

import importlib.resources
import importlib.util
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
from dm_control import composer, mjcf

from curiobench.tasks.observation import HandState
from curiobench.tasks.robots import HAND_ROTATION, HAND_STEP, Hand, Robot, add_finger_servos, finger_targets

_BASE_SLIDES = {"robot0:slide0": 0.405, "robot0:slide1": 0.48, "robot0:slide2": 0.0}
"""Position of the robot beside the table (metres)."""
_START_OFFSET = (-0.498, 0.005, -0.231)
"""Offset from the grip of the stretched arm to the point that the mocap body pulls it to before an episode (metres)."""
_SETTLING_STEPS = 500
"""Physics steps after which the hand is at rest."""
_WELD = dict(relpose=(0, 0, 0, 1, 0, 0, 0), solref=(0.02, 1), solimp=(0.9, 0.95, 0.001, 0.5, 2))
_WELD_TORQUE_SCALE = 4.06
"""MuJoCo 3 made the rotation of welds 16.5 times softer. The stiffness is proportional to the square of this scale."""


class FetchArm(Robot):
    """The Fetch arm, driven by a mocap body, with 20 physics steps of 2 ms per action."""

    timestep = 0.002

    def _build(self) -> None:
        self._mjcf_model = root = mjcf.from_xml_string(_fetch_xml(), model_dir=str(_assets()), escape_separators=True)
        root.model = "robot"
        for joint in root.find_all("joint"):
            if "finger" not in joint.name:
                joint.limited = False
        add_finger_servos(root, self._fingers)

    @property
    def _fingers(self) -> list[mjcf.Element]:
        return [self._mjcf_model.find("joint", f"robot0:{side}_gripper_finger_joint") for side in "rl"]

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        return self._mjcf_model

    def install(self, arena: composer.Arena) -> None:
        arena.attach(self)
        # a mocap body must be a child of the world body, so it cannot be part of the robot's model
        mocap = arena.mjcf_model.worldbody.add("body", name="mocap", mocap=True)
        hand = self._mjcf_model.find("body", "robot0:gripper_link")
        arena.mjcf_model.equality.add("weld", body1=mocap, body2=hand, torquescale=_WELD_TORQUE_SCALE, **_WELD)

    def bind(self, model: mujoco.MjModel) -> Hand:
        return _ArmHand(model)

    def start_configuration(self, model: mujoco.MjModel) -> np.ndarray:
        """Places the robot beside the table and lets the mocap body pull the hand to its start, without contacts."""
        data = mujoco.MjData(model)
        for name, position in _BASE_SLIDES.items():
            data.joint(f"robot/{name}").qpos = position
        mujoco.mj_forward(model, data)
        data.mocap_pos[0] = data.site("robot/robot0:grip").xpos + _START_OFFSET
        data.mocap_quat[0] = HAND_ROTATION
        flags = model.opt.disableflags
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        mujoco.mj_step(model, data, _SETTLING_STEPS)
        model.opt.disableflags = flags
        arm = [model.joint(i).qposadr[0] for i in range(model.njnt) if model.joint(i).name.startswith("robot/")]
        qpos = model.qpos0.copy()
        qpos[arm] = data.qpos[arm]
        return qpos


class _ArmHand(Hand):
    control_spec = int(
        mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT
    )

    def __init__(self, model: mujoco.MjModel):
        super().__init__(model, ("robot/robot0:r_gripper_finger_joint", "robot/robot0:l_gripper_finger_joint"))
        self._model = model
        self._data = mujoco.MjData(model)  # scratch for forward kinematics
        self._hand = model.body("robot/robot0:gripper_link").id
        self._grip = model.site("robot/robot0:grip").id

    def state(self, qpos: np.ndarray, qvel: np.ndarray) -> HandState:
        grip, velocity, pose = np.empty((len(qpos), 3)), np.empty((len(qpos), 6)), np.empty((len(qpos), 7))
        data = self._data
        for w in range(len(qpos)):
            data.qpos[:], data.qvel[:] = qpos[w], qvel[w]
            mujoco.mj_kinematics(self._model, data)
            mujoco.mj_comPos(self._model, data)
            mujoco.mj_comVel(self._model, data)
            mujoco.mj_objectVelocity(self._model, data, mujoco.mjtObj.mjOBJ_SITE, self._grip, velocity[w], 0)
            grip[w] = data.site_xpos[self._grip]
            pose[w, :3], pose[w, 3:] = data.xpos[self._hand], data.xquat[self._hand]
        return HandState(
            grip_position=grip,
            grip_velocity=velocity[:, 3:],
            finger_positions=qpos[:, self.finger_qpos],
            finger_velocities=qvel[:, self.finger_dofs],
            target_origin=pose,
        )

    def command(self, state: HandState, action: np.ndarray) -> np.ndarray:
        position = state.target_origin[:, :3] + HAND_STEP * action[:, :3]
        # the weighted sum of the current unit quaternion and the downward rotation turns the hand back to vertical
        rotation = state.target_origin[:, 3:] + HAND_ROTATION
        rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
        return np.hstack([finger_targets(state.finger_positions, action), position, rotation])


def _assets() -> Path:
    # found without an import, because the package registers environments and sets up its own renderer
    package = importlib.util.find_spec("gymnasium_robotics")
    if package is None or package.origin is None:
        raise ValueError("the robot 'fetch' needs the meshes of gymnasium-robotics: pip install 'curiobench[fetch]'")
    return Path(package.origin).parent / "envs" / "assets"


def _fetch_xml() -> str:
    """One self-contained model from the package's shared and robot files, without the parts that the task adds."""
    shared = ElementTree.parse(_assets() / "fetch" / "shared.xml").getroot()
    robot = ElementTree.parse(_assets() / "fetch" / "robot.xml").getroot()
    for assets in shared.findall("asset"):
        for texture in assets.findall("texture"):
            assets.remove(texture)
    for equality in shared.findall("equality"):
        shared.remove(equality)
    shared.insert(0, ElementTree.Element("compiler", angle="radian", meshdir="stls/fetch"))  # before the meshes
    world = ElementTree.SubElement(shared, "worldbody")
    world.extend(body for body in robot.findall("body") if body.get("mocap") is None)
    return ElementTree.tostring(shared, encoding="unicode")
