"""Settings of the agent and of the hybrid policy mechanism. Needs no torch, so that `train --help` is quick."""

import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

PairMode = Literal["symmetric", "oriented"]
"""Ordered pairs of blocks: all of them, or one a pair."""

QIntNormalisation = Literal["popart", "zscore"]
"""Whose outputs are normalised: those of Q_int (PopArt), or the reward that it learns from."""


def check_positive(config: Any, *names: str) -> None:
    """Raise ValueError, with name and value, unless these fields of a config are finite and above 0."""
    for name in names:
        if not 0 < getattr(config, name) < math.inf:
            raise ValueError(f"{name} is {getattr(config, name)}; it must be positive and finite")


@dataclass(frozen=True)
class SACConfig:
    """Settings of the agent. Defaults are those of DECSTR where it has them."""

    gamma: float = 0.98
    """Discount factor a step, in [0, 1)."""
    learning_rate: float = 1e-3
    """Adam's learning rate, for actor, critics and temperature."""
    polyak: float = 0.05
    """Share of the critics' weights that moves into the target critics at each target update."""
    target_every: int = 2
    """Updates from one target update to the next."""
    temperature: float = 0.2
    """Weight of the policy's entropy; the initial one if tune_temperature is set."""
    tune_temperature: bool = False
    """Adjust the temperature until the policy's entropy is -dim(action) (Haarnoja et al. 2018, section 5)."""
    hidden: int = 256
    """Units in each hidden layer."""
    layer_norm: bool = True
    """Normalise hidden layers (Ba et al. 2016)."""
    pairs: PairMode = "symmetric"
    """Ordered pairs of blocks, all of them (symmetric), or one a pair, turned by the goal as in DECSTR (oriented)."""
    identities: bool = False
    """Tell the networks which block is which; without, goals that differ by renaming share what is learned."""
    tau: float = 0.2
    """Weight of curiosity: of the z-scored intrinsic reward or, with +hm, of the normalised Q_int."""

    def __post_init__(self) -> None:
        for name, legal, range_ in (
            ("gamma", 0 <= self.gamma < 1, "in [0, 1)"),
            ("polyak", 0 < self.polyak <= 1, "in (0, 1]"),
            ("tau", 0 <= self.tau < math.inf, "at least 0 and finite"),
        ):
            if not legal:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be {range_}")
        check_positive(self, "learning_rate", "target_every", "temperature", "hidden")


@dataclass(frozen=True)
class HybridConfig:
    """Settings of the hybrid policy mechanism; without `+hm` in the method they do nothing."""

    q_int_normalisation: QIntNormalisation = "popart"
    """What explores: Q_int under PopArt, or Q_int of the z-scored reward, which the paper compares in Figure 6."""
    popart_rate: float = 3e-4
    """Share of a batch in PopArt's statistics, in (0, 1]; that of Hessel et al. 2018."""

    def __post_init__(self) -> None:
        if self.q_int_normalisation not in get_args(QIntNormalisation):
            legal = " and ".join(map(repr, get_args(QIntNormalisation)))
            raise ValueError(f"q_int_normalisation is {self.q_int_normalisation!r}; legal are {legal}")
        if not 0 < self.popart_rate <= 1:
            raise ValueError(f"popart_rate is {self.popart_rate}; it must lie in (0, 1]")
