"""Multi-criteria HER (Lanier, McAleer, Baldi 2019, arXiv 1906.03710): each criterion of a goal relabelled on its own.

A goal of n blocks has a criterion for each pair of blocks: its three predicates, close(i, j), on(i, j) and on(j, i).
With probability `relabel_share`, and independently of the others, a criterion becomes what the episode achieved at a
step of its own, uniform over those after the transition; else it stays as it was pursued. So a batch also holds goals
that are reached in part, and some that no placement of the blocks reaches.

What the paper leaves open, and what we chose:

- Their criteria are the blocks' positions, each near its target or not. Predicates of a pair belong together: "a on b"
  says that both are close.
- Episodes are drawn as for the other relabellings: balanced over the goals that they ended in.
"""

from dataclasses import dataclass

import numpy as np

from curiobench.methods.checks import check_share
from curiobench.methods.relabelling import Draw, Relabelling, Replay


@dataclass(frozen=True)
class MultiCriteriaHERConfig:
    """Settings of the relabelling."""

    relabel_share: float = 0.8
    """Probability that a criterion is relabelled, in [0, 1]; hindsight's with k = 4."""

    def __post_init__(self) -> None:
        check_share(self, "relabel_share")


class MultiCriteriaHER(Relabelling):
    """Hindsight for each pair of blocks on its own."""

    Config = MultiCriteriaHERConfig

    def draw(self, replay: Replay, size: int, generator: np.random.Generator) -> Draw:
        """As `Relabelling.draw`."""
        slot = replay.draw_episodes(generator.random((2, size)))
        step = generator.integers(replay.steps, size=size)
        criteria = self.goals.pairs
        relabelled = generator.random((size, len(criteria))) < self.config.relabel_share
        future = step[:, None] + 1 + (generator.random(relabelled.shape) * (replay.steps - step[:, None])).astype(int)
        achieved, desired = replay.arrays["achieved_goal"], replay.arrays["desired_goal"][slot]
        for number, bits in enumerate(criteria):
            chosen = np.flatnonzero(relabelled[:, number])
            desired[np.ix_(chosen, bits)] = achieved[slot[chosen], future[chosen, number]][:, bits]
        return slot, step, desired
