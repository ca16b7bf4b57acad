"""Testing an agent: every valid goal, from plain starts, by the deterministic policy.

The starts come from a seed of the protocol. They depend on the task and the number of episodes a goal, not on the run,
its seed or its progress: every method is tested on the same starts, every time, and training never notices.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from curiobench.display import align
from curiobench.methods.agents.agent import LearningAgent
from curiobench.protocol import EVALUATION_SEED, LEARNED_ABOVE
from curiobench.rollout import play, policy, successes
from curiobench.tasks import BatchedStacking
from curiobench.tasks.goals import GoalSpace
from curiobench.tasks.registration import task_spec

MAX_WORLDS = 256
"""Test episodes stepped together; part of the protocol, as it decides which start each of them gets."""

Layers = dict[int, tuple[int, int]]
"""Learned goals and all goals, by layer."""


@dataclass(frozen=True)
class Evaluation:
    """Outcome of all test episodes of an evaluation: G goals, E episodes each."""

    goal_space: GoalSpace
    """The goals, their names and layers."""
    success: np.ndarray
    """`(G, E)` bool: the goal holds after the last step."""
    satisfied_at_start: np.ndarray
    """`(G, E)` bool: it held before the first one."""

    @property
    def success_rates(self) -> np.ndarray:
        """`(G,)` share of successful episodes."""
        return self.success.mean(axis=1)

    @property
    def learned(self) -> np.ndarray:
        """`(G,)` bool."""
        return self.success_rates > LEARNED_ABOVE

    def learned_by_layer(self) -> Layers:
        """Learned goals and all goals of each layer."""
        return learned_by_layer(self.rows())

    def rows(self) -> list[dict[str, Any]]:
        """One row a goal, as evaluations.csv has them; `success_unsatisfied` is None where every start satisfied it."""
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
    """Test worlds of one task, apart from those of training."""

    def __init__(self, task: str, robot: str, episodes_per_goal: int, threads: int = 1) -> None:
        """
        Args:
            task: a task's name.
            robot: "gripper" or "fetch".
            episodes_per_goal: test episodes of every valid goal.
            threads: that step the worlds; results do not depend on it.

        Raises ValueError on an unknown task or robot, or less than one episode.
        """
        if episodes_per_goal < 1:
            raise ValueError(f"episodes per goal is {episodes_per_goal}; it must be at least 1")
        self.episodes_per_goal = episodes_per_goal
        self.goal_space = task_spec(task).goal_space
        n_episodes = len(self.goal_space) * episodes_per_goal
        self._worlds = BatchedStacking(task, min(n_episodes, MAX_WORLDS), robot, threads, seed=EVALUATION_SEED)

    def evaluate(self, agent: LearningAgent) -> Evaluation:
        """Run all test episodes. Changes nothing in the agent, whose deterministic policy draws no random numbers."""
        goals = np.repeat(self.goal_space.goals, self.episodes_per_goal, axis=0)
        size = self._worlds.n_worlds
        parts = [self._episodes(agent, goals[first : first + size], first) for first in range(0, len(goals), size)]
        success, satisfied = (np.concatenate(outcome) for outcome in zip(*parts, strict=True))
        shape = len(self.goal_space), self.episodes_per_goal
        return Evaluation(self.goal_space, success.reshape(shape), satisfied.reshape(shape))

    def _episodes(self, agent: LearningAgent, goals: np.ndarray, first: int) -> tuple[np.ndarray, np.ndarray]:
        """Success and satisfied at start, `(K,)` bool each, of K ≤ N test episodes, the first of which has this number.

        An episode whose physics diverged has failed.
        """
        worlds, n = self._worlds, len(goals)
        # a generator a batch: what happens in one batch must not move the starts of the next
        worlds.rng = np.random.default_rng([EVALUATION_SEED, first])
        spare = np.broadcast_to(goals[:1], (worlds.n_worlds - n, goals.shape[1]))
        seen = worlds.reset(biased=False, goals=np.concatenate([goals, spare]))
        played = play(worlds, seen, policy(agent, deterministic=True))
        _, satisfied = successes(played.episodes)
        return ((played.reward > 0) & played.intact)[:n], satisfied[:n]


def last_evaluation(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The rows of the last evaluation, one a goal; raises ValueError where there is none."""
    if not rows:
        raise ValueError("there is no evaluation yet")
    return [row for row in rows if row["epoch"] == rows[-1]["epoch"]]


def learned_by_layer(evaluation: Sequence[Mapping[str, Any]]) -> Layers:
    """Learned goals and all goals of each layer, from one evaluation's rows."""
    layers: Layers = {}
    for row in evaluation:
        learned, goals = layers.get(int(row["layer"]), (0, 0))
        layers[int(row["layer"])] = (learned + int(row["learned"]), goals + 1)
    return layers


def format_layers(layers: Layers) -> str:
    """Learned goals of each layer and in total."""
    lines = [[str(layer), *map(str, counts)] for layer, counts in layers.items()]
    return align([["layer", "learned", "goals"], *lines, ["total", *map(str, _total(layers))]], left=1)


def format_goals(evaluation: Sequence[Mapping[str, Any]]) -> str:
    """Success of every goal, and of those of its episodes that did not start with the goal satisfied."""
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


def _total(layers: Layers) -> tuple[int, int]:
    learned, goals = zip(*layers.values(), strict=True)
    return sum(learned), sum(goals)
