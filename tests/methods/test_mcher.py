"""Multi-criteria HER: every mixed goal of a small case, as often as it should be."""

import itertools
from collections import Counter

import numpy as np
from scipy.stats import chisquare

from curiobench.methods.curriculum import Goals
from curiobench.methods.mcher import MultiCriteriaHER, MultiCriteriaHERConfig

PAIRS = np.array([[0, 2, 3], [1, 4, 5]])
"""Two pairs of blocks; their bits do not lie side by side, as in the tasks."""
ACHIEVED = np.array([[0, 0, 0, 0, 0, 0], [1, 0, 0, 0, 0, 0], [1, 1, 0, 0, 0, 1]], np.uint8)
PURSUED = np.array([1, 1, 1, 0, 1, 0], np.uint8)
SHARE = 0.7


class OneEpisode:
    """A replay of one episode of two steps."""

    steps = 2
    arrays = {"achieved_goal": ACHIEVED[None], "desired_goal": PURSUED[None]}  # noqa: RUF012

    def __len__(self) -> int:
        return 1

    def draw_episodes(self, uniform: np.ndarray) -> np.ndarray:
        return np.zeros(uniform.shape[1], int)


def expected() -> dict[tuple[int, ...], float]:
    """Probability of each (step, goal), from the definition: a source for each pair, independently."""
    found: Counter[tuple[int, ...]] = Counter()
    for step in (0, 1):
        later = range(step + 1, 3)
        sources = [(PURSUED, 1 - SHARE), *((ACHIEVED[t], SHARE / len(later)) for t in later)]
        for of_pairs in itertools.product(sources, repeat=2):
            goal = np.zeros(6, int)
            for bits, (source, _) in zip(PAIRS, of_pairs, strict=True):
                goal[bits] = source[bits]
            found[(step, *goal.tolist())] += 0.5 * of_pairs[0][1] * of_pairs[1][1]
    return found


def test_every_mixed_goal_is_drawn_as_often_as_its_sources_say():
    goals = Goals(ACHIEVED, np.ones(3, int), PAIRS)
    n, rng = 20_000, np.random.default_rng(0)
    method = MultiCriteriaHER(goals, MultiCriteriaHERConfig(relabel_share=SHARE))
    slot, step, desired = method.draw(OneEpisode(), n, rng)
    assert not slot.any()
    counts = Counter(map(tuple, np.column_stack([step, desired]).tolist()))
    wanted = expected()
    assert counts.keys() == wanted.keys()
    assert chisquare([counts[key] for key in wanted], [n * share for share in wanted.values()]).pvalue > 1e-3
    assert (1, *ACHIEVED[2][[0]], *PURSUED[1:2], *ACHIEVED[2][2:4], *PURSUED[4:]) in counts  # reached in part
    assert (OneEpisode.arrays["desired_goal"] == PURSUED).all()
