"""Replay of whole episodes: hindsight relabelling and goal-balanced drawing, at sample time, in numpy.

Nothing about goals or rewards is stored with a transition: goals are drawn, and rewards recomputed, for every batch.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from curiobench.episode_files import EpisodeFiles

ComputeReward = Callable[[np.ndarray, np.ndarray, object], np.ndarray]
"""(achieved goals (B, bits), desired goals (B, bits), info) -> rewards (B,)."""


@dataclass(frozen=True)
class ReplayConfig:
    """Settings of the replay. Defaults are those of DECSTR where it has them."""

    capacity: int = 20_000
    """Episodes kept; the oldest are overwritten. An episode of three blocks and 50 steps takes 12.5 kB."""
    relabel_share: float = 0.8
    """Share of samples whose desired goal becomes one achieved later in the episode (hindsight "future", k = 4)."""
    balance_goals: bool = True
    """Draw first one of the goals that episodes ended in, uniformly, then one of its episodes; else any episode."""
    satisfied_cap: float | None = None
    """Largest share of a batch whose desired goal already holds before the step; None for no limit. Balanced drawing
    and relabelling together give about 83 % of them, from which little is learned but to keep still."""

    def __post_init__(self) -> None:
        if self.capacity < 1:
            raise ValueError(f"capacity is {self.capacity}; it must be at least 1 episode")
        for name in ("relabel_share", "satisfied_cap"):
            share = getattr(self, name)
            if share is not None and not 0 <= share <= 1:
                raise ValueError(f"{name} is {share}; a share lies in [0, 1]")


@dataclass(frozen=True)
class Episodes:
    """N episodes of T steps, as collected."""

    observation: np.ndarray
    """(N, T + 1, D)."""
    achieved_goal: np.ndarray
    """(N, T + 1, bits), 0 or 1."""
    action: np.ndarray
    """(N, T, A)."""
    desired_goal: np.ndarray
    """(N, bits), 0 or 1; pursued throughout the episode."""


class GoalIndex:
    """Which slots of the ring hold an episode that ended in a given goal. Adding and removing cost O(1)."""

    def __init__(self, n_goals: int, capacity: int) -> None:
        self.counts = np.zeros(n_goals, np.int64)
        self.goal_of = np.full(capacity, -1, np.int32)  # of a slot; -1 where empty or not a valid goal
        self.position = np.full(capacity, -1, np.int32)  # of a slot in its goal's row of members
        self.members = np.full((n_goals, 16), -1, np.int32)

    def add(self, slot: int, goal: int) -> None:
        """Put an empty slot under a goal (-1: under none)."""
        self.goal_of[slot] = goal
        if goal < 0:
            return
        if self.counts[goal] == self.members.shape[1]:
            self.members = np.concatenate([self.members, np.full_like(self.members, -1)], axis=1)
        self.position[slot] = self.counts[goal]
        self.members[goal, self.position[slot]] = slot
        self.counts[goal] += 1

    def remove(self, slot: int) -> None:
        """Take a slot out; the last member of its goal takes its place."""
        goal = self.goal_of[slot]
        if goal >= 0:
            last = self.members[goal, self.counts[goal] - 1]
            self.members[goal, self.position[slot]] = last
            self.position[last] = self.position[slot]
            self.counts[goal] -= 1
        self.goal_of[slot] = self.position[slot] = -1

    def restore(self, goal_of: np.ndarray, position: np.ndarray) -> None:
        """Take over saved arrays, the order of members included: it decides what a given random number draws."""
        self.goal_of[:], self.position[:] = goal_of, position
        slots = np.flatnonzero(goal_of >= 0)
        self.counts = np.bincount(goal_of[slots], minlength=len(self.counts)).astype(np.int64)
        width = max(16, 1 << int(self.counts.max(initial=1) - 1).bit_length())
        self.members = np.full((len(self.counts), width), -1, np.int32)
        self.members[goal_of[slots], position[slots]] = slots


class EpisodeReplay:
    """A ring of episodes of equal length."""

    def __init__(
        self,
        config: ReplayConfig,
        valid_goals: np.ndarray,
        compute_reward: ComputeReward,
        steps: int,
        observation_size: int,
        action_size: int,
        folder: Path | None = None,
    ) -> None:
        """
        Args:
            config: settings.
            valid_goals: (G, bits) the goals that balanced drawing may draw, 0 or 1.
            compute_reward: rewards of achieved under desired goals.
            steps: T, the length of every episode.
            observation_size: D.
            action_size: A.
            folder: keep the arrays in memory-mapped files there instead of in memory. Scratch space: a run resumes from
                what `save` wrote.
        """
        self.config, self.compute_reward, self.steps = config, compute_reward, steps
        valid_goals = np.ascontiguousarray(valid_goals, np.uint8)
        self._goal_ids = {goal.tobytes(): k for k, goal in enumerate(valid_goals)}
        self.valid_goals = valid_goals
        bits, capacity = valid_goals.shape[1], config.capacity
        shapes = {
            "observation": ((capacity, steps + 1, observation_size), np.float32),
            "achieved_goal": ((capacity, steps + 1, bits), np.uint8),
            "action": ((capacity, steps, action_size), np.float32),
            "desired_goal": ((capacity, bits), np.uint8),
        }
        self.arrays = {name: _allocate(name, shape, dtype, folder) for name, (shape, dtype) in shapes.items()}
        self.index = GoalIndex(len(valid_goals), capacity)
        self.added = 0
        self._saved = 0

    def __len__(self) -> int:
        """Episodes held."""
        return min(self.added, self.config.capacity)

    def add(self, episodes: Episodes) -> None:
        """Store episodes, overwriting the oldest.

        Raises ValueError on a wrong shape, on more episodes than the capacity, and on values that are not finite.
        """
        n = len(episodes.observation)
        if n > self.config.capacity:
            raise ValueError(f"{n} episodes do not fit a replay of {self.config.capacity}")
        slots = (self.added + np.arange(n)) % self.config.capacity
        for name, array in self.arrays.items():
            new = np.asarray(getattr(episodes, name))
            if new.shape != (n, *array.shape[1:]):
                raise ValueError(f"{name} has shape {new.shape}; expected {(n, *array.shape[1:])}")
            if array.dtype == np.float32 and not np.isfinite(new).all():
                raise ValueError(f"{name} of episode {self.added + int(_first_bad(new))} is not finite")
        for name, array in self.arrays.items():
            array[slots] = getattr(episodes, name)
        for slot in slots:
            self.index.remove(slot)
            self.index.add(slot, self._goal_ids.get(self.arrays["achieved_goal"][slot, -1].tobytes(), -1))
        self.added += n

    def sample(self, batch_size: int, generator: np.random.Generator) -> dict[str, np.ndarray]:
        """Draw transitions. Needs at least one episode, else raises ValueError.

        Returns contiguous arrays named like the fields of `curiobench.methods.reward.Batch`: observations (B, D),
        actions (B, A) and rewards (B,) float32, goals (B, bits) uint8.
        """
        if not len(self):
            raise ValueError("the replay is empty")
        slot, step, desired = self._draw_capped(batch_size, generator)
        row = slot * (self.steps + 1) + step
        observation, achieved, action = (
            self.arrays[name].reshape(-1, self.arrays[name].shape[-1])
            for name in ("observation", "achieved_goal", "action")
        )
        next_achieved = achieved[row + 1]
        return {
            "observation": observation[row],
            "action": action[slot * self.steps + step],
            "next_observation": observation[row + 1],
            "achieved_goal": achieved[row],
            "next_achieved_goal": next_achieved,
            "desired_goal": desired,
            "reward": np.asarray(self.compute_reward(next_achieved, desired, None), np.float32),
        }

    def _draw_capped(self, size: int, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Slots (B,), steps (B,) and desired goals (B, bits), at most `satisfied_cap` of them already satisfied.

        Draws candidates until enough are accepted, at most ten times; then rejected ones fill the batch.
        """
        cap = self.config.satisfied_cap
        if cap is None:
            return self._draw(size, generator)
        quota = int(cap * size)
        pool = self._draw(2 * size, generator)
        for attempt in range(10):
            slot, step, desired = pool
            satisfied = (self.arrays["achieved_goal"][slot, step] == desired).all(1)
            accepted = ~satisfied | (np.cumsum(satisfied) <= quota)
            if accepted.sum() >= size or attempt == 9:
                break
            pool = tuple(np.concatenate(p) for p in zip(pool, self._draw(2 * size, generator), strict=True))
        chosen = np.concatenate([np.flatnonzero(accepted), np.flatnonzero(~accepted)])[:size]
        return slot[chosen], step[chosen], desired[chosen]

    def _draw(self, size: int, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Slots (size,), steps before the action (size,), desired goals (size, bits): one random draw of each."""
        uniform = generator.random((5, size))
        reached = np.flatnonzero(self.index.counts)
        if self.config.balance_goals and len(reached):
            goal = reached[_scaled(uniform[0], len(reached))]
            slot = self.index.members[goal, _scaled(uniform[1], self.index.counts[goal])].astype(np.int64)
        else:
            slot = _scaled(uniform[1], len(self))
        step = _scaled(uniform[2], self.steps)
        future = step + 1 + _scaled(uniform[3], self.steps - step)
        relabelled = self.arrays["achieved_goal"][slot, future]
        keep = uniform[4] >= self.config.relabel_share
        relabelled[keep] = self.arrays["desired_goal"][slot[keep]]
        return slot, step, relabelled

    def save(self, folder: Path) -> str:
        """Write the episodes added since the last save, then a manifest of the whole state; see `EpisodeFiles`.

        Returns:
            The manifest's name, to be kept with the agent's checkpoint and given to `load`.
        """
        arrays = {"goal_of": self.index.goal_of, "position": self.index.position}
        capacity = self.config.capacity

        def episodes(first: int, end: int) -> dict[str, np.ndarray]:
            return {name: array[np.arange(first, end) % capacity] for name, array in self.arrays.items()}

        oldest = self.added - len(self)
        name = EpisodeFiles(folder).save(self._saved, oldest, self.added, episodes, arrays, self._shapes())
        self._saved = self.added
        return name

    def load(self, folder: Path, name: str) -> None:
        """Restore the state that `save` returned `name` for, into a replay of the same capacity and sizes.

        Raises ValueError where they differ, and OSError, KeyError or ValueError where a file is missing or damaged.
        """
        files = EpisodeFiles(folder)
        manifest = files.manifest(name)
        if manifest["shapes"] != self._shapes():
            raise ValueError(f"{folder / name} holds shapes {manifest['shapes']}; this replay has {self._shapes()}")
        oldest = max(0, manifest["added"] - self.config.capacity)
        for first, end in manifest["segments"]:
            kept = np.arange(max(first, oldest), end)
            for array_name, saved in files.segment(first, end).items():
                self.arrays[array_name][kept % self.config.capacity] = saved[kept - first]
        self.index.restore(**files.arrays(manifest["index"]))
        self.added = self._saved = manifest["added"]

    def _shapes(self) -> dict[str, list[int]]:
        return {name: list(array.shape) for name, array in self.arrays.items()}


def _allocate(name: str, shape: tuple[int, ...], dtype: type, folder: Path | None) -> np.ndarray:
    if folder is None:
        return np.zeros(shape, dtype)
    folder.mkdir(parents=True, exist_ok=True)
    return np.lib.format.open_memmap(folder / f"{name}.npy", mode="w+", dtype=dtype, shape=shape)


def _scaled(uniform: np.ndarray, n: int | np.ndarray) -> np.ndarray:
    """Numbers in [0, 1) to integers in [0, n)."""
    return (uniform * n).astype(np.int64)


def _first_bad(values: np.ndarray) -> np.integer:
    return np.argmin(np.isfinite(values).reshape(len(values), -1).all(1))
