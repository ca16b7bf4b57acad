"""Collecting episodes, in all worlds at once."""

from typing import TYPE_CHECKING

import numpy as np

from curiobench.methods.sac import SAC, NonFiniteError
from curiobench.replay import Episodes
from curiobench.tasks.registration import EPISODE_STEPS

if TYPE_CHECKING:
    from curiobench.tasks import BatchedStacking
    from curiobench.tasks.batch import Observation


def collect(
    worlds: "BatchedStacking", agent: SAC, goals: np.ndarray, tested: np.ndarray | None = None
) -> tuple[Episodes, np.ndarray]:
    """One episode in every world, by the agent's stochastic policy.

    Args:
        worlds: N worlds, just reset; left at the end of their episodes.
        agent: chooses actions; it is asked once a step, for all worlds together.
        goals: `(N, bits)` what each world's episode pursues.
        tested: `(N,)` bool, episodes in which the policy is deterministic instead.

    Returns:
        N episodes, less those whose physics diverged: their world was reset half-way, which no action explains. And
        `(N,)` bool, which ones there are.

    Raises:
        NonFiniteError: an observation is NaN or infinite; names the step, the world and the entry.
    """
    seen = worlds.pursue(goals)
    n, size, bits = *seen.observation.shape, goals.shape[1]
    observation = np.empty((n, EPISODE_STEPS + 1, size), np.float32)
    achieved = np.empty((n, EPISODE_STEPS + 1, bits), np.uint8)
    actions = []
    whole = np.ones(n, bool)
    for step in range(EPISODE_STEPS + 1):
        if step > 0:
            actions.append(_act(agent, seen, tested))
            seen, _ = worlds.step(actions[-1])
            whole &= ~worlds.diverged
        check_finite(seen.observation, step)
        observation[:, step], achieved[:, step] = seen.observation, seen.achieved_goal
    action = np.stack(actions, axis=1)
    return Episodes(observation[whole], achieved[whole], action[whole], goals[whole]), whole


def _act(agent: SAC, seen: "Observation", tested: np.ndarray | None) -> np.ndarray:
    """Actions `(N, A)`; the policy's mode where an episode is a test."""
    action = agent.act(seen.observation, seen.achieved_goal, seen.desired_goal)
    if tested is not None and tested.any():
        parts = (part[tested] for part in (seen.observation, seen.achieved_goal, seen.desired_goal))
        action[tested] = agent.act(*parts, deterministic=True)
    return action


def successes(episodes: Episodes) -> tuple[np.ndarray, np.ndarray]:
    """Whether each episode ended in its desired goal, and whether it already held at the start: both `(N,)` bool."""
    holds = (episodes.achieved_goal[:, [0, -1]] == episodes.desired_goal[:, None]).all(axis=-1)
    return holds[:, 1], holds[:, 0]


def check_finite(observation: np.ndarray, step: int) -> None:
    """Raises NonFiniteError where an observation `(N, D)` of a step holds NaN or infinity."""
    if not np.isfinite(observation).all():
        world, entry = np.argwhere(~np.isfinite(observation))[0]
        value = observation[world, entry]
        raise NonFiniteError(f"step {step} of an episode: entry {entry} of world {world}'s observation is {value}")
