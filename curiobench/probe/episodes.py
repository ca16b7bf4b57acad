"""The scripted episodes of a probe, and the reference transitions among which each of their steps is scored."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from curiobench.methods.reward import Batch
from curiobench.probe.steps import Track, push_moments, stack_moments
from curiobench.replay import Episodes
from curiobench.rollout import Act, play
from curiobench.tasks.batch import BatchedStacking, Observation
from curiobench.tasks.scripts import Script, push_off_table, stack_two
from curiobench.tasks.spec import ACTION_SIZE

REFERENCE_WORLDS = 32
"""Worlds for each half of the reference play: 3200 transitions in all, of which the set is taken."""


@dataclass(frozen=True)
class ScriptedEpisode:
    """A kind of scripted episode, about block a."""

    name: str
    """In file names and columns."""
    title: str
    """In figures."""
    script: Callable[[], Script]
    """Makes the controller."""
    moments: Callable[[Track], dict[str, int]]
    """Finds the key moments of one episode."""
    goal: str
    """That the script pursues."""


SCRIPTED_EPISODES = (
    ScriptedEpisode("stack", "pick and stack", stack_two, stack_moments, "a on b"),
    ScriptedEpisode("push", "push off the table", push_off_table, push_moments, "all apart"),
)


@dataclass(frozen=True)
class Played:
    """Scripted episodes of one kind, in N worlds."""

    kind: ScriptedEpisode
    """Of the episodes."""
    episodes: Episodes
    """N of them; T steps each."""
    qpos: np.ndarray
    """(N, T + 1, nq), for pictures…"""
    model: mujoco.MjModel
    """…of this model."""

    @property
    def track(self) -> Track:
        """(N, T + 1), of block a."""
        return Track.of(self.episodes.observation)

    @property
    def pictured(self) -> int:
        """The episode to show: the first with the most key moments, so that a slipped grip is not the example."""
        track = self.track
        return int(np.argmax([len(self.kind.moments(track[n])) for n in range(len(self.qpos))]))


def play_scripts(task: str, robot: str, starts: int, seed: int) -> list[Played]:
    """Episodes of each kind, from the same plain starts in both.

    Raises ValueError where there is no start, or where physics diverged.
    """
    if starts < 1:
        raise ValueError(f"starts is {starts}; it must be at least 1")
    source = np.random.SeedSequence(seed, spawn_key=(0,))
    return [_play_script(kind, BatchedStacking(task, starts, robot, seed=source)) for kind in SCRIPTED_EPISODES]


def reference_transitions(task: str, robot: str, seed: int) -> Batch:
    """The transitions among which every probed one is scored, shuffled; the same for every method.

    Actions are uniformly random, half of them from plain starts and half from biased ones, as in training. There are no
    scripted episodes: the numbers of their lifts and falls would decide which of the two has near neighbours. Raises
    ValueError if physics diverged.
    """
    sources = np.random.SeedSequence(seed, spawn_key=(1,)).spawn(3)
    rng = np.random.default_rng(sources.pop())
    parts = []
    for source, biased in zip(sources, (False, True), strict=True):
        worlds = BatchedStacking(task, REFERENCE_WORLDS, robot, seed=source)
        first = worlds.reset(biased=biased)
        parts.append(transitions(_play(worlds, first, lambda _: rng.uniform(-1, 1, (REFERENCE_WORLDS, ACTION_SIZE)))))
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = rng.permutation(len(arrays["reward"]))
    return Batch.from_numpy({name: array[order] for name, array in arrays.items()})


def transitions(episodes: Episodes) -> dict[str, np.ndarray]:
    """All N · T transitions by the names of `Batch`, raw, episode by episode."""
    n, steps = episodes.action.shape[:2]
    desired = np.repeat(episodes.desired_goal, steps, axis=0).astype(np.float32)
    before, after = (
        [a[:, part].reshape(len(desired), -1) for a in (episodes.observation, episodes.achieved_goal)]
        for part in (slice(None, -1), slice(1, None))
    )
    return {
        "observation": before[0],
        "action": episodes.action.reshape(len(desired), -1),
        "next_observation": after[0],
        "achieved_goal": before[1],
        "next_achieved_goal": after[1],
        "desired_goal": desired,
        "reward": BatchedStacking.compute_reward(after[1], desired),
        "step": np.tile(np.arange(steps), n),
        "episode": np.repeat(np.arange(n), steps),
        "episode_observation": np.repeat(episodes.observation, steps, axis=0),
        "episode_achieved_goal": np.repeat(episodes.achieved_goal, steps, axis=0),
    }


def _play_script(kind: ScriptedEpisode, worlds: BatchedStacking) -> Played:
    script, qpos = kind.script(), []
    first = worlds.reset(goals=worlds.goal_space.parse(kind.goal))
    episodes = _play(worlds, first, lambda now: script.act(now.observation), lambda: qpos.append(worlds.qpos.copy()))
    return Played(kind, episodes, np.stack(qpos, axis=1), worlds.model)


def _play(
    worlds: BatchedStacking, first: Observation, act: Act, watch: Callable[[], object] = lambda: None
) -> Episodes:
    """`play`, which raises ValueError where physics diverged."""
    episodes, intact, _ = play(worlds, first, lambda now: act(now).astype(np.float32), watch)
    if not intact.all():
        raise ValueError("the physics of a probed episode diverged; choose another seed")
    return episodes
