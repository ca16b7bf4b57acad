"""Multi-criteria HER (Lanier, McAleer, Baldi 2019, arXiv 1906.03710): relabels each criterion of a goal separately.

A goal of n blocks has one criterion per pair of blocks: its three predicates, close(i, j), on(i, j) and on(j, i). Each
criterion is relabelled independently with probability `relabel_share`. It then gets the values that the episode
achieved at a step of its own, drawn uniformly from the steps after the transition. Otherwise it keeps the values that
were pursued. So a batch also contains goals that are reached in part, and some that no placement of the blocks reaches.

What the paper leaves open, and what we chose:

- Their criteria are the blocks' positions, each near its target or not. Here the predicates of a pair are one
  criterion, because they depend on each other: "a on b" implies that both are close.
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
    """Probability that a criterion is relabelled, in [0, 1]; that of HER with k = 4."""

    def __post_init__(self) -> None:
        check_share(self, "relabel_share")


class MultiCriteriaHER(Relabelling):
    """HER for each pair of blocks separately."""

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
