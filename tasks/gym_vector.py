"""Many worlds as a native Gymnasium `VectorEnv`."""

from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

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
from curiobench.tasks.registration import task_spec
from curiobench.tasks.rendering import HEIGHT, WIDTH
from curiobench.tasks.scene import CAMERA


class SemanticStackVectorEnv(GoalWorlds, VectorEnv):
    """N worlds stepped together; `gymnasium.make_vec("curiobench/SemanticStack3-v0", num_envs=64)`.

    Episodes are truncated after the task's horizon. What starts the next episode depends on the autoreset mode:

    - NEXT_STEP: the next step starts it and ignores the action.
    - SAME_STEP: the step that ends an episode also starts the next. `info["final_obs"]` `(N,)` and
      `info["final_info"]` hold the last observation and info of the old one.
    - DISABLED: the caller does, with `reset`. `options["reset_mask"]` `(N,)` selects the worlds to reset.

    Reset options are those of the single environment; each may also be a list of N. Autoresets use the options of the
    last `reset` of their world. `info["is_success"]` `(N,)` says where the goal holds. `info["diverged"]` `(N,)` says
    where the physics diverged and was reset. `info["_is_success"]` and `info["_diverged"]` `(N,)` mark the worlds for
    which the entry is valid, as usual in Gymnasium.
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
        max_episode_steps: int | None = None,
        width: int = WIDTH,
        height: int = HEIGHT,
        camera_name: str = CAMERA,
    ):
        """Compiles the task.

        Args:
          num_envs: number of worlds.
          task: name of the task, one of `TASKS`.
          robot: "gripper" or "fetch".
          n_threads: number of threads that step the worlds.
          render_mode: None or "rgb_array".
          autoreset_mode: when a new episode follows a truncated one; an `AutoresetMode` or its value.
          max_episode_steps: actions per episode; the task's horizon if None, unlimited if -1.
          width, height: size of a rendered image, in pixels.
          camera_name: name of one of the model's cameras.

        Raises:
          ValueError: the task, robot, render mode, autoreset mode or camera is unknown, or a number is out of range.
        """
        self.metadata = METADATA | {"autoreset_mode": _autoreset_mode(autoreset_mode)}
        self._limit = _limit(max_episode_steps, task_spec(task).horizon)
        self.num_envs = num_envs
        self._open(BatchedStacking(task, num_envs, robot, n_threads), render_mode, height, width, camera_name)
        self.single_observation_space = observation_space(self._worlds)
        self.single_action_space = action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._options = read_options(self._worlds, None)

    def reset(
        self, *, seed: "int | None" = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Starts new episodes in all worlds, or in those of `options["reset_mask"]` `(N,)` bool.

        Raises:
          ValueError: an option or goal is unknown, or the mask is not valid. No world is reset then.
        """
        options = dict(options or {})
        which = self._mask(options.pop("reset_mask", True))
        arrays = read_options(self._worlds, options)
        super().reset(seed=seed)
        for name, values in arrays.items():
            self._options[name][which] = values[which]
        self._worlds.rng = self.np_random
        seen = start(self._worlds, self._options, which)
        return as_dict(seen), self._info(seen, np.zeros(self.num_envs, bool), which)

    def _mask(self, mask: object) -> np.ndarray:
        """`mask` as `(N,)` bool; True selects all worlds."""
        which = np.full(self.num_envs, True) if mask is True else np.asarray(mask)
        if which.shape != (self.num_envs,) or which.dtype != bool or not which.any():
            raise ValueError(f"reset_mask must be {self.num_envs} bools, at least one of them True, got {mask!r}")
        return which

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Carries out actions `(N, 4)`.

        Raises:
          ValueError: the actions have a wrong shape, are not finite or are out of range.
          ResetNeeded: autoreset is disabled and an episode has ended.
        """
        mode, ended = self.metadata["autoreset_mode"], self._ended
        if mode == AutoresetMode.DISABLED and ended.any():
            raise ResetNeeded(f"the episodes of worlds {np.flatnonzero(ended).tolist()} have ended: reset those")
        seen, reward = self._worlds.step(actions)
        diverged, final = self._worlds.diverged, {}
        reward[ended] = 0
        truncated = self._ended & ~ended
        over = truncated if mode == AutoresetMode.SAME_STEP else ended  # these are reset in this step
        if over.any():
            final = self._final(seen, diverged, over) if mode == AutoresetMode.SAME_STEP else {}
            seen = start(self._worlds, self._options, over)
        info = self._info(seen, diverged & ~over, np.ones(self.num_envs, bool)) | final
        return as_dict(seen), reward, np.zeros(self.num_envs, bool), truncated, info

    @property
    def _ended(self) -> np.ndarray:
        return self._worlds.step_counts >= self._limit

    def _info(self, seen: Observation, diverged: np.ndarray, which: np.ndarray) -> dict[str, np.ndarray]:
        """The info dict of the worlds `which` `(N,)` bool in Gymnasium's vector format; False for the other worlds."""
        success = self._worlds.compute_reward(seen.achieved_goal, seen.desired_goal) > 0
        info = {"is_success": success & which, "diverged": diverged & which}
        return info | {f"_{name}": which.copy() for name in info}

    def _final(self, seen: Observation, diverged: np.ndarray, ended: np.ndarray) -> dict[str, Any]:
        """The last observations and infos of the worlds `ended`; observations `(N,)` are None for the other worlds."""
        observations = np.full(self.num_envs, None, object)
        for world in np.flatnonzero(ended):
            observations[world] = {name: array[world] for name, array in as_dict(seen).items()}
        final = {"final_obs": observations, "final_info": self._info(seen, diverged, ended)}
        return final | {f"_{name}": ended.copy() for name in final}

    def render(self) -> tuple[np.ndarray, ...] | None:
        """One image `(height, width, 3)` uint8 per world; None without render mode."""
        return self._pictures()

    def close_extras(self, **kwargs: Any) -> None:
        """Frees the renderer."""
        self._close_renderer()


def _autoreset_mode(mode: "str | AutoresetMode") -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        legal = ", ".join(known.value for known in AutoresetMode)
        raise ValueError(f"unknown autoreset mode {mode!r}: the modes are {legal}") from None


def _limit(max_episode_steps: int | None, horizon: int) -> float:
    """Actions per episode; infinite for -1."""
    if max_episode_steps is None:
        return horizon
    if not isinstance(max_episode_steps, int | np.integer) or (max_episode_steps < 1 and max_episode_steps != -1):
        raise ValueError(f"max_episode_steps is at least 1, or -1 for no end, got {max_episode_steps!r}")
    return np.inf if max_episode_steps == -1 else max_episode_steps
