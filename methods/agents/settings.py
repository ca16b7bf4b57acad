"""Settings of the agent and of the hybrid policy mechanism. Needs no torch, so that `train --help` is quick."""

import math
from dataclasses import dataclass
from typing import Literal

from curiobench.methods.checks import check_option, check_positive

PairMode = Literal["symmetric", "oriented", "roles"]
"""Ordered pairs of blocks: all of them, or one a pair, turned by the goal alone or by goal and state."""

Network = Literal["deep_sets", "pair_attention"]
"""How a network reads its pairs: summed (`deep_sets.py`), or weighed by attention (`pair_attention.py`)."""

Features = Literal["state", "near_field"]
"""What actor and critics see of a pair: the paper's state alone, or with it short distances and differences of bits."""

QIntNormalisation = Literal["popart", "zscore"]
"""Whose outputs are normalised: those of Q_int (PopArt), or the reward that it learns from."""


@dataclass(frozen=True)
class SACConfig:
    """Settings of the agent. Defaults are those of DECSTR where it has them."""

    gamma: float = 0.98
    """Discount factor a step, in [0, 1)."""
    learning_rate: float = 1e-3
    """Adam's learning rate, for actor, critics and temperature; the initial one if decay_updates is set."""
    decay_updates: int | None = None
    """Updates over which the learning rate falls linearly to a tenth, where it stays; None keeps it constant."""
    polyak: float = 0.05
    """Share of the critics' weights that moves into the target critics at each target update."""
    target_every: int = 2
    """Updates from one target update to the next."""
    temperature: float = 0.2
    """Weight of the policy's entropy; the initial one if tune_temperature is set."""
    tune_temperature: bool = False
    """Adjust the temperature until the policy's entropy is -dim(action) (Haarnoja et al. 2018, section 5)."""
    entropy_in_targets: bool = True
    """Count the entropy of the policy to come as a part of the value, as soft actor-critic does. It costs a policy
    entropy to be precise: where the goal is far, that outweighs the discounted reward, and the agent stays where it
    is."""
    actor_every: int = 1
    """Updates from one step of policy and temperature to the next; critics learn at each (Fujimoto et al. 2018)."""
    network: Network = "deep_sets"
    """Sum over pairs of blocks as in DECSTR (deep_sets), or attention over them (pair_attention)."""
    hidden: int = 256
    """Units in each hidden layer; with pair_attention in the first, and twice as many in the others."""
    layer_norm: bool = True
    """Normalise hidden layers (Ba et al. 2016)."""
    pairs: PairMode = "symmetric"
    """Ordered pairs of blocks: all of them (symmetric), or one a pair, turned by the goal as in DECSTR (oriented), or
    turned by goal, state and distance from the hand (roles)."""
    features: Features = "state"
    """What actor and critics see: the paper's state (state), or also short distances between hand and blocks, and which
    predicates are missing or unwanted (near_field). Curiosity methods see the state in any case."""
    detail_scale: float = 1.0
    """Factor, in (0, 1], on normalised angles, velocities and absolute positions in the table's plane before actor and
    critics see them; they matter least to this task."""
    identities: bool = False
    """Tell the networks which block is which; without, goals that differ by renaming share what is learned."""
    tau: float = 0.2
    """Weight of curiosity: of the z-scored intrinsic reward or, with +hm, of the normalised Q_int."""
    reward_window: int | None = None
    """Updates over which the statistics that z-score the intrinsic reward forget; None for all history, over which the
    z-score of a reward that shrinks comes to nothing."""

    def __post_init__(self) -> None:
        for name, legal, range_ in (
            ("gamma", 0 <= self.gamma < 1, "in [0, 1)"),
            ("polyak", 0 < self.polyak <= 1, "in (0, 1]"),
            ("detail_scale", 0 < self.detail_scale <= 1, "in (0, 1]"),
            ("tau", 0 <= self.tau < math.inf, "at least 0 and finite"),
        ):
            if not legal:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be {range_}")
        check_positive(self, "learning_rate", "target_every", "temperature", "hidden", "actor_every")
        check_positive(self, *(name for name in ("decay_updates", "reward_window") if getattr(self, name) is not None))
        for name, options in (("network", Network), ("pairs", PairMode), ("features", Features)):
            check_option(self, name, options)


@dataclass(frozen=True)
class HybridConfig:
    """Settings of the hybrid policy mechanism; without `+hm` in the method they do nothing."""

    q_int_normalisation: QIntNormalisation = "popart"
    """What explores: Q_int under PopArt, or Q_int of the z-scored reward, which the paper compares in Figure 6."""
    popart_rate: float = 3e-4
    """Share of a batch in PopArt's statistics, in (0, 1]; that of Hessel et al. 2018."""
    adaptive_tau: bool = False
    """Steer tau so that the spread of tau · Q_int over actions is `spread_ratio` times that of Q_ext; sac.tau is where
    it starts."""
    spread_ratio: float = 0.5
    """The ratio that adaptive_tau steers for."""
    tau_rate: float = 0.05
    """Share of the way there, on a logarithmic scale, that tau goes after each collection, in (0, 1]."""

    def __post_init__(self) -> None:
        check_option(self, "q_int_normalisation", QIntNormalisation)
        check_positive(self, "spread_ratio")
        for name in ("popart_rate", "tau_rate"):
            if not 0 < getattr(self, name) <= 1:
                raise ValueError(f"{name} is {getattr(self, name)}; it must lie in (0, 1]")
