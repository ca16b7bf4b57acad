"""DECSTR's curriculum (Akakzia et al. 2021, arXiv 2006.07185): practise where learning progresses.

Goals stand in buckets. In a test an episode pursues a goal of a uniformly drawn bucket without exploring. Of the last w
tests of bucket b

    C_b  = success rate of the newer half                              competence
    LP_b = |success rate of the newer half - that of the older half|   learning progress
    p_b  = (1 - C_b) · LP_b / sum over buckets                         uniform where all of these are 0

Other episodes pursue a uniform goal of a bucket drawn with p. The replay draws goals in the same way, and an episode
that ended in that goal; any episode where none did. p changes at the end of an epoch.

Differences from the authors' code (akakzia/decstr, goal_sampler.py):

- Their C_b is the success rate of the older half, which looks like a slip: their list runs from the newest test to the
  oldest. The paper has recent success.
- They keep 1,800 tests a bucket and count none before there are more than 100. A run of theirs makes some 50,000 tests
  a bucket, our laptop runs 1,400: the defaults here are 200 and 40.
- Each episode is a test or none by a draw of its own; theirs decide for all of a worker's episodes together.
- Their networks are not part of this: each curriculum runs on the agent that all methods have.
- Their buckets are made by hand for three blocks. `buckets` says by a rule what they have in common.
"""

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from curiobench.methods.checks import check_positive, check_share
from curiobench.methods.curriculum import Curriculum, Goals, Situation

FEW_CLOSE = 1
"""Pairs that are close in a goal of the first bucket, at most."""


@dataclass(frozen=True)
class DECSTRConfig:
    """Settings of the curriculum."""

    test_share: float = 0.1
    """Share of episodes that are tests, in [0, 1]; the authors'."""
    window: int = 200
    """Tests a bucket, w, over which competence and progress are measured."""
    least: int = 40
    """Tests before which a bucket has neither."""

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
        """Measure competence and progress anew."""
        for bucket, tests in enumerate(self.tests):
            if len(tests) >= self.config.least:
                older, newer = np.array_split(np.array(tests), 2)
                self.competence[bucket] = newer.mean()
                self.progress[bucket] = abs(newer.mean() - older.mean())

    def replay_weights(self) -> np.ndarray:
        """As `Curriculum.replay_weights`."""
        return self.probabilities[self.buckets] / np.bincount(self.buckets)[self.buckets]

    def metrics(self) -> dict[str, float]:
        """decstr_p_b and decstr_competence_b of each bucket b, as of the last epoch's end."""
        found = {"p": self.probabilities, "competence": self.competence}
        return {f"decstr_{name}_{b}": float(value) for name, values in found.items() for b, value in enumerate(values)}

    def state_dict(self) -> dict[str, Any]:
        """Outcomes of tests, competence and progress."""
        arrays = {"competence": self.competence.tolist(), "progress": self.progress.tolist()}
        return {"tests": [list(tests) for tests in self.tests], **arrays}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a `state_dict`. Raises ValueError where the number of buckets differs."""
        if len(state["tests"]) != self.n_buckets:
            raise ValueError(f"the saved curriculum has {len(state['tests'])} buckets, not {self.n_buckets}")
        self.tests = [deque(tests, maxlen=self.config.window) for tests in state["tests"]]
        self.competence, self.progress = np.array(state["competence"]), np.array(state["progress"])
