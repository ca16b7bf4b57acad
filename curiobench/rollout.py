"""Episodes in all worlds at once. Training, evaluation, videos and probes share this loop."""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from curiobench.methods.agents.agent import LearningAgent
from curiobench.methods.guard import NonFiniteError
from curiobench.replay import Episodes

if TYPE_CHECKING:
    from curiobench.tasks import BatchedStacking
    from curiobench.tasks.batch import Observation

Act = Callable[["Observation"], np.ndarray]
"""Chooses actions `(N, A)` in [-1, 1] for N observations."""


class Rollout(NamedTuple):
    """One episode in each of N worlds."""

    episodes: Episodes
    """N episodes."""
    intact: np.ndarray
    """`(N,)` bool. False where the physics diverged: that world was reset in mid-episode, which no action explains."""
    reward: np.ndarray
    """`(N,)` rewards of the last step."""


def play(
    worlds: "BatchedStacking", seen: "Observation", act: Act, watch: Callable[[], object] = lambda: None
) -> Rollout:
    """Play an episode in every world.

    Args:
        worlds: N worlds, just reset; left at the end of their episodes.
        seen: their first observation.
        act: called once a step, for all worlds together.
        watch: called in each of the `worlds.horizon` + 1 states, for pictures and positions.

    Raises NonFiniteError where an observation is NaN or infinite; names the step, the world and the entry.
    """
    states, actions, intact, reward = [], [], np.ones(worlds.n_worlds, bool), None
    for step in range(worlds.horizon + 1):
        if step > 0:
            actions.append(act(seen))
            seen, reward = worlds.step(actions[-1])
            intact &= ~worlds.diverged
        _check_finite(seen.observation, step)
        states.append(seen)
        watch()
    observation = np.stack([state.observation for state in states], axis=1)
    achieved = np.stack([state.achieved_goal for state in states], axis=1).astype(np.uint8)
    return Rollout(Episodes(observation, achieved, np.stack(actions, axis=1), seen.desired_goal), intact, reward)


def policy(agent: LearningAgent, deterministic: bool = False) -> Act:
    """The agent's policy, for `play`."""
    return lambda seen: agent.act(seen.observation, seen.achieved_goal, seen.desired_goal, deterministic)


def collect(
    worlds: "BatchedStacking", agent: LearningAgent, goals: np.ndarray, tested: np.ndarray | None = None
) -> tuple[Episodes, np.ndarray]:
    """One episode in every world, by the agent's stochastic policy.

    Args:
        worlds: N worlds, just reset.
        agent: chooses actions.
        goals: `(N, bits)` what each world's episode pursues.
        tested: `(N,)` bool, episodes in which the policy is deterministic instead.

    Returns:
        The episodes, less those whose physics diverged, and `(N,)` bool, which ones they are.

    Raises NonFiniteError as `play`.
    """
    explore, test = policy(agent), policy(agent, deterministic=True)

    def act(seen: "Observation") -> np.ndarray:
        action = explore(seen)
        if tested is not None and tested.any():
            action[tested] = test(type(seen)(*(part[tested] for part in vars(seen).values())))
        return action

    episodes, intact, _ = play(worlds, worlds.pursue(goals), act)
    return Episodes(*(array[intact] for array in vars(episodes).values())), intact


def successes(episodes: Episodes) -> tuple[np.ndarray, np.ndarray]:
    """Whether each episode ended in its desired goal, and whether it already held at the start: both `(N,)` bool."""
    holds = (episodes.achieved_goal[:, [0, -1]] == episodes.desired_goal[:, None]).all(axis=-1)
    return holds[:, 1], holds[:, 0]


def _check_finite(observation: np.ndarray, step: int) -> None:
    """Raises NonFiniteError where an observation `(N, D)` of a step holds NaN or infinity."""
    if not np.isfinite(observation).all():
        world, entry = np.argwhere(~np.isfinite(observation))[0]
        value = observation[world, entry]
        raise NonFiniteError(f"step {step} of an episode: entry {entry} of world {world}'s observation is {value}")
