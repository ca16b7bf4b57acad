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

    Observations are dicts of "observation", "achieved_goal" and "desired_goal". Reward is 1 after each step in which
    the goal holds. `reset(options={"goal": "a on b", "biased": True})` fixes the goal and the kind of start of one
    episode. Episodes go on for ever here; `gymnasium.make` truncates them after the task's horizon
    or `max_episode_steps`.
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
          task: a task's name, one of `TASKS`.
          robot: "gripper" or "fetch".
          render_mode: None or "rgb_array".
          width, height: of a picture, in pixels.
          camera_name: the camera of the pictures, one of the model's.

        Raises:
          ValueError: an unknown task, robot, render mode or camera, or a size out of range.
        """
        self._open(BatchedStacking(task, 1, robot), render_mode, height, width, camera_name)
        self.observation_space = observation_space(self._worlds)
        self.action_space = action_space()

    @property
    def data(self) -> mujoco.MjData:
        """The world as MuJoCo's data, which follows the world from its first use on; writing to it moves nothing.

        It holds what depends on positions and velocities, and the seconds since the reset. Controls, forces and
        accelerations are not those of the last step.
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
        """Starts an episode; see the class for `options`."""
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
        """A picture `(height, width, 3)` uint8; None without render mode."""
        pictures = self._pictures()
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Frees the renderer."""
        self._close_renderer()
