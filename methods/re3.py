"""RE3, random encoders for exploration (Seo et al. 2021, arXiv 2102.09430): distance to neighbours as novelty.

    y = encoder(s'), fixed and random
    r_int = beta · log(1 + ‖y - k-th nearest neighbour of y‖)      among the features of particles, states of the replay
    tau_t = tau · (1 - decay)^t                            its weight, once normalised; t counts the authors' updates

an estimate of the entropy of visited states up to constants. Distances in the space of a random network resemble
those between states; as nothing is trained, the reward changes only with what was visited.

Differences from the authors' code (younggyoseo/RE3), which works on images with RAD, Dreamer and A2C:

- Neighbours are searched among a uniform sample of the buffer, drawn for each batch, not in the whole buffer.
  Distances are larger by a factor that hardly depends on the state, which the agent's normalisation takes out. What
  is lost is fine structure: of 512 particles, the third neighbour may be far.
- Features are computed for every batch instead of stored: the encoder is fixed, but the agent's running normalisation
  of states moves.
- The state that an action led to, s', is rewarded, not the one it was taken in: the same one step later, except that
  the last state of an episode counts too.
- A perceptron without the layer norm and tanh that end the authors' convolutional encoder: in a bounded space far
  states would look alike.
- The weight decays over a run as over theirs, whatever the run's length. They divide by a running standard deviation,
  then multiply by 0.05 · (1 - 1e-5)^t (`beta` in rad_re3/re3.py), t up to 250,000: 500,000 frames, two an action.
- log(1 + distance) as in the paper; their code takes the distance itself in RAD.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from curiobench.methods.checks import Sees, check_option, check_positive
from curiobench.methods.learned import LearnedReward, perceptron
from curiobench.methods.neighbours import neighbour_distances
from curiobench.methods.reward import Transitions

UPDATES_AN_EPOCH = 500
"""Of the authors' 250,000, when a run has 500 epochs."""


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
    """What it sees of the state: all (full; the paper's), positions of hand and blocks (positions), or of the blocks
    alone (blocks). Most of the distance between full states is that between angles and angular velocities."""

    def __post_init__(self) -> None:
        check_positive(self, "k", "particles", "beta", "hidden", "features")
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
