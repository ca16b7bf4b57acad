"""One world as a goal-conditioned Gymnasium environment."""

from typing import Any

import gymnasium as gym
import mujoco
import numpy as np

from curiobench.tasks.batch import BatchedStacking, Observation
from curiobench.tasks.gym_common import (
    METADATA,
    GoalWorlds,
    action_space,
    as_dict,
    observation_space,
    read_options,
    start,
)
from curiobench.tasks.observation import CONTROL_TIMESTEP
from curiobench.tasks.rendering import HEIGHT, WIDTH
from curiobench.tasks.scene import CAMERA


class SemanticStackEnv(GoalWorlds, gym.Env):
    """`gymnasium.make("curiobench/SemanticStack3-v0", robot="gripper")`.

    Observations are dicts of "observation", "achieved_goal" and "desired_goal". The reward is 1 for each step after
    which the goal holds, else 0. `reset(options={"goal": "a on b", "biased": True})` sets the goal and the kind of
    start of one episode. This class never ends an episode. `gymnasium.make` adds a `TimeLimit` wrapper, which truncates
    episodes after the task's horizon or `max_episode_steps`.
    """

    metadata = METADATA

    def __init__(
        self,
        task: str = "stack3",
        robot: str = "gripper",
        render_mode: str | None = None,
        width: int = WIDTH,
        height: int = HEIGHT,
        camera_name: str = CAMERA,
    ):
        """Compiles the task.

        Args:
          task: name of the task, one of `TASKS`.
          robot: "gripper" or "fetch".
          render_mode: None or "rgb_array".
          width, height: size of a rendered image, in pixels.
          camera_name: name of one of the model's cameras.

        Raises:
          ValueError: the task, robot, render mode or camera is unknown, or a size is out of range.
        """
        self._open(BatchedStacking(task, 1, robot), render_mode, height, width, camera_name)
        self.observation_space = observation_space(self._worlds)
        self.action_space = action_space()

    @property
    def data(self) -> mujoco.MjData:
        """A copy of the world as `MjData`, updated after every reset and step. Writing to it does not move the world.

        It holds the positions, the velocities, what MuJoCo computes from them, and the seconds since the reset.
        Controls, forces and accelerations are not those of the last step.
        """
        if self._data is None:
            self._data = mujoco.MjData(self.model)
            self._follow(self._data)
        return self._data

    def _follow(self, data: mujoco.MjData) -> None:
        data.qpos[:], data.qvel[:] = self._worlds.qpos[0], self._worlds.qvel[0]
        data.time = self._worlds.step_counts[0] * CONTROL_TIMESTEP
        mujoco.mj_step1(self.model, data)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Starts an episode. The class docstring describes `options`."""
        arrays = read_options(self._worlds, options)
        super().reset(seed=seed)
        self._worlds.rng = self.np_random
        seen = start(self._worlds, arrays, np.array([True]))
        return self._show(seen), self._info(self._worlds.compute_reward(seen.achieved_goal, seen.desired_goal), False)

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Carries out one action `(4,)`."""
        seen, reward = self._worlds.step(np.asarray(action)[None])
        return self._show(seen), float(reward[0]), False, False, self._info(reward, bool(self._worlds.diverged[0]))

    def _show(self, seen: Observation) -> dict[str, np.ndarray]:
        if self._data is not None:
            self._follow(self._data)
        return {name: array[0] for name, array in as_dict(seen).items()}

    def _info(self, reward: np.ndarray, diverged: bool) -> dict[str, Any]:
        return {"is_success": bool(reward[0] > 0), "diverged": diverged}

    def render(self) -> np.ndarray | None:
        """An image `(height, width, 3)` uint8; None without render mode."""
        pictures = self._pictures()
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Frees the renderer."""
        self._close_renderer()
