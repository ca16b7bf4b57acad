"""Code shared by the single and the vector environment: spaces, reset options, goals, states and rendering."""

import json
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np

from curiobench.tasks.batch import BatchedStacking, Observation
from curiobench.tasks.goals import GoalSpace
from curiobench.tasks.rendering import WorldRenderer, check_picture
from curiobench.tasks.spec import ACTION_SIZE

METADATA: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 25}


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
    return gym.spaces.Box(-1, 1, (ACTION_SIZE,), np.float32)


def as_dict(seen: Observation) -> dict[str, np.ndarray]:
    """The observation of N worlds as a Gymnasium dict."""
    return dict(vars(seen))


def read_options(worlds: BatchedStacking, options: Mapping[str, Any] | None) -> dict[str, np.ndarray]:
    """Turns `options={"goal": …, "biased": …}` into arrays with one entry per world.

    Args:
      worlds: the N worlds that the options apply to.
      options: "goal" is one goal that `GoalSpace.parse` accepts, or a list of N names or bit vectors. A goal of None
        is drawn at random. "biased" is a bool or N bools.

    Returns:
      "next_goal" `(N, n_bits)` float32, "next_goal_given" `(N,)` bool and "next_biased" `(N,)` bool.

    Raises:
      ValueError: an option or goal is unknown, or the length of a list is not N.
    """
    options = options or {}
    if not isinstance(options, Mapping):
        raise ValueError(f"reset options are a dict of goal and biased, got {options!r:.80}")
    if unknown := set(options) - {"goal", "biased"}:
        raise ValueError(f"unknown reset option {min(unknown, key=str)!r}: the options are goal, biased")
    n, space = worlds.n_worlds, worlds.goal_space
    goals: Any = options.get("goal")
    if not _is_list_of_goals(goals):
        goals = [goals]
    elif len(goals) != n:
        raise ValueError(f"{n} worlds need one goal or {n}, got {len(goals)}")
    biased = np.asarray(options.get("biased", False))
    if biased.shape not in ((), (n,)) or not np.isin(biased, (False, True)).all():
        several = f" or a list of {n} bools" if n > 1 else ""
        raise ValueError(f"biased must be a bool{several}, got {options['biased']!r}")
    bits = np.array([space.goals[0] if goal is None else space.parse(goal) for goal in goals])
    return {
        "next_goal": np.broadcast_to(bits, (n, space.n_bits)).copy(),
        "next_goal_given": np.broadcast_to([goal is not None for goal in goals], n).copy(),
        "next_biased": np.broadcast_to(biased.astype(bool), n).copy(),
    }


def _is_list_of_goals(goal: Any) -> bool:
    """Whether `goal` is a list of goals rather than the bits of one goal."""
    listed = isinstance(goal, list | tuple) or (isinstance(goal, np.ndarray) and goal.ndim > 0)
    return listed and any(isinstance(entry, str) or not np.isscalar(entry) for entry in goal)


def start(worlds: BatchedStacking, options: dict[str, np.ndarray], which: np.ndarray) -> Observation:
    """Starts episodes in the worlds `which` `(N,)` bool, with the options of `read_options`."""
    goals, free = options["next_goal"][which], ~options["next_goal_given"][which]
    drawn = worlds.rng.integers(len(worlds.goal_space), size=free.sum())
    goals[free] = worlds.goal_space.goals[drawn]
    return worlds.reset(which, options["next_biased"][which], goals)


class GoalWorlds:
    """Goals, states, copies and rendering: the part of both environments that is the same for any number of worlds."""

    np_random: np.random.Generator
    """Gymnasium's random generator."""

    def _open(self, worlds: BatchedStacking, render_mode: str | None, height: int, width: int, camera: str) -> None:
        if render_mode not in (None, *METADATA["render_modes"]):
            raise ValueError(
                f"unknown render mode {render_mode!r}: it is None or 'rgb_array'; gymnasium.make adds "
                "'rgb_array_list' and, with pygame and a screen, 'human'"
            )
        check_picture(worlds.model, height, width, camera)
        self._worlds = worlds
        self._worlds.rng = self.np_random
        self.render_mode = render_mode
        self._picture = (height, width, camera)
        self._options: dict[str, np.ndarray] = {}
        self._renderer: WorldRenderer | None = None
        self._data: mujoco.MjData | None = None

    @property
    def goal_space(self) -> GoalSpace:
        """The task's predicates and valid goals."""
        return self._worlds.goal_space

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model that all worlds share."""
        return self._worlds.model

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: object) -> np.ndarray:
        """Reward for goals `(n_bits,)`, or rewards `(...)` for goals `(..., n_bits)`."""
        return self._worlds.compute_reward(achieved_goal, desired_goal, info)

    def compute_terminated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: object) -> np.ndarray:
        """False for goals `(n_bits,)`, or `(...)` False for goals `(..., n_bits)`: no goal ends an episode."""
        return np.zeros(np.broadcast_shapes(np.shape(achieved_goal), np.shape(desired_goal))[:-1], bool)[()]

    def compute_truncated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: object) -> np.ndarray:
        """False, as in `compute_terminated`: the time limit does not depend on goals."""
        return self.compute_terminated(achieved_goal, desired_goal, info)

    def get_state(self) -> dict[str, np.ndarray]:
        """Everything that later steps and episodes depend on, for `set_state` or `np.savez`.

        Arrays of worlds have N entries, also when N is 1. "state" `(N, 1 + nq + nv)` float64 holds MuJoCo's time,
        positions and velocities. "rng" is text.
        """
        kept = self._worlds.state_dict()
        kept["rng"] = json.dumps(kept["rng"], default=np.ndarray.tolist)
        return {name: np.array(value) for name, value in {**kept, **self._options}.items()}

    def set_state(self, state: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Restores what `get_state` returned, in this or an equal environment, and returns the observation.

        Raises:
          ValueError: another kind of environment made the state, or it is not valid. The environment is then unchanged.
        """
        before = self.get_state()
        shapes = {name: array.shape for name, array in before.items()}
        given = {name: np.shape(state[name]) for name in state}
        if given != shapes:
            raise ValueError(f"a state of this environment has the shapes {shapes}, got {given}")
        if not np.isfinite(state["state"]).all():
            raise ValueError("the state holds a number that is not finite")
        try:
            self._restore(state)
        except Exception as error:
            self._restore(before)
            raise ValueError(f"not a state of this environment: {error}") from None
        return self._show(self._worlds.observe())

    def _restore(self, state: Mapping[str, np.ndarray]) -> None:
        self._worlds.rng = self.np_random
        self._worlds.load_state_dict({**state, "rng": json.loads(str(state["rng"]))})
        self._worlds.pursue(state["desired_goal"])  # raises unless the goals are valid
        self._options = {name: np.array(state[name]) for name in self._options}

    def _show(self, seen: Observation) -> dict[str, np.ndarray]:
        return as_dict(seen)

    def __getstate__(self) -> dict[str, Any]:
        """For pickle and deepcopy: without the renderer and `data`, which a copy creates when it needs them."""
        return vars(self) | {"_renderer": None, "_data": None}

    def _pictures(self) -> tuple[np.ndarray, ...] | None:
        if self.render_mode is None:
            return None
        self._renderer = self._renderer or WorldRenderer(self.model, *self._picture)
        return tuple(self._renderer.render(qpos) for qpos in self._worlds.qpos)

    def _close_renderer(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
