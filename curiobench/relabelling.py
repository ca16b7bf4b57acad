"""Which transitions a batch holds, and under which desired goals: hindsight relabelling, at sample time.

`ReplayConfig.relabelling` names one of these. A method may have its own instead; see `methods/relabelling.py`.

future      HER (Andrychowicz et al. 2017, arXiv 1707.01495): a goal that the episode achieves later, or its own.
arrivals    ours: half of a batch leads up to moments at which a goal was reached; the rest is `future`, and steps under
            the goal that was pursued.
"""

from collections.abc import Callable
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

import numpy as np

from curiobench.methods.relabelling import Draw

if TYPE_CHECKING:
    from curiobench.replay import EpisodeReplay

N_ARRIVAL_KINDS = 3
"""Kinds of arrivals: a block was put on another; else two came close; else something was only undone."""


def arrival_kinds(before: np.ndarray, after: np.ndarray, on_bits: np.ndarray) -> np.ndarray:
    """Kind (...) of the changes between achieved goals `(..., bits)`: 0, 1 or 2, as in `N_ARRIVAL_KINDS`.

    `on_bits` `(bits,)` bool says which bits mean that a block lies on another.
    """
    gained = after > before
    return np.where((gained & on_bits).any(-1), 0, np.where(gained.any(-1), 1, 2))


def draw_future(replay: "EpisodeReplay", size: int, generator: np.random.Generator) -> Draw:
    """Goal-balanced episodes, uniform steps and "future" goals; at most a share `satisfied_cap` already satisfied."""
    cap = replay.config.satisfied_cap
    return _draw_capped(replay, size, None if cap is None else int(cap * size), generator)


def draw_arrivals(replay: "EpisodeReplay", size: int, generator: np.random.Generator) -> Draw:
    """`arrival_share` of a batch from arrivals, `pursued_share` under the pursued goal, the rest by `draw_future`.

    An arrival is a step at which the achieved goal changes to a valid goal g. First a pair of g and a kind of arrival
    is drawn uniformly (otherwise easy kinds would fill the batch), then an arrival of that pair, then an earlier step
    of its episode at which g did not hold. The transition at that step is relabelled with g.

    Most transitions of `draw_future` have a goal that holds already or is not reached in the episode. Those of arrivals
    have a goal that is reached later. Goals from hindsight alone contain few failures, so values of bad actions, such
    as pushing a block off the table, become too high. Therefore some steps keep the goal that their episode pursued.
    `satisfied_cap` is a share of the complete batch.
    """
    config = replay.config
    occurring = np.flatnonzero(replay.arrivals.counts)
    if not len(occurring):
        return draw_future(replay, size, generator)
    n = round(config.arrival_share * size)
    n_pursued = min(round(config.pursued_share * size), size - n)
    parts = [_draw_arrivals(replay, n, occurring, generator), _draw_pursued(replay, n_pursued, generator)]
    quota = None
    if config.satisfied_cap is not None:
        quota = max(0, int(config.satisfied_cap * size) - int(_satisfied(replay, parts[1]).sum()))
    parts.append(_draw_capped(replay, size - n - n_pursued, quota, generator))
    return tuple(np.concatenate(arrays) for arrays in zip(*parts, strict=True))


RELABELLINGS: MappingProxyType[str, Callable[["EpisodeReplay", int, np.random.Generator], Draw]] = MappingProxyType(
    {"future": draw_future, "arrivals": draw_arrivals}
)
"""Relabellings by name; each has the signature of `Relabelling.draw`."""

RelabellingName = Literal[tuple(RELABELLINGS)]
"""Names of relabellings."""


def _draw_arrivals(replay: "EpisodeReplay", size: int, occurring: np.ndarray, generator: np.random.Generator) -> Draw:
    """`size` steps before arrivals, of the groups (goal · N_ARRIVAL_KINDS + kind) that occur."""
    uniform = generator.random((3, size))
    if replay.goal_weights is None:
        group = occurring[scaled(uniform[0], len(occurring))]
    else:
        group = occurring[weighted(uniform[0], _group_weights(replay.goal_weights, occurring // N_ARRIVAL_KINDS))]
    slot, arrival = np.divmod(replay.arrivals.draw(group, uniform[1]), replay.steps + 1)
    goal = group // N_ARRIVAL_KINDS
    earlier = (np.arange(replay.steps) < arrival[:, None]) & (replay.goal_ids[slot, :-1] != goal[:, None])
    rank = scaled(uniform[2], earlier.sum(1))
    return slot, np.argmax(np.cumsum(earlier, axis=1) > rank[:, None], axis=1), replay.valid_goals[goal]


def _group_weights(weights: np.ndarray, goals: np.ndarray) -> np.ndarray:
    """Weights of groups from those of goals `(G,)`: a goal's weight is split over its kinds of arrivals that occur.

    `goals` holds the goal of each group. If all these weights are 0, groups have equal weights.
    """
    shared = weights[goals] / np.bincount(goals)[goals]
    return shared if shared.any() else np.ones(len(goals))


def _draw_pursued(replay: "EpisodeReplay", size: int, generator: np.random.Generator) -> Draw:
    """`size` uniform steps of uniform episodes, each with the goal that its episode pursued."""
    uniform = generator.random((2, size))
    slot = scaled(uniform[0], len(replay))
    return slot, scaled(uniform[1], replay.steps), replay.arrays["desired_goal"][slot]


def _satisfied(replay: "EpisodeReplay", drawn: Draw) -> np.ndarray:
    """`(B,)` bool, whether the desired goal already holds before the step."""
    slot, step, desired = drawn
    return (replay.arrays["achieved_goal"][slot, step] == desired).all(1)


def _draw_capped(replay: "EpisodeReplay", size: int, quota: int | None, generator: np.random.Generator) -> Draw:
    """`size` draws, at most `quota` of them already satisfied.

    Draws candidates at most ten times until enough are accepted. If there are still too few, rejected ones are added.
    """
    if quota is None:
        return _draw(replay, size, generator)
    pool = _draw(replay, 2 * size, generator)
    for attempt in range(10):
        satisfied = _satisfied(replay, pool)
        accepted = ~satisfied | (np.cumsum(satisfied) <= quota)
        if accepted.sum() >= size or attempt == 9:
            break
        pool = tuple(np.concatenate(p) for p in zip(pool, _draw(replay, 2 * size, generator), strict=True))
    chosen = np.concatenate([np.flatnonzero(accepted), np.flatnonzero(~accepted)])[:size]
    return tuple(part[chosen] for part in pool)


def _draw(replay: "EpisodeReplay", size: int, generator: np.random.Generator) -> Draw:
    """One random draw of an episode, a step and a goal for each of `size` transitions."""
    uniform = generator.random((5, size))
    slot = replay.draw_episodes(uniform[:2])
    step = scaled(uniform[2], replay.steps)
    future = step + 1 + scaled(uniform[3], replay.steps - step)
    relabelled = replay.arrays["achieved_goal"][slot, future]
    keep = uniform[4] >= replay.config.relabel_share
    relabelled[keep] = replay.arrays["desired_goal"][slot[keep]]
    return slot, step, relabelled


def weighted(uniform: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Map numbers in [0, 1) to indices with probabilities in proportion to the weights."""
    cumulated = np.cumsum(weights)
    return np.searchsorted(cumulated, uniform * cumulated[-1], side="right")


def scaled(uniform: np.ndarray, n: int | np.ndarray) -> np.ndarray:
    """Map numbers in [0, 1) to integers in [0, n)."""
    return (uniform * n).astype(np.int64)
