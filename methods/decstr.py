"""DECSTR's curriculum (Akakzia et al. 2021, arXiv 2006.07185): practise where learning progresses.

Goals are sorted into buckets. Some episodes are tests: their goal is from a uniformly drawn bucket, and the agent does
not explore. From the last w tests of bucket b:

    C_b  = success rate of the newer half                              competence
    LP_b = |success rate of the newer half - that of the older half|   learning progress
    p_b  = (1 - C_b) · LP_b / sum over buckets                         uniform where all of these are 0

For each other episode, a bucket is drawn with probabilities p, then a goal of that bucket uniformly. The replay draws a
goal in the same way, then an episode that ended in that goal, or any episode if none did. p changes at the end of an
epoch.

Differences from the authors' code (akakzia/decstr, goal_sampler.py):

- Their C_b is the success rate of the older half. This looks like a bug: their list runs from the newest test to the
  oldest, and the paper uses recent success.
- They keep 1,800 tests per bucket, and use them only when there are more than 100. Their runs make some 50,000 tests
  per bucket, ours with `laptop` 700. The defaults here are 200 and 40.
- Each episode is drawn separately as a test or not. In their code one draw decides for all episodes of a worker.
- Their networks are not part of this method. It uses the agent that all methods share.
- Their buckets are listed by hand for three blocks. `buckets` computes them by a rule for any number of blocks.
"""

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from curiobench.methods.checks import check_positive, check_share
from curiobench.methods.curriculum import Curriculum, Goals, Situation

FEW_CLOSE = 1
"""Largest number of close pairs in a goal of the first bucket."""


@dataclass(frozen=True)
class DECSTRConfig:
    """Settings of the curriculum."""

    test_share: float = 0.1
    """Share of episodes that are tests, in [0, 1]; the authors'."""
    window: int = 200
    """Tests per bucket, w, over which competence and progress are measured."""
    least: int = 40
    """Smallest number of tests of a bucket from which they are measured."""

    def __post_init__(self) -> None:
        check_positive(self, "window", "least")
        check_share(self, "test_share")


def buckets(goals: Goals) -> np.ndarray:
    """`(G,)` bucket of each goal, from 0 without gaps. On three blocks these are the authors' five.

    Flat with at most one pair close; flat with more; two layers, not all close; two layers, all close; then a bucket
    for each greater height.
    """
    close = goals.close
    few, every = close.sum(1) <= FEW_CLOSE, close.all(1)
    of_height = [np.where(few, 0, 1), np.where(every, 3, 2)]
    kind = np.where(goals.layers == 1, of_height[0], np.where(goals.layers == 2, of_height[1], goals.layers + 1))
    return np.unique(kind, return_inverse=True)[1]


class DECSTR(Curriculum):
    """Buckets of goals, drawn by learning progress."""

    Config = DECSTRConfig

    def __init__(self, goals: Goals, config: DECSTRConfig) -> None:
        super().__init__(goals, config)
        self.buckets = buckets(goals)
        self.n_buckets = int(self.buckets.max()) + 1
        self.tests: list[deque[int]] = [deque(maxlen=config.window) for _ in range(self.n_buckets)]
        self.competence, self.progress = np.zeros(self.n_buckets), np.zeros(self.n_buckets)

    @property
    def probabilities(self) -> np.ndarray:
        """p `(buckets,)`."""
        weights = (1 - self.competence) * self.progress
        return weights / weights.sum() if weights.any() else np.full(self.n_buckets, 1 / self.n_buckets)

    def draw(self, situation: Situation, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """As `Curriculum.draw`."""
        n = len(situation.start)
        tested = generator.random(n) < self.config.test_share
        practised = generator.choice(self.n_buckets, n, p=self.probabilities)
        bucket = np.where(tested, generator.integers(self.n_buckets, size=n), practised)
        sizes, order = np.bincount(self.buckets), np.argsort(self.buckets, kind="stable")
        rank = (generator.random(n) * sizes[bucket]).astype(np.int64)
        return order[np.cumsum(sizes)[bucket] - sizes[bucket] + rank], tested

    def observe(self, goals: np.ndarray, reached: np.ndarray, tested: np.ndarray) -> None:
        """As `Curriculum.observe`."""
        for goal, success in zip(goals[tested], (goals == reached)[tested], strict=True):
            self.tests[self.buckets[goal]].append(int(success))

    def end_epoch(self) -> None:
        """Update competence and progress."""
        for bucket, tests in enumerate(self.tests):
            if len(tests) >= self.config.least:
                older, newer = np.array_split(np.array(tests), 2)
                self.competence[bucket] = newer.mean()
                self.progress[bucket] = abs(newer.mean() - older.mean())

    def replay_weights(self) -> np.ndarray:
        """As `Curriculum.replay_weights`."""
        return self.probabilities[self.buckets] / np.bincount(self.buckets)[self.buckets]

    def metrics(self) -> dict[str, float]:
        """decstr_p_b and decstr_competence_b of each bucket b at the end of the last epoch."""
        found = {"p": self.probabilities, "competence": self.competence}
        return {f"decstr_{name}_{b}": float(value) for name, values in found.items() for b, value in enumerate(values)}

    def state_dict(self) -> dict[str, Any]:
        """Outcomes of tests, competence and progress."""
        arrays = {"competence": self.competence.tolist(), "progress": self.progress.tolist()}
        return {"tests": [list(tests) for tests in self.tests], **arrays}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a `state_dict`. Raises ValueError if the number of buckets differs."""
        if len(state["tests"]) != self.n_buckets:
            raise ValueError(f"the saved curriculum has {len(state['tests'])} buckets, not {self.n_buckets}")
        self.tests = [deque(tests, maxlen=self.config.window) for tests in state["tests"]]
        self.competence, self.progress = np.array(state["competence"]), np.array(state["progress"])
