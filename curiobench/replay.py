"""Replay buffer of episodes, in numpy.

Rewards are not stored: for every batch, goals are drawn (`relabelling.py`) and rewards recomputed.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from curiobench import tasks
from curiobench.files import read_json, replace_file, write_json
from curiobench.methods.checks import check_option, check_positive, check_share
from curiobench.methods.relabelling import Relabelling
from curiobench.queues import Queues
from curiobench.relabelling import N_ARRIVAL_KINDS, RELABELLINGS, RelabellingName, arrival_kinds, scaled, weighted
from curiobench.replay_files import prune, read_segment
from curiobench.tasks.goals import GoalTable


@dataclass(frozen=True)
class ReplayConfig:
    """Settings of the replay. Where DECSTR has the same setting, the default is its value."""

    capacity: int = 20_000
    """Episodes kept; the oldest are overwritten. An episode of three blocks and 50 steps takes 12.5 kB."""
    relabel_share: float = 0.8
    """Share of samples whose desired goal becomes one achieved later in the episode (hindsight "future", k = 4)."""
    balance_goals: bool = True
    """Draw an episode by first drawing a goal that episodes ended in, uniformly; otherwise draw episodes uniformly."""
    relabelling: RelabellingName = "future"
    """Which transitions with which goals fill a batch: hindsight "future" (future), or half of it steps that lead to a
    moment at which a goal was reached (arrivals). A method such as mcher has its own."""
    arrival_share: float = 0.5
    """Share of a batch that is drawn from arrivals, with that relabelling."""
    pursued_share: float = 0.0
    """Share of a batch, with that relabelling, that is drawn from any episode under the goal that it pursued."""
    satisfied_cap: float | None = None
    """Largest share of a batch whose desired goal already holds before the step; None for no limit. Without a limit it
    is about 83 %, and these transitions teach little more than to keep still."""

    def __post_init__(self) -> None:
        check_positive(self, "capacity")
        check_option(self, "relabelling", RelabellingName)
        check_share(self, "relabel_share", "arrival_share", "pursued_share")
        if self.satisfied_cap is not None:
            check_share(self, "satisfied_cap")
        if self.arrival_share + self.pursued_share > 1:
            both = f"{self.arrival_share} and {self.pursued_share}"
            raise ValueError(f"arrival_share and pursued_share are {both}; together they are at most 1")


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


class EpisodeReplay:
    """A ring buffer of episodes of equal length.

    Attributes:
        arrays: observation, achieved_goal, action and desired_goal of every slot, as in `Episodes`.
        goal_ids: `(capacity, T + 1)` index of the achieved goal among the valid goals, -1 if it is not valid.
        ends: slots by the valid goal that their episode ended in.
        arrivals: positions slot · (T + 1) + step, by goal · N_ARRIVAL_KINDS + kind; see `relabelling.py`.
        goal_weights: `(G,)` probabilities of goals, set by a curriculum that weights the replay; otherwise None.
    """

    def __init__(
        self,
        config: ReplayConfig,
        valid_goals: np.ndarray,
        steps: int,
        observation_size: int,
        action_size: int,
        on_bits: np.ndarray,
        folder: Path | None = None,
        relabelling: Relabelling | None = None,
    ) -> None:
        """
        Args:
            config: settings.
            valid_goals: (G, bits) goals that may be drawn, 0 or 1.
            steps: T, the length of every episode.
            observation_size: D.
            action_size: A.
            on_bits: (bits,) bool, which bits of a goal say that a block lies on another.
            folder: keep the arrays in memory-mapped files in this folder. They are scratch space: a run resumes from
                the files of `save`.
            relabelling: of a method that has its own; None for that of the config.
        """
        self.config, self.steps = config, steps
        self._relabelling, self.goal_weights = relabelling, None
        self.valid_goals = valid_goals = np.ascontiguousarray(valid_goals, np.uint8)
        self._table, self._on_bits = GoalTable(valid_goals), on_bits
        bits, capacity = valid_goals.shape[1], config.capacity
        shapes = {
            "observation": ((capacity, steps + 1, observation_size), np.float32),
            "achieved_goal": ((capacity, steps + 1, bits), np.uint8),
            "action": ((capacity, steps, action_size), np.float32),
            "desired_goal": ((capacity, bits), np.uint8),
        }
        self.arrays = {name: _allocate(name, shape, dtype, folder) for name, (shape, dtype) in shapes.items()}
        self.goal_ids = np.full((capacity, steps + 1), -1, np.int32)
        self._clear_index()
        self.added = self._saved = 0

    def __len__(self) -> int:
        """Number of episodes in the replay."""
        return min(self.added, self.config.capacity)

    def add(self, episodes: Episodes) -> None:
        """Store episodes, at most as many as the capacity, overwriting the oldest."""
        n = len(episodes.observation)
        slots = (self.added + np.arange(n)) % self.config.capacity
        overwritten = slots[self.added + np.arange(n) >= self.config.capacity]
        self.ends.drop(self._ends_of(overwritten)[0])
        self.arrivals.drop(self._arrivals_of(overwritten)[0])
        for name, array in self.arrays.items():
            array[slots] = getattr(episodes, name)
        self._index(slots)
        self.added += n

    def _clear_index(self) -> None:
        n_goals = len(self.valid_goals)
        self.ends, self.arrivals = Queues(n_goals), Queues(N_ARRIVAL_KINDS * n_goals)

    def _index(self, slots: np.ndarray) -> None:
        """Add the episodes in slots (K,), oldest first, to the index."""
        self.goal_ids[slots] = self._table.indices(self.arrays["achieved_goal"][slots])
        self.ends.push(*self._ends_of(slots))
        self.arrivals.push(*self._arrivals_of(slots))

    def _ends_of(self, slots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Valid goals that episodes in slots (K,) ended in, and these episodes' slots."""
        goals = self.goal_ids[slots, -1]
        return goals[goals >= 0], slots[goals >= 0]

    def _arrivals_of(self, slots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Groups and positions of all arrivals in the episodes in slots (K,)."""
        goals, achieved = self.goal_ids[slots], self.arrays["achieved_goal"]
        k, step = np.nonzero((goals[:, 1:] >= 0) & (goals[:, 1:] != goals[:, :-1]))
        slot, step = slots[k], step + 1
        kinds = arrival_kinds(achieved[slot, step - 1], achieved[slot, step], self._on_bits)
        return N_ARRIVAL_KINDS * self.goal_ids[slot, step] + kinds, slot * (self.steps + 1) + step

    def sample(
        self, batch_size: int, generator: np.random.Generator, n_particles: int = 0, episodes: bool = False
    ) -> dict[str, np.ndarray | None]:
        """Draw transitions and, on request, particles and the transitions' episodes. Raises ValueError if empty.

        Returns contiguous arrays named like the fields of `curiobench.methods.reward.Batch`: observations (B, D),
        actions (B, A) and rewards (B,) float32, goals (B, bits) uint8, step and episode (B,) int64; particles (P, D),
        episodes' observations (B, T + 1, D) float32 and goals (B, T + 1, bits) uint8, or None.
        """
        if not len(self):
            raise ValueError("the replay is empty")
        if self._relabelling is None:
            slot, step, desired = RELABELLINGS[self.config.relabelling](self, batch_size, generator)
        else:
            # imports torch, which `train --help` does not need
            from curiobench.methods.goal_guard import transitions_drawn

            slot, step, desired = transitions_drawn(self._relabelling, self, batch_size, generator)
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
            "reward": tasks.BatchedStacking.compute_reward(next_achieved, desired),
            "step": step,
            "episode": self.added - 1 - (self.added - 1 - slot) % self.config.capacity,
            "particles": self._draw_states(n_particles, generator) if n_particles else None,
            "episode_observation": self.arrays["observation"][slot] if episodes else None,
            "episode_achieved_goal": self.arrays["achieved_goal"][slot] if episodes else None,
        }

    def draw_episodes(self, uniform: np.ndarray) -> np.ndarray:
        """Slots (B,) from numbers (2, B) in [0, 1): first a goal, then an episode that ended in it.

        With `goal_weights`, goals are drawn by them, and a goal that no episode ended in gives a uniform episode.
        Without weights, goals are uniform over those that episodes ended in. If the config does not balance goals, or
        there is no such goal, episodes are uniform.
        """
        counts = self.ends.counts
        if self.goal_weights is not None:
            goals = weighted(uniform[0], self.goal_weights)
        elif self.config.balance_goals and counts.any():
            reached = np.flatnonzero(counts)
            goals = reached[scaled(uniform[0], len(reached))]
        else:
            return scaled(uniform[1], len(self))
        slots, ended = scaled(uniform[1], len(self)), counts[goals] > 0
        slots[ended] = self.ends.draw(goals[ended], uniform[1, ended])
        return slots

    def _draw_states(self, size: int, generator: np.random.Generator) -> np.ndarray:
        """`size` observations (size, D), uniform over all episodes and all steps but the start."""
        slot, step = generator.integers(len(self), size=size), generator.integers(1, self.steps + 1, size=size)
        return self.arrays["observation"][slot, step]

    def save(self, folder: Path) -> str:
        """Write the episodes added since the last save, then a manifest of the state; nothing if there are none.

        Returns:
            The manifest's name, to be kept with the agent's checkpoint and given to `load`.
        """
        folder.mkdir(parents=True, exist_ok=True)
        previous, name = f"replay-{self._saved}.json", f"replay-{self.added}.json"
        if previous == name and (folder / name).exists():
            return name  # so that the save before this one stays
        oldest = self.added - len(self)
        segments = read_json(folder / previous)["segments"] if self._saved else []
        segments = [segment for segment in segments if segment[1] > oldest]
        first = max(self._saved, oldest)
        if first < self.added:
            slots = np.arange(first, self.added) % self.config.capacity
            new = {array_name: array[slots] for array_name, array in self.arrays.items()}
            replace_file(folder / f"episodes-{first}-{self.added}.npz", lambda file: np.savez(file, **new))
            segments.append([first, self.added])
        write_json(folder / name, {"added": self.added, "segments": segments, "shapes": self._shapes()})
        prune(folder, {name, previous})
        self._saved = self.added
        return name

    def load(self, folder: Path, name: str) -> None:
        """Restore the state that `save` returned `name` for, into a replay of the same capacity and sizes.

        Raises ValueError where they differ, and OSError, KeyError or ValueError where a file is missing or damaged.
        """
        manifest = read_json(folder / name)
        if manifest["shapes"] != self._shapes():
            raise ValueError(f"{folder / name} holds shapes {manifest['shapes']}; this replay has {self._shapes()}")
        oldest = max(0, manifest["added"] - self.config.capacity)
        for first, end in manifest["segments"]:
            kept = np.arange(max(first, oldest), end)
            for array_name, saved in read_segment(folder, first, end).items():
                self.arrays[array_name][kept % self.config.capacity] = saved[kept - first]
        self.added = self._saved = manifest["added"]
        self._clear_index()
        self._index(np.arange(oldest, self.added) % self.config.capacity)

    def _shapes(self) -> dict[str, list[int]]:
        return {name: list(array.shape) for name, array in self.arrays.items()}


def _allocate(name: str, shape: tuple[int, ...], dtype: type, folder: Path | None) -> np.ndarray:
    if folder is None:
        return np.zeros(shape, dtype)
    folder.mkdir(parents=True, exist_ok=True)
    return np.lib.format.open_memmap(folder / f"{name}.npy", mode="w+", dtype=dtype, shape=shape)
