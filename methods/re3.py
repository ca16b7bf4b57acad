"""RE3, random encoders for exploration (Seo et al. 2021, arXiv 2102.09430): distance to neighbours as novelty.

    y = encoder(s'), fixed and random
    r_int = beta · log(1 + ‖y - k-th nearest neighbour of y‖)      among the features of particles, states of the replay
    tau_t = tau · (1 - decay)^t                    weight of the normalised r_int; t counts the authors' updates

The mean of the logarithms estimates the entropy of visited states up to constants. Distances between features of a
random network are similar to distances between states. Nothing is trained, so the reward changes only with the visited
states.

Differences from the authors' code (younggyoseo/RE3), which works on images with RAD, Dreamer and A2C:

- Neighbours are searched in a uniform sample of the buffer, drawn for each batch, and not in the complete buffer. This
  makes distances larger by a factor that hardly depends on the state, and the agent's normalisation removes it. Fine
  structure is lost: among 512 particles, the third neighbour may be far.
- Features are computed for every batch and not stored. The encoder is fixed, but the agent's running normalisation of
  states changes.
- The reward is for the next state s', not for s. This only shifts rewards by one step, except that the last state of
  an episode counts too.
- The encoder is an MLP. It lacks the final layer norm and tanh of the authors' convolutional encoder: bounded features
  make distances between far states small.
- The weight decays over a run of any length as it does over theirs. They divide by a running standard deviation, then
  multiply by 0.05 · (1 - 1e-5)^t (`beta` in rad_re3/re3.py). Their t goes up to 250,000: 500,000 frames, 2 per action.
- log(1 + distance) as in the paper; their code takes the distance itself in RAD.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from curiobench.methods.checks import Sees, check_at_least, check_option, check_positive
from curiobench.methods.learned import LearnedReward, perceptron
from curiobench.methods.neighbours import neighbour_distances
from curiobench.methods.reward import Transitions

UPDATES_AN_EPOCH = 500
"""The authors' 250,000 updates, divided by the 500 epochs of a run."""


@dataclass(frozen=True)
class RE3Config:
    """Settings of RE3."""

    k: int = 3
    """Which neighbour the distance is taken to; the paper's."""
    particles: int = 512
    """States of the replay among which it is searched."""
    beta: float = 1.0
    """Scale of the reward. No effect in the combined reward, which is normalised."""
    decay: float = 1e-5
    """Share of the weight that is lost at each of the authors' 250,000 updates, in [0, 1); theirs. Over a run of any
    length the weight falls to 0.08."""
    hidden: int = 128
    """Units in the encoder's hidden layer."""
    features: int = 50
    """Outputs of the encoder; the authors'."""
    sees: Sees = "full"
    """Part of the state that it gets: all (full; the paper's), positions of hand and blocks (positions), or of the
    blocks alone (blocks). Most of the distance between full states is that of angles and angular velocities."""

    def __post_init__(self) -> None:
        check_positive(self, "k", "particles", "beta", "hidden", "features")
        check_at_least(self, self.k, "particles")
        check_option(self, "sees", Sees)
        if not 0 <= self.decay < 1:
            raise ValueError(f"decay is {self.decay}; it must lie in [0, 1)")


class RE3(LearnedReward):
    """Random encoders for efficient exploration."""

    Config = RE3Config
    _STATEFUL = ("encoder",)

    def __init__(self, state_size: int, action_size: int, config: RE3Config, generator: torch.Generator) -> None:
        self.config, self.sees, self.n_particles = config, config.sees, config.particles
        self.encoder = perceptron([state_size, config.hidden, config.features], generator).requires_grad_(False)

    def bonus_factor(self, epoch: int) -> float:
        """(1 - decay)^t."""
        return (1 - self.config.decay) ** (UPDATES_AN_EPOCH * epoch)

    @torch.no_grad()
    def reward(self, transitions: Transitions) -> Tensor:
        """r_int (B,) from distances to particles. Raises ValueError if there are fewer than k of them."""
        particles = None if transitions.particles is None else self.encoder(transitions.particles)
        distances = neighbour_distances(self.encoder(transitions.next_state), particles, self.config.k)
        return self.config.beta * distances[:, -1].log1p()

    def update(self, transitions: Transitions) -> dict[str, Tensor]:
        """Nothing is trained. Metrics: re3_factor, (1 - decay)^t."""
        return {"re3_factor": torch.tensor(self.bonus_factor(transitions.epoch))}
