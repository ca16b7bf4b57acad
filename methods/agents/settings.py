"""Settings of the agent and of the hybrid policy mechanism. Needs no torch, so that `train --help` is quick."""

import math
from dataclasses import dataclass
from typing import Literal

from curiobench.methods.checks import check_option, check_positive

PairMode = Literal["symmetric", "oriented", "roles"]
"""Ordered pairs of blocks: both orders of each pair, or one, chosen by the goal alone or by goal and state."""

Network = Literal["deep_sets", "pair_attention"]
"""Pooling of pairs in a network: sum (`deepsets.py`) or attention (`pair_attention.py`)."""

Features = Literal["state", "near_field"]
"""Inputs of actor and critics: the paper's state alone, or also short distances and differences of bits."""

QIntNormalisation = Literal["popart", "zscore"]
"""What is normalised: the outputs of Q_int (PopArt), or the reward that it learns from."""


@dataclass(frozen=True)
class SACConfig:
    """Settings of the agent. Where DECSTR has the same setting, the default is its value."""

    gamma: float = 0.98
    """Discount factor per step, in [0, 1)."""
    learning_rate: float = 1e-3
    """Adam's learning rate, for actor, critics and temperature; the initial one if decay_updates is set."""
    decay_updates: int | None = None
    """Updates over which the learning rate decays linearly to a tenth; constant afterwards, and if None."""
    polyak: float = 0.05
    """Weight of the critics in a target update (Polyak averaging)."""
    target_every: int = 2
    """Updates between target updates."""
    temperature: float = 0.2
    """Weight of the policy's entropy; the initial one if tune_temperature is set."""
    tune_temperature: bool = False
    """Adjust the temperature until the policy's entropy is -dim(action) (Haarnoja et al. 2018, section 5)."""
    entropy_in_targets: bool = True
    """Include the entropy of later actions in the value, as soft actor-critic does. Precise actions reduce entropy. If
    the goal is far, this outweighs the discounted reward, and the agent does not move towards it."""
    actor_every: int = 1
    """Critic updates per update of policy and temperature (Fujimoto et al. 2018)."""
    network: Network = "deep_sets"
    """Sum over pairs of blocks as in DECSTR (deep_sets), or attention over them (pair_attention)."""
    hidden: int = 256
    """Units in each hidden layer; with pair_attention in the first, and twice as many in the others."""
    layer_norm: bool = True
    """Normalise hidden layers (Ba et al. 2016)."""
    pairs: PairMode = "symmetric"
    """Ordered pairs of blocks: both orders of each pair (symmetric), or one, chosen by the goal as in DECSTR (oriented)
    or by goal, state and distance from the hand (roles)."""
    features: Features = "state"
    """Inputs of actor and critics: the paper's state (state), or also short distances between hand and blocks, and
    which predicates are missing or unwanted (near_field). Curiosity methods always get the state."""
    detail_scale: float = 1.0
    """Factor, in (0, 1], of normalised angles, velocities and absolute x and y in the inputs of actor and critics,
    which matter least to these tasks."""
    identities: bool = False
    """Add one-hot identities of blocks to the inputs. Without them, goals that differ by renaming share learning."""
    tau: float = 0.2
    """Weight of the z-scored intrinsic reward or, with +hm, of the normalised Q_int."""
    reward_window: int | None = None
    """Updates over which old statistics of the intrinsic reward decay; None for all history, with which a reward that
    shrinks vanishes after z-scoring."""

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
    """Settings of the hybrid policy mechanism, only used with `+hm`."""

    q_int_normalisation: QIntNormalisation = "popart"
    """Normalisation of Q_int in Q_c: PopArt, or Q_int of the z-scored reward; the paper compares them in Figure 6."""
    popart_rate: float = 3e-4
    """Share of a batch in PopArt's statistics, in (0, 1]; default of Hessel et al. 2018."""
    adaptive_tau: bool = False
    """Adapt tau so that the spread of tau · Q_int over actions is `spread_ratio` times that of Q_ext; sac.tau is its
    first value."""
    spread_ratio: float = 0.5
    """Target ratio of adaptive_tau."""
    tau_rate: float = 0.05
    """Step of adaptive_tau after each collection, as a share of the distance on a logarithmic scale, in (0, 1]."""

    def __post_init__(self) -> None:
        check_option(self, "q_int_normalisation", QIntNormalisation)
        check_positive(self, "spread_ratio")
        for name in ("popart_rate", "tau_rate"):
            if not 0 < getattr(self, name) <= 1:
                raise ValueError(f"{name} is {getattr(self, name)}; it must lie in (0, 1]")
