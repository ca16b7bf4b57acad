"""The semantic-stacking task as a dm_control composer task, and code shared with the batched worlds."""

import collections

import mujoco
import numpy as np
from dm_control import composer, mjcf
from dm_control.composer.observation import observable
from dm_env import specs

from curiobench.tasks import observation as obs
from curiobench.tasks.goal_names import BLOCK_NAMES
from curiobench.tasks.goals import GoalSpace, predicates
from curiobench.tasks.registration import check_robot, task_spec
from curiobench.tasks.robots import FreeGripper, Robot
from curiobench.tasks.scene import Block
from curiobench.tasks.spec import ACTION_SIZE, TaskSpec
from curiobench.tasks.starts import HELD_FINGER_POSITION, NONE_HELD, BiasedStarts

_ACTION_TOLERANCE = 1e-5
"""Amount by which an action may exceed ±1, to allow for rounding."""


class StackingModel:
    """A compiled model with the indices at which the task reads and writes its state, for N worlds at once.

    Args:
      model: compiled from the MJCF of a `SemanticStacking` task.
      spec: the task's definition.
      robot: the task's robot.
      block_joints: names of the blocks' free joints.
    """

    def __init__(self, model: mujoco.MjModel, spec: TaskSpec, robot: Robot, block_joints: list[str]):
        self.model = model
        self._spec = spec
        self.hand = robot.bind(model)
        self.n_substeps = robot.n_substeps
        joints = [model.joint(name) for name in block_joints]
        self._qpos = np.array([joint.qposadr[0] + np.arange(7) for joint in joints])
        self._qvel = np.array([joint.dofadr[0] + np.arange(6) for joint in joints])
        self._start = robot.start_configuration(model)

    def block_positions(self, qpos: np.ndarray) -> np.ndarray:
        """Centres `(N, n, 3)` in metres, from positions `(N, nq)`."""
        return qpos[:, self._qpos[:, :3]]

    def observation(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Observations `(N, 10 + 15 n)` of positions `(N, nq)` and velocities `(N, nv)`."""
        return obs.observation(self.hand.state(qpos, qvel), self._block_states(qpos, qvel))

    def _block_states(self, qpos: np.ndarray, qvel: np.ndarray) -> obs.BlockStates:
        poses, velocities = qpos[:, self._qpos], qvel[:, self._qvel]
        return obs.BlockStates(poses[..., :3], poses[..., 3:], velocities[..., :3], velocities[..., 3:])

    def command(self, qpos: np.ndarray, qvel: np.ndarray, action: np.ndarray) -> np.ndarray:
        """The hand's command `(N, k)` that carries out actions `(N, 4)`."""
        return self.hand.command(self.hand.state(qpos, qvel), action)

    def sample_starts(self, rng: np.random.Generator, biased: np.ndarray, probabilities: BiasedStarts) -> np.ndarray:
        """Draws start positions `(N, nq)`; `biased` `(N,)` says which worlds have biased starts."""
        positions, held = self._spec.starts(rng, biased, self._spec.n_blocks, probabilities)
        qpos = self.place_blocks(positions)
        holding = held != NONE_HELD
        qpos[np.ix_(holding, self.hand.finger_qpos)] = HELD_FINGER_POSITION
        return qpos

    def place_blocks(self, positions: np.ndarray) -> np.ndarray:
        """Positions `(N, nq)` with the hand at its start and upright blocks at centres `(N, n, 3)` in metres."""
        qpos = np.tile(self._start, (len(positions), 1))
        qpos[:, self._qpos[:, :3]] = positions
        qpos[:, self._qpos[:, 3:]] = (1, 0, 0, 0)
        return qpos


class SemanticStacking(composer.Task):
    """Bring n blocks into a goal configuration. A step's reward is 1 if all predicates match after it, else 0."""

    def __init__(
        self,
        spec: TaskSpec,
        robot: Robot,
        goal: "str | int | np.ndarray | None" = None,
        biased: bool = False,
    ):
        """Builds the scene.

        Args:
          spec: the task's definition.
          robot: a robot that no other task uses.
          goal: a goal that `GoalSpace.parse` accepts; None draws one of the valid goals for every episode.
          biased: whether starts are biased towards stacks and a held block.

        Raises:
          ValueError: the goal is unknown.
        """
        self.spec = spec
        self.goal_space: GoalSpace = spec.goal_space
        self.biased = biased
        self._probabilities = BiasedStarts()
        self._fixed_goal = None if goal is None else self.goal_space.parse(goal)
        self._goal = self.goal_space.goals[0] if self._fixed_goal is None else self._fixed_goal
        self._step_count = 0
        self._robot = robot
        self._arena = spec.arena()
        # composer's default arena sets elliptic cones and noslip iterations, which the paper's model does not have
        self._arena.mjcf_model.option.set_attributes(cone="pyramidal", noslip_iterations=0)
        robot.install(self._arena)
        self._block_joints = [Block(index).add_to(self._arena) for index in range(spec.n_blocks)]
        self.set_timesteps(control_timestep=obs.CONTROL_TIMESTEP, physics_timestep=robot.timestep)
        self._bound: StackingModel | None = None
        self._observed: tuple[bytes, np.ndarray] = (b"", np.empty(0))
        self._task_observables = self._named_observables()

    @property
    def root_entity(self) -> composer.Entity:
        return self._arena

    @property
    def task_observables(self) -> dict[str, observable.Observable]:
        return self._task_observables

    def set_goal(self, goal: "str | int | np.ndarray | None") -> None:
        """Sets the goal from the next episode on. None draws one of the valid goals for every episode.

        Raises:
          ValueError: see `GoalSpace.parse`.
        """
        self._fixed_goal = None if goal is None else self.goal_space.parse(goal)

    def compile(self) -> StackingModel:
        """Compiles the scene for stepping outside of composer."""
        return self._bind(mjcf.Physics.from_mjcf_model(self._arena.mjcf_model).model.ptr)

    def bound(self, physics: mjcf.Physics) -> StackingModel:
        """The `StackingModel` for the model of `physics`, cached until the model changes."""
        if self._bound is None or self._bound.model is not physics.model.ptr:
            self._bound = self._bind(physics.model.ptr)
        return self._bound

    def _bind(self, model: mujoco.MjModel) -> StackingModel:
        return StackingModel(model, self.spec, self._robot, [joint.full_identifier for joint in self._block_joints])

    def initialize_episode(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        rng = np.random.default_rng(random_state.randint(1 << 32, size=4, dtype=np.uint64))
        physics.data.qpos[:] = self.bound(physics).sample_starts(rng, np.array([self.biased]), self._probabilities)[0]
        physics.data.qvel[:] = 0
        goals = self.goal_space.goals
        self._goal = goals[rng.integers(len(goals))] if self._fixed_goal is None else self._fixed_goal
        self._step_count = 0

    def action_spec(self, physics: mjcf.Physics) -> specs.BoundedArray:
        return specs.BoundedArray((ACTION_SIZE,), np.float32, -1.0, 1.0, name="dx\tdy\tdz\tfingers")

    def before_step(self, physics: mjcf.Physics, action: np.ndarray, random_state: np.random.RandomState) -> None:
        model, data, bound = physics.model.ptr, physics.data.ptr, self.bound(physics)
        command = bound.command(data.qpos[None], data.qvel[None], check_actions(action, 1))
        mujoco.mj_setState(model, data, command[0], bound.hand.control_spec)
        # as in a batched step: no warm start of the solver, and kinematics recomputed after the command is set
        data.qacc_warmstart[:] = 0
        mujoco.mj_step1(model, data)

    def after_step(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self._step_count += 1

    def achieved_goal(self, physics: mjcf.Physics) -> np.ndarray:
        """The predicates that hold now, `(n_bits,)`."""
        return predicates(self.bound(physics).block_positions(physics.data.qpos[None]))[0]

    def get_reward(self, physics: mjcf.Physics) -> float:
        return float(np.array_equal(self.achieved_goal(physics), self._goal))

    def should_terminate_episode(self, physics: mjcf.Physics) -> bool:
        # this is a time limit, not a failure, so the discount stays 1
        return self._step_count >= self.spec.horizon

    def _named_observables(self) -> dict[str, observable.Observable]:
        """The flat vectors that agents get as input, and every part of the state vector by name."""
        named = collections.OrderedDict(
            observation=observable.Generic(self._observation),
            achieved_goal=observable.Generic(self.achieved_goal),
            desired_goal=observable.Generic(lambda physics: self._goal),
        )
        for name, part in obs.BODY_PARTS.items():
            named[f"hand/{name}"] = self._part(part)
        for index in range(self.spec.n_blocks):
            start = obs.BODY_SIZE + obs.BLOCK_SIZE * index
            for name, part in obs.BLOCK_PARTS.items():
                named[f"block_{BLOCK_NAMES[index]}/{name}"] = self._part(slice(start + part.start, start + part.stop))
        for entry in named.values():
            entry.enabled = True
        return named

    def _part(self, part: slice) -> observable.Observable:
        return observable.Generic(lambda physics: self._observation(physics)[part])

    def _observation(self, physics: mjcf.Physics) -> np.ndarray:
        """The state vector, cached per state because every named part reads it."""
        state = physics.data.qpos.tobytes() + physics.data.qvel.tobytes()
        if state != self._observed[0]:
            vector = self.bound(physics).observation(physics.data.qpos[None], physics.data.qvel[None])[0]
            self._observed = (state, vector)
        return self._observed[1]


def check_actions(actions: np.ndarray, n_worlds: int) -> np.ndarray:
    """Actions as `(n_worlds, 4)` float64 in [-1, 1].

    Raises:
      ValueError: the shape is wrong, or a value is not finite or outside [-1, 1].
    """
    actions = np.asarray(actions, dtype=np.float64)
    if actions.shape != (n_worlds, ACTION_SIZE) and not (n_worlds == 1 and actions.shape == (ACTION_SIZE,)):
        raise ValueError(f"actions must have shape ({n_worlds}, {ACTION_SIZE}), got {actions.shape}")
    actions = actions.reshape(n_worlds, ACTION_SIZE)
    # this comparison is False for NaN too
    if not (np.abs(actions) <= 1 + _ACTION_TOLERANCE).all():
        world, entry = np.argwhere(~(np.abs(actions) <= 1 + _ACTION_TOLERANCE))[0]
        raise ValueError(f"actions must lie in [-1, 1], got {actions[world, entry]} in entry {entry} of world {world}")
    return actions.clip(-1, 1)


def make_stacking(
    task: str, robot: str, goal: "str | int | np.ndarray | None" = None, biased: bool = False
) -> SemanticStacking:
    """A task by name, with a new robot. Arguments and errors are those of `load`."""
    check_robot(task, robot)
    return SemanticStacking(task_spec(task), _make_robot(robot), goal, biased)


def _make_robot(name: str) -> Robot:
    """A new robot by name; raises ValueError if its meshes are not installed."""
    if name == "fetch":
        from curiobench.tasks.fetch import FetchArm  # needs the extra `fetch`

        return FetchArm()
    return FreeGripper()


def load(
    task: str = "stack3",
    robot: str = "gripper",
    goal: "str | int | np.ndarray | None" = None,
    biased: bool = False,
    random_state: "int | np.random.RandomState | None" = None,
) -> composer.Environment:
    """Builds a dm_control environment.

    Args:
      task: name of the task, one of `TASKS`.
      robot: "gripper" (a free-floating hand, fast) or "fetch" (the paper's arm).
      goal: name, bit string, index or bits of a goal; None draws one of the valid goals for every episode.
      biased: whether starts are biased towards stacks and a held block.
      random_state: seed of the starts and goals.

    Raises:
      ValueError: the task, robot or goal is unknown, or the task does not support the robot.
    """
    return composer.Environment(
        make_stacking(task, robot, goal, biased),
        random_state=random_state,
        strip_singleton_obs_buffer_dim=True,
        recompile_mjcf_every_episode=False,
    )
