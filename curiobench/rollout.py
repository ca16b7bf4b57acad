"""The loop over the steps of an episode, in all worlds at once; for training, evaluation, videos and probes."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from curiobench.methods.agents.agent import LearningAgent
from curiobench.methods.guard import NonFiniteError
from curiobench.replay import Episodes
from curiobench.tasks.batch import BatchedStacking, Observation

Act = Callable[[Observation], np.ndarray]
"""Chooses actions `(N, A)` in [-1, 1] for N observations."""


class Rollout(NamedTuple):
    """One episode in each of N worlds."""

    episodes: Episodes
    """N episodes."""
    intact: np.ndarray
    """`(N,)` bool. False if the physics diverged, and the world was reset during the episode."""
    reward: np.ndarray
    """`(N,)` rewards of the last step."""


def play(
    worlds: BatchedStacking, observation: Observation, act: Act, watch: Callable[[], object] = lambda: None
) -> Rollout:
    """Play an episode in every world.

    Args:
        worlds: N worlds, just reset; left at the end of their episodes.
        observation: their first observation.
        act: called once a step, for all worlds together.
        watch: called in each of the `worlds.horizon` + 1 states, for example to render.

    Raises NonFiniteError, which names step, world and entry, if an observation is NaN or infinite.
    """
    states, actions, intact, reward = [], [], np.ones(worlds.n_worlds, bool), None
    for step in range(worlds.horizon + 1):
        if step > 0:
            actions.append(act(observation))
            observation, reward = worlds.step(actions[-1])
            intact &= ~worlds.diverged
        _check_finite(observation.observation, step)
        states.append(observation)
        watch()
    observations = np.stack([state.observation for state in states], axis=1)
    achieved = np.stack([state.achieved_goal for state in states], axis=1).astype(np.uint8)
    episodes = Episodes(observations, achieved, np.stack(actions, axis=1), observation.desired_goal)
    return Rollout(episodes, intact, reward)


def policy(agent: LearningAgent, deterministic: bool = False) -> Act:
    """The agent's policy, for `play`."""
    return lambda now: agent.act(now.observation, now.achieved_goal, now.desired_goal, deterministic)


def collect(
    worlds: BatchedStacking, agent: LearningAgent, goals: np.ndarray, tested: np.ndarray | None = None
) -> tuple[Episodes, np.ndarray]:
    """Collect an episode in every world with the agent's stochastic policy.

    Args:
        worlds: N worlds, just reset.
        agent: chooses actions.
        goals: `(N, bits)` the desired goal of each episode.
        tested: `(N,)` bool, episodes that use the deterministic policy.

    Returns:
        Episodes whose physics did not diverge, and a mask `(N,)` of these.

    Raises NonFiniteError as `play`.
    """
    explore, test = policy(agent), policy(agent, deterministic=True)

    def act(now: Observation) -> np.ndarray:
        action = explore(now)
        if tested is not None and tested.any():
            action[tested] = test(type(now)(*(part[tested] for part in vars(now).values())))
        return action

    episodes, intact, _ = play(worlds, worlds.pursue(goals), act)
    return Episodes(*(array[intact] for array in vars(episodes).values())), intact


def successes(episodes: Episodes) -> tuple[np.ndarray, np.ndarray]:
    """Whether each episode ends in its desired goal, and whether it starts in it: both `(N,)` bool."""
    holds = (episodes.achieved_goal[:, [0, -1]] == episodes.desired_goal[:, None]).all(axis=-1)
    return holds[:, 1], holds[:, 0]


def _check_finite(observation: np.ndarray, step: int) -> None:
    """Raises NonFiniteError where an observation `(N, D)` of a step holds NaN or infinity."""
    if not np.isfinite(observation).all():
        world, entry = np.argwhere(~np.isfinite(observation))[0]
        value = observation[world, entry]
        raise NonFiniteError(f"step {step} of an episode: entry {entry} of world {world}'s observation is {value}")
