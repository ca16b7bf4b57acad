"""One world as a goal-conditioned Gymnasium environment."""

from typing import Any

import gymnasium as gym
import numpy as np

from curiobench.tasks.batch import BatchedStacking, Observation
from curiobench.tasks.gym_vector import (
    METADATA,
    action_space,
    as_dict,
    check_render_mode,
    observation_space,
    reset_options,
)
from curiobench.tasks.rendering import WorldRenderer


class SemanticStackEnv(gym.Env):
    """`gymnasium.make("curiobench/SemanticStack3-v0", robot="gripper")`.

    Observations are dicts of "observation", "achieved_goal" and "desired_goal". Reward is 1 after each step in which
    the goal holds. Episodes take 50 steps and are then truncated. `reset(options={"goal": "a on b", "biased": True})`
    fixes the goal and the kind of start of one episode.
    """

    metadata = METADATA

    def __init__(self, task: str = "stack3", robot: str = "gripper", render_mode: str | None = None):
        """Compiles the task.

        Args:
          task: "stack2" to "stack5".
          robot: "gripper" or "fetch".
          render_mode: None or "rgb_array".

        Raises:
          ValueError: an unknown task, robot or render mode.
        """
        check_render_mode(render_mode)
        self._worlds = BatchedStacking(task, 1, robot)
        self.render_mode = render_mode
        self.observation_space = observation_space(self._worlds)
        self.action_space = action_space()
        self._renderer: WorldRenderer | None = None

    @property
    def goal_space(self):
        """The task's predicates and valid goals, a `GoalSpace`."""
        return self._worlds.goal_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Starts an episode; see the class for `options`."""
        super().reset(seed=seed)
        self._worlds.rng = self.np_random
        seen = self._worlds.reset(**reset_options(self._worlds, options))
        return self._first(seen), self._info(self._worlds.compute_reward(seen.achieved_goal, seen.desired_goal))

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Carries out one action `(4,)`."""
        seen, reward = self._worlds.step(np.asarray(action)[None])
        return self._first(seen), float(reward[0]), False, bool(self._worlds.truncated[0]), self._info(reward)

    def _first(self, seen: Observation) -> dict[str, np.ndarray]:
        return {name: array[0] for name, array in as_dict(seen).items()}

    def _info(self, reward: np.ndarray) -> dict[str, Any]:
        return {"is_success": bool(reward[0] > 0), "diverged": bool(self._worlds.diverged[0])}

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: object) -> np.ndarray:
        """Reward of a goal `(n_bits,)`, or rewards `(...)` of many `(..., n_bits)`."""
        return self._worlds.compute_reward(achieved_goal, desired_goal, info)

    def render(self) -> np.ndarray | None:
        """A picture `(480, 640, 3)` uint8; None without render mode."""
        if self.render_mode is None:
            return None
        self._renderer = self._renderer or WorldRenderer(self._worlds.model)
        return self._renderer.render(self._worlds.qpos[0])

    def close(self) -> None:
        """Frees the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
