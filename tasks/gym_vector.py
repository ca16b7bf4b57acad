"""Many worlds as a native Gymnasium `VectorEnv`, and the spaces that the single environment shares with it."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from curiobench.tasks.batch import BatchedStacking, Observation
from curiobench.tasks.rendering import WorldRenderer

METADATA = {"render_modes": ["rgb_array"], "render_fps": 25}
_OPTIONS = ("goal", "biased")


def observation_space(worlds: BatchedStacking) -> gym.spaces.Dict:
    """The goal-conditioned observation space of one world."""
    bits = (worlds.goal_space.n_bits,)
    return gym.spaces.Dict(
        observation=gym.spaces.Box(-np.inf, np.inf, (worlds.observation_size,), np.float32),
        achieved_goal=gym.spaces.Box(0, 1, bits, np.float32),
        desired_goal=gym.spaces.Box(0, 1, bits, np.float32),
    )


def action_space() -> gym.spaces.Box:
    """Hand displacement (x, y, z) and finger displacement, each in [-1, 1]."""
    return gym.spaces.Box(-1, 1, (4,), np.float32)


def reset_options(worlds: BatchedStacking, options: dict[str, Any] | None) -> dict[str, Any]:
    """Turns `options={"goal": …, "biased": …}` into arguments of `BatchedStacking.reset`.

    A goal is anything that `GoalSpace.parse` understands, or an array `(N, n_bits)` with a goal for each world.

    Raises:
      ValueError: an unknown option or goal.
    """
    options = dict(options or {})
    unknown = set(options) - {*_OPTIONS, "reset_mask"}
    if unknown:
        raise ValueError(f"unknown reset option {min(unknown)!r}: the options are {', '.join(_OPTIONS)}")
    goal = options.get("goal")
    if goal is not None and np.ndim(goal) < 2:
        goal = worlds.goal_space.parse(goal)
    return {"goals": goal, "biased": options.get("biased", False)}


def as_dict(seen: Observation) -> dict[str, np.ndarray]:
    """The observation of N worlds as a Gymnasium dict."""
    return {
        "observation": seen.observation,
        "achieved_goal": seen.achieved_goal,
        "desired_goal": seen.desired_goal,
    }


class SemanticStackVectorEnv(VectorEnv):
    """N worlds stepped together; `gymnasium.make_vec("curiobench/SemanticStack3-v0", num_envs=64)`.

    Episodes take 50 steps and are then truncated; the next step starts new ones (`AutoresetMode.NEXT_STEP`), with the
    options of the last `reset`, or the same step does (`SAME_STEP`), with the old end in `info["final_obs"]`.
    `info["is_success"]` `(N,)` tells where the goal holds, `info["diverged"]` where the physics had to be reset.
    """

    metadata = METADATA | {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        task: str = "stack3",
        robot: str = "gripper",
        n_threads: int = 1,
        render_mode: str | None = None,
        autoreset_mode: "str | AutoresetMode" = AutoresetMode.NEXT_STEP,
    ):
        """Compiles the task.

        Args:
          num_envs: number of worlds.
          task: "stack2" to "stack5".
          robot: "gripper" or "fetch".
          n_threads: threads that step the worlds.
          render_mode: None or "rgb_array".
          autoreset_mode: when a world that has ended starts anew.

        Raises:
          ValueError: an unknown task, robot or render mode, or no worlds.
        """
        check_render_mode(render_mode)
        self._worlds = BatchedStacking(task, num_envs, robot, n_threads)
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.metadata = METADATA | {"autoreset_mode": AutoresetMode(autoreset_mode)}
        self.single_observation_space = observation_space(self._worlds)
        self.single_action_space = action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._options: dict[str, Any] = {}
        self._renderer: WorldRenderer | None = None

    def reset(
        self, *, seed: "int | None" = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Starts new episodes in all worlds, or in those of `options["reset_mask"]` `(N,)`."""
        if seed is not None:
            self._worlds.rng = np.random.default_rng(seed)
        arguments = reset_options(self._worlds, options)
        seen = self._worlds.reset((options or {}).get("reset_mask"), **arguments)
        self._options = arguments
        return as_dict(seen), {}

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Carries out actions `(N, 4)`."""
        ended = self._worlds.truncated
        seen, reward = self._worlds.step(actions)
        info = {"is_success": reward > 0, "diverged": self._worlds.diverged}
        if self.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP and ended.any():
            seen = self._start_over(ended)
            reward[ended] = 0
            info["is_success"] = info["is_success"] & ~ended
        truncated = self._worlds.truncated
        if self.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP and truncated.any():
            info["final_obs"] = as_dict(seen)
            seen = self._start_over(truncated)
        return as_dict(seen), reward, np.zeros(self.num_envs, bool), truncated, info

    def _start_over(self, ended: np.ndarray) -> Observation:
        arguments = {
            name: value[ended] if np.ndim(value) == (2 if name == "goals" else 1) else value
            for name, value in self._options.items()
        }
        return self._worlds.reset(ended, **arguments)

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: object) -> np.ndarray:
        """Rewards `(...)` of goals `(..., n_bits)`."""
        return self._worlds.compute_reward(achieved_goal, desired_goal, info)

    def render(self) -> tuple[np.ndarray, ...] | None:
        """One picture `(480, 640, 3)` uint8 for each world; None without render mode."""
        if self.render_mode is None:
            return None
        self._renderer = self._renderer or WorldRenderer(self._worlds.model)
        return tuple(self._renderer.render(qpos) for qpos in self._worlds.qpos)

    def close_extras(self, **kwargs: Any) -> None:
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def check_render_mode(render_mode: str | None) -> None:
    """Raises ValueError for an unknown render mode."""
    if render_mode not in (None, *METADATA["render_modes"]):
        raise ValueError(f"unknown render mode {render_mode!r}: it is None or 'rgb_array'")
