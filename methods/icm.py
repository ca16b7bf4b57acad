"""ICM, the intrinsic curiosity module (Pathak et al. 2017, arXiv 1705.05363): prediction error as novelty.

    encoder       phi(s)
    inverse model a^ = g(phi(s), phi(s'))       L_I = mean over batch and actions of (a^ - a)²
    forward model f(phi(s), a)                  L_F = mean over the batch of ½ ‖f(phi(s), a) - phi(s')‖²
    r_int = (eta / 2) · ‖f(phi(s), a) - phi(s')‖²
    loss  = (1 - beta) · L_I + beta · L_F

The inverse model trains the encoder to represent what the agent can influence, so that errors about the rest do not
count. In practice some of the rest stays in phi, and what cannot be predicted stays novel forever (the noisy TV).

Differences from the authors' code (pathak22/noreward-rl), which works on images with A3C:

- MLPs on the agent's normalised state; actions are continuous, so the inverse loss is a squared error.
- In their code both losses train phi. Equal features are easy to predict, so L_F shrinks them, and the reward falls
  everywhere, even where nothing was learned. The later large-scale study (Burda et al. 2018, arXiv 1808.04355) stops
  that gradient, and so does the default here: phi learns from the inverse loss alone. The two losses then train
  separate weights, so that with Adam beta hardly matters. `forward_trains_encoder` restores the original.
- Their code multiplies the loss by 10; here the learning rate is the agent's default, 1e-3 = 10 · 1e-4.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from curiobench.methods.checks import check_positive, check_share
from curiobench.methods.learned import InverseFeatures, LearnedReward, adam, descend, perceptron
from curiobench.methods.reward import Transitions


@dataclass(frozen=True)
class ICMConfig:
    """Settings of ICM."""

    eta: float = 0.01
    """Scale of the reward; the authors' code's. No effect in the combined reward, which is normalised."""
    beta: float = 0.2
    """Weight of the forward loss, in [0, 1]; the paper's."""
    forward_trains_encoder: bool = False
    """Let the forward loss train the encoder too, as the authors' code does. Features may then shrink together."""
    hidden: int = 128
    """Units in the hidden layer of each network."""
    features: int = 32
    """Outputs of the encoder."""
    learning_rate: float = 1e-3
    """Adam's learning rate; the paper's, with its factor of 10."""

    def __post_init__(self) -> None:
        check_positive(self, "eta", "hidden", "features", "learning_rate")
        check_share(self, "beta")


class ICM(LearnedReward):
    """The intrinsic curiosity module."""

    Config = ICMConfig
    _STATEFUL = ("phi", "forward", "optimiser")

    def __init__(self, state_size: int, action_size: int, config: ICMConfig, generator: torch.Generator) -> None:
        self.config = config
        hidden, features = config.hidden, config.features
        self.phi = InverseFeatures(state_size, action_size, hidden, features, generator)
        self.forward = perceptron([features + action_size, hidden, features], generator)
        self.optimiser = adam([self.phi, self.forward], config.learning_rate)

    def forward_error(self, features: Tensor, action: Tensor, next_features: Tensor) -> Tensor:
        """½ ‖f(phi(s), a) - phi(s')‖² (B,)."""
        predicted = self.forward(torch.cat([features, action], dim=1))
        return 0.5 * (predicted - next_features).square().sum(1)

    @torch.no_grad()
    def reward(self, transitions: Transitions) -> Tensor:
        """r_int (B,): eta times the forward model's error."""
        features, next_features = self.phi.of(transitions)
        return self.config.eta * self.forward_error(features, transitions.action, next_features)

    def update(self, transitions: Transitions) -> dict[str, Tensor]:
        """One step of all three networks. Metrics: icm_inverse_loss and icm_forward_loss, both before that step."""
        features, next_features = self.phi.of(transitions)
        inverse_loss = self.phi.loss(features, next_features, transitions.action)
        if not self.config.forward_trains_encoder:
            features, next_features = features.detach(), next_features.detach()
        forward_loss = self.forward_error(features, transitions.action, next_features).mean()
        descend(self.optimiser, (1 - self.config.beta) * inverse_loss + self.config.beta * forward_loss)
        return {"icm_inverse_loss": inverse_loss.detach(), "icm_forward_loss": forward_loss.detach()}
