"""The paper's inequality (Eqs. 16 to 18) in random finite worlds, where every value can be computed exactly.

The paper concludes V_hybrid >= V_c and V_hybrid >= V_d for a hybrid that follows, in each state, the policy with the
larger value. V_c counts r_c = r_ext + tau · n(r_int), V_d counts r_ext. So "the value of the hybrid" has to say which
reward it counts, and the paper does not. `pytest` on this file shows what holds and what does not:

- Counting in each state the reward of the policy that acts there, both inequalities hold. That is Eqs. 16 to 18.
- Where both values count one reward, they hold as well (policy improvement).
- Counting r_ext alone, V_hybrid can be below V_d: exploring costs. Counting r_c alone, it can be below V_c.
- What the implemented switch, Q_ext(s, a_c) + tau · n(Q_int(s, a_c)) against Q_ext(s, a_d), does guarantee in r_ext: it
  gives up at most the discounted sum of tau · n(Q_int) over the steps at which pi_c acts.
"""

from itertools import product
from typing import NamedTuple

import numpy as np

STATES, ACTIONS, GAMMA, TAU = 5, 3, 0.9, 0.2
SEEDS = range(100)


class World(NamedTuple):
    """A random Markov decision process and two random policies."""

    transitions: np.ndarray
    """(S, A, S)"""
    r_ext: np.ndarray
    """(S, A), mostly 0."""
    r_int: np.ndarray
    """(S, A), normalised: mean 0, spread 1."""
    pi_d: np.ndarray
    """(S, A)"""
    pi_c: np.ndarray
    """(S, A)"""

    @property
    def r_c(self) -> np.ndarray:
        return self.r_ext + TAU * self.r_int


def world(seed: int) -> World:
    rng = np.random.default_rng(seed)
    r_ext, r_int = rng.uniform(size=(STATES, ACTIONS)) > 0.8, rng.normal(size=(STATES, ACTIONS))
    simplex = [
        rng.dirichlet(np.full(n, 0.3), (STATES, *more)) for n, more in ((STATES, (ACTIONS,)), *2 * [(ACTIONS, ())])
    ]
    return World(simplex[0], r_ext * 1.0, (r_int - r_int.mean()) / r_int.std(), *simplex[1:])


def solve(w: World, policy: np.ndarray, per_state: np.ndarray) -> np.ndarray:
    """(S,) discounted sum, along the policy (S, A), of a quantity (S,) of each state."""
    moves = np.einsum("sa,sat->st", policy, w.transitions)
    return np.linalg.solve(np.eye(STATES) - GAMMA * moves, per_state)


def value(w: World, policy: np.ndarray, reward: np.ndarray) -> np.ndarray:
    """(S,) exact value of a policy (S, A) under a reward (S, A)."""
    return solve(w, policy, (policy * reward).sum(1))


def action_value(w: World, policy: np.ndarray, reward: np.ndarray) -> np.ndarray:
    """(S, A) exact action value."""
    return reward + GAMMA * w.transitions @ value(w, policy, reward)


def switch(w: World, of_c: np.ndarray, of_d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eq. 15: where pi_c acts (S,), and pi_hybrid (S, A), from the values (S,) of both policies."""
    explores = of_c >= of_d
    return explores, np.where(explores[:, None], w.pi_c, w.pi_d)


def dominates(first: np.ndarray, *others: np.ndarray) -> bool:
    return all((first >= other - 1e-9).all() for other in others)


def test_counting_the_acting_policys_reward_the_hybrid_dominates_both():
    for w in map(world, SEEDS):
        v_c, v_d = value(w, w.pi_c, w.r_c), value(w, w.pi_d, w.r_ext)
        explores, hybrid = switch(w, v_c, v_d)
        reward = np.where(explores[:, None], w.r_c, w.r_ext)
        assert dominates(value(w, hybrid, reward), v_c, v_d)
        v_n = np.maximum(v_c, v_d)  # Eq. 16, and Eq. 17 with n = 0
        for _ in range(20):  # Eq. 18: following the hybrid for one more step never loses
            following = (hybrid * (reward + GAMMA * w.transitions @ v_n)).sum(1)
            assert dominates(following, v_n)
            v_n = following


def test_counting_one_reward_for_both_the_hybrid_dominates_both():
    for w in map(world, SEEDS):
        for reward in (w.r_ext, w.r_c):
            v_c, v_d = value(w, w.pi_c, reward), value(w, w.pi_d, reward)
            assert dominates(value(w, switch(w, v_c, v_d)[1], reward), v_c, v_d)


def test_counting_r_ext_or_r_c_alone_it_does_not():
    below_d = below_c = 0
    for w in map(world, SEEDS):
        v_c, v_d = value(w, w.pi_c, w.r_c), value(w, w.pi_d, w.r_ext)
        _, hybrid = switch(w, v_c, v_d)
        below_d += not dominates(value(w, hybrid, w.r_ext), v_d)
        below_c += not dominates(value(w, hybrid, w.r_c), v_c)
    assert below_d >= 5
    assert below_c >= 5


def implemented(w: World, q_ext: np.ndarray, q_int: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The switch on sampled actions: pi_hybrid (S, A), and the mean (S,) of tau · n(Q_int) where pi_c acts."""
    hybrid, given_up = np.zeros((STATES, ACTIONS)), np.zeros(STATES)
    for s, a_c, a_d in product(range(STATES), range(ACTIONS), range(ACTIONS)):
        chance = w.pi_c[s, a_c] * w.pi_d[s, a_d]
        if q_ext[s, a_c] + TAU * q_int[s, a_c] < q_ext[s, a_d]:
            hybrid[s, a_d] += chance
        else:
            hybrid[s, a_c] += chance
            given_up[s] += chance * TAU * q_int[s, a_c]
    return hybrid, given_up


def test_the_implemented_switch_gives_up_no_more_r_ext_than_the_novelty_it_follows():
    gains = []
    for w in map(world, SEEDS):
        q_ext, q_int = action_value(w, w.pi_d, w.r_ext), action_value(w, w.pi_c, w.r_int)
        q_int = (q_int - q_int.mean()) / q_int.std()
        hybrid, given_up = implemented(w, q_ext, q_int)
        gain = value(w, hybrid, w.r_ext) - value(w, w.pi_d, w.r_ext)
        assert dominates(gain, -solve(w, hybrid, given_up))
        gains.append(gain)
    assert np.min(gains) < -0.1  # it does give something up, …
    assert np.mean(gains) > 0  # … but with policies that are not optimal it gains on the whole
