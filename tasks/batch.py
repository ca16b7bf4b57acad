"""Batched worlds: the compiled model of the composer task, stepped by MuJoCo's thread pool.

One call advances all worlds by one action. Observations, achieved goals and rewards are computed in numpy for all
worlds together. A world is reset by writing its positions and velocities. Results do not depend on the number of
threads.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout

from curiobench.tasks.goals import GoalSpace, predicates
from curiobench.tasks.observation import observation_size
from curiobench.tasks.spec import TaskSpec
from curiobench.tasks.stacking import check_actions, make_stacking
from curiobench.tasks.starts import BiasedStarts

logger = logging.getLogger(__name__)

_STATE_SPEC = mujoco.mjtState.mjSTATE_FULLPHYSICS
_MAX_SPEED = 1e4
"""A generalised velocity above this means that the simulation has diverged (metres or radians per second)."""


@dataclass
class Observation:
    """The observation of N worlds after a step or a reset. The arrays are copies that the caller may keep."""

    observation: np.ndarray
    """`(N, 10 + 15 n)` float32 state vectors."""
    achieved_goal: np.ndarray
    """`(N, n_bits)` float32 predicates, 1 where they hold."""
    desired_goal: np.ndarray
    """`(N, n_bits)` float32 goals."""


class BatchedStacking:
    """N independent worlds of one semantic-stacking task.

    Attributes:
      n_worlds: number of worlds N.
      spec: the task's definition.
      goal_space: the task's predicates and valid goals.
      step_counts: `(N,)` actions since each world's last reset.
      diverged: `(N,)` bool, worlds whose physics diverged in the last step and that were therefore reset.
      divergences: number of such resets since construction.
    """

    def __init__(
        self,
        task: str = "stack3",
        n_worlds: int = 1,
        robot: str = "gripper",
        n_threads: int = 1,
        seed: "int | np.random.SeedSequence | None" = None,
        probabilities: BiasedStarts | None = None,
    ):
        """Compiles the task and resets every world to a plain start.

        Args:
          task: name of the task, one of `TASKS`.
          n_worlds: number of worlds, at least 1.
          robot: "gripper" or "fetch".
          n_threads: number of threads that step the worlds. Results do not depend on it.
          seed: seed of the start positions and of goals that are not given.
          probabilities: probabilities of biased starts; those of the paper by default.

        Raises:
          ValueError: the task or robot is unknown, the task does not support the robot, or there is less than one world
            or thread.
        """
        if n_worlds < 1 or n_threads < 1:
            raise ValueError(f"at least one world and one thread are needed, got {n_worlds} and {n_threads}")
        stacking = make_stacking(task, robot)
        self.n_worlds = n_worlds
        self.spec: TaskSpec = stacking.spec
        self.goal_space: GoalSpace = stacking.goal_space
        self._probabilities = probabilities or BiasedStarts()
        self._bound = stacking.compile()
        self.model = self._bound.model
        self.rng = np.random.default_rng(seed)
        self._make_buffers(n_threads)
        self.reset()

    def _make_buffers(self, n_threads: int) -> None:
        model, n = self.model, self.n_worlds
        n_state = mujoco.mj_stateSize(model, _STATE_SPEC)
        if n_state != 1 + model.nq + model.nv:
            raise RuntimeError(f"the model has state beside time, qpos and qvel: {n_state - 1 - model.nq - model.nv}")
        # with one thread, the caller's thread does the stepping, which saves a thread switch
        self._rollout = rollout.Rollout(nthread=n_threads if n_threads > 1 else 0)
        self._models = [model] * n
        # each thread takes its worlds in four chunks: MuJoCo's default of forty loses a tenth of a second thread's gain
        self._chunk = max(1, n // (4 * n_threads))
        self._data = [mujoco.MjData(model) for _ in range(n_threads)]
        self._state = np.zeros((n, n_state))
        self._trajectory = np.zeros((n, self._bound.n_substeps, n_state))
        self._control = np.zeros((n, self._bound.n_substeps, mujoco.mj_stateSize(model, self._bound.hand.control_spec)))
        self._sensors = np.zeros((n, self._bound.n_substeps, model.nsensordata))
        self._qpos = self._state[:, 1 : 1 + model.nq]
        self._qvel = self._state[:, 1 + model.nq :]
        self.desired_goal = np.zeros((n, self.goal_space.n_bits), np.float32)
        self.step_counts = np.zeros(n, np.int64)
        self.diverged = np.zeros(n, bool)
        self.divergences = 0

    @property
    def observation_size(self) -> int:
        return observation_size(self.spec.n_blocks)

    @property
    def horizon(self) -> int:
        """Actions per episode."""
        return self.spec.horizon

    def reset(
        self,
        worlds: np.ndarray | None = None,
        biased: "bool | np.ndarray" = False,
        goals: np.ndarray | None = None,
    ) -> Observation:
        """Starts new episodes.

        Args:
          worlds: `(k,)` indices or `(N,)` bool of the worlds to reset; all by default.
          biased: whether the starts are biased, one bool or `(k,)`.
          goals: `(n_bits,)` or `(k, n_bits)` desired goals; drawn uniformly from the valid goals by default.

        Returns:
          The observation of all N worlds.

        Raises:
          ValueError: a goal is not valid or an index does not exist.
        """
        worlds = self._world_indices(worlds)
        goals = self._check_goals(goals, len(worlds))
        biased = np.broadcast_to(np.asarray(biased, bool), (len(worlds),))
        self._qpos[worlds] = self._bound.sample_starts(self.rng, biased, self._probabilities)
        self._qvel[worlds] = 0
        self.step_counts[worlds] = 0
        self.desired_goal[worlds] = goals
        return self.observe()

    def _world_indices(self, worlds: np.ndarray | None) -> np.ndarray:
        indices = np.arange(self.n_worlds)
        try:
            return indices if worlds is None else np.atleast_1d(indices[np.asarray(worlds)])
        except IndexError as error:
            raise ValueError(f"there are {self.n_worlds} worlds: {error}") from None

    def _check_goals(self, goals: np.ndarray | None, n: int) -> np.ndarray:
        space = self.goal_space
        if goals is None:
            return space.goals[self.rng.integers(len(space), size=n)]
        goals = np.asarray(goals)
        if goals.ndim == 1:
            return space.check(goals)
        if goals.shape != (n, space.n_bits):
            raise ValueError(f"goals for {n} worlds must have shape ({n}, {space.n_bits}), got {goals.shape}")
        for bits in goals[~np.isin(goals, (0, 1)).all(axis=1) | (space.indices(goals) < 0)]:
            space.check(bits)  # raises
        return goals

    def pursue(self, goals: np.ndarray) -> Observation:
        """Replaces the desired goals of all worlds by valid goals `(N, n_bits)`, at any time in an episode."""
        self.desired_goal[:] = self._check_goals(goals, self.n_worlds)
        return self.observe()

    def place(self, worlds: np.ndarray, positions: np.ndarray) -> Observation:
        """Starts new episodes with upright blocks at centres `(k, n, 3)` in metres and the hand at its start."""
        worlds = self._world_indices(worlds)
        self._qpos[worlds] = self._bound.place_blocks(np.asarray(positions, np.float64))
        self._qvel[worlds] = 0
        self.step_counts[worlds] = 0
        return self.observe()

    def step(self, actions: np.ndarray) -> tuple[Observation, np.ndarray]:
        """Carries out one action in every world.

        Args:
          actions: `(N, 4)` in [-1, 1].

        Returns:
          The observation, and the rewards `(N,)` float32: 1 where the achieved goal equals the desired goal, else 0.

        Raises:
          ValueError: the actions have a wrong shape, are not finite or are out of range. No world is stepped then.
        """
        actions = check_actions(actions, self.n_worlds)
        command = self._bound.command(self._qpos, self._qvel, actions)
        self._state[:, 0] = 0  # each control step begins at time 0, so that a reset by MuJoCo can be detected
        self._control[:] = command[:, None]
        self._rollout.rollout(
            self._models,
            self._data,
            self._state,
            self._control,
            control_spec=self._bound.hand.control_spec,
            skip_checks=True,
            nstep=self._bound.n_substeps,
            state=self._trajectory,
            sensordata=self._sensors,
            chunk_size=self._chunk,
        )
        self._state[:] = self._trajectory[:, -1]
        self.step_counts += 1
        self._recover_diverged()
        seen = self.observe()
        return seen, self.compute_reward(seen.achieved_goal, seen.desired_goal)

    def _recover_diverged(self) -> None:
        """Resets worlds whose physics diverged to a plain start. Their goals and step counts do not change."""
        duration = self._bound.n_substeps * self.model.opt.timestep
        sane = np.isfinite(self._state).all(axis=1) & (np.abs(self._qvel) < _MAX_SPEED).all(axis=1)
        # MuJoCo resets a world by itself, and its time with it, when it finds a number that is not finite or too large
        self.diverged = ~(sane & (np.abs(self._state[:, 0] - duration) < self.model.opt.timestep / 2))
        if self.diverged.any():
            worlds = np.flatnonzero(self.diverged)
            self.divergences += len(worlds)
            logger.warning("physics diverged and was reset in worlds %s (%d so far)", worlds.tolist(), self.divergences)
            self._qpos[worlds] = self._bound.sample_starts(self.rng, np.zeros(len(worlds), bool), self._probabilities)
            self._qvel[worlds] = 0

    def observe(self) -> Observation:
        """The current observation of all worlds."""
        return Observation(
            observation=self._bound.observation(self._qpos, self._qvel),
            achieved_goal=predicates(self.block_positions),
            desired_goal=self.desired_goal.copy(),
        )

    @property
    def block_positions(self) -> np.ndarray:
        """Centres of the blocks `(N, n, 3)` in metres."""
        return self._bound.block_positions(self._qpos)

    @property
    def qpos(self) -> np.ndarray:
        """Positions `(N, nq)`; a view, for rendering."""
        return self._qpos

    @property
    def qvel(self) -> np.ndarray:
        """Velocities `(N, nv)`; a view, for reading."""
        return self._qvel

    @staticmethod
    def compute_reward(achieved_goal: np.ndarray, desired_goal: np.ndarray, info: object = None) -> np.ndarray:
        """Rewards `(...)` float32 of achieved and desired goals `(..., n_bits)`: 1 where all bits agree, else 0."""
        return (np.asarray(achieved_goal) == np.asarray(desired_goal)).all(axis=-1).astype(np.float32)

    def state_dict(self) -> dict[str, object]:
        """Everything that later steps depend on, as arrays and plain values."""
        return {
            "state": self._state.copy(),
            "desired_goal": self.desired_goal.copy(),
            "step_counts": self.step_counts.copy(),
            "divergences": self.divergences,
            "rng": self.rng.bit_generator.state,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores the state that `state_dict` returned."""
        self._state[:] = state["state"]
        self.desired_goal[:] = state["desired_goal"]
        self.step_counts[:] = state["step_counts"]
        self.divergences = int(state["divergences"])
        self.rng.bit_generator.state = state["rng"]

    def __getstate__(self) -> dict[str, object]:
        """For pickle and deepcopy: everything but the buffers. Some are views of others, which a copy would break."""
        names = ("n_worlds", "spec", "goal_space", "_probabilities", "_bound", "model", "rng", "diverged")
        return {name: vars(self)[name] for name in names} | {"n_threads": len(self._data), "kept": self.state_dict()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        kept, n_threads, diverged = (state.pop(name) for name in ("kept", "n_threads", "diverged"))
        vars(self).update(state)
        self._make_buffers(n_threads)
        self.diverged = diverged
        self.load_state_dict(kept)
