"""Evaluation of an agent: every valid goal, from plain starts, with the deterministic policy.

Starts are drawn with the protocol's seed. They depend on the task and the number of episodes per goal only, so every
evaluation of every run uses the same ones. Evaluation has no effect on training.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from curiobench.methods.agents.agent import LearningAgent
from curiobench.protocol import EVALUATION_SEED, LEARNED_ABOVE
from curiobench.rollout import play, policy, successes
from curiobench.tasks import BatchedStacking
from curiobench.tasks.goals import GoalSpace
from curiobench.tasks.registration import task_spec
from curiobench.terminal import align

MAX_WORLDS = 256
"""Test episodes stepped together. Part of the protocol: it decides which start each episode gets."""

Layers = dict[int, tuple[int, int]]
"""Numbers of learned goals and of all goals, by layer."""


@dataclass(frozen=True)
class Evaluation:
    """Outcome of an evaluation: E test episodes of each of G goals."""

    goal_space: GoalSpace
    """The goals, their names and layers."""
    success: np.ndarray
    """`(G, E)` bool: the goal holds after the last step."""
    satisfied_at_start: np.ndarray
    """`(G, E)` bool: the goal holds before the first step."""

    @property
    def success_rates(self) -> np.ndarray:
        """`(G,)` share of successful episodes."""
        return self.success.mean(axis=1)

    @property
    def learned(self) -> np.ndarray:
        """`(G,)` bool."""
        return self.success_rates > LEARNED_ABOVE

    def rows(self) -> list[dict[str, Any]]:
        """Rows of evaluations.csv, one per goal; `success_unsatisfied` is None if every start satisfies the goal."""
        space, unsatisfied = self.goal_space, ~self.satisfied_at_start
        return [
            {
                "goal": space.names[g],
                "bits": space.bit_string(space.goals[g]),
                "layer": int(space.layers[g]),
                "episodes": self.success.shape[1],
                "success": float(self.success_rates[g]),
                "episodes_unsatisfied": int(unsatisfied[g].sum()),
                "success_unsatisfied": float(self.success[g][unsatisfied[g]].mean()) if unsatisfied[g].any() else None,
                "learned": int(self.learned[g]),
            }
            for g in range(len(space))
        ]


class Evaluator:
    """Worlds of one task for test episodes, separate from the training worlds."""

    def __init__(self, task: str, robot: str, episodes_per_goal: int, threads: int = 1) -> None:
        """
        Args:
            task: a task's name.
            robot: "gripper" or "fetch".
            episodes_per_goal: test episodes of every valid goal.
            threads: number of threads that step the worlds; results do not depend on it.

        Raises ValueError on an unknown task or robot, or less than one episode.
        """
        if episodes_per_goal < 1:
            raise ValueError(f"episodes per goal is {episodes_per_goal}; it must be at least 1")
        self.episodes_per_goal = episodes_per_goal
        self.goal_space = task_spec(task).goal_space
        n_episodes = len(self.goal_space) * episodes_per_goal
        self._worlds = BatchedStacking(task, min(n_episodes, MAX_WORLDS), robot, threads, seed=EVALUATION_SEED)

    def evaluate(self, agent: LearningAgent) -> Evaluation:
        """Run all test episodes with the deterministic policy. The agent does not change."""
        goals = np.repeat(self.goal_space.goals, self.episodes_per_goal, axis=0)
        size = self._worlds.n_worlds
        parts = [self._episodes(agent, goals[first : first + size], first) for first in range(0, len(goals), size)]
        success, satisfied = (np.concatenate(outcome) for outcome in zip(*parts, strict=True))
        shape = len(self.goal_space), self.episodes_per_goal
        return Evaluation(self.goal_space, success.reshape(shape), satisfied.reshape(shape))

    def _episodes(self, agent: LearningAgent, goals: np.ndarray, first: int) -> tuple[np.ndarray, np.ndarray]:
        """Success and satisfied at start, `(K,)` bool each, of K ≤ N test episodes that count from `first`.

        An episode whose physics diverged counts as failed.
        """
        worlds, n = self._worlds, len(goals)
        # one generator per batch: starts must not depend on what happened in earlier batches
        worlds.rng = np.random.default_rng([EVALUATION_SEED, first])
        spare = np.broadcast_to(goals[:1], (worlds.n_worlds - n, goals.shape[1]))
        observation = worlds.reset(biased=False, goals=np.concatenate([goals, spare]))
        played = play(worlds, observation, policy(agent, deterministic=True))
        _, satisfied = successes(played.episodes)
        return ((played.reward > 0) & played.intact)[:n], satisfied[:n]


def last_evaluation(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Rows of the last evaluation, one per goal. Raises ValueError if there is none."""
    if not rows:
        raise ValueError("there is no evaluation yet")
    return [row for row in rows if row["epoch"] == rows[-1]["epoch"]]


def learned_by_layer(evaluation: Sequence[Mapping[str, Any]]) -> Layers:
    """Numbers of learned goals and of all goals by layer, from the rows of one evaluation."""
    layers: Layers = {}
    for row in evaluation:
        learned, goals = layers.get(int(row["layer"]), (0, 0))
        layers[int(row["layer"])] = (learned + int(row["learned"]), goals + 1)
    return layers


def format_layers(layers: Layers) -> str:
    """Table of learned goals by layer and in total, as text."""
    lines = [[str(layer), *map(str, counts)] for layer, counts in layers.items()]
    totals = map(sum, zip(*layers.values(), strict=True))
    return align([["layer", "learned", "goals"], *lines, ["total", *map(str, totals)]], left=1)


def format_goals(evaluation: Sequence[Mapping[str, Any]]) -> str:
    """Table of every goal's success, over all its episodes and over those that start unsatisfied, as text."""
    lines = [
        [
            row["goal"],
            row["bits"],
            str(row["layer"]),
            format(row["success"], ".2f"),
            "" if row["success_unsatisfied"] is None else format(row["success_unsatisfied"], ".2f"),
            "yes" if row["learned"] else "no",
        ]
        for row in evaluation
    ]
    return align([["goal", "bits", "layer", "success", "unsatisfied", "learned"], *lines], left=2)
