"""RIDE, rewarding impact-driven exploration (Raileanu and Rocktäschel 2020, arXiv 2002.12292).

    phi(s)   features trained by an inverse and a forward model (ICM's networks)
    r_int  = ‖phi(s') - phi(s)‖ / sqrt(N_ep(s'))
    loss   = inverse loss + forward_weight · ½ ‖f(phi(s), a) - phi(s')‖²

N_ep(s') counts the visits to s' in the episode, including this one. The agent is rewarded for changing the state, and
less each time it returns to an earlier one.

Differences from the authors' code (facebookresearch/impact-driven-exploration), which works on grids with IMPALA:

- States are continuous and never repeat. N_ep counts steps with the same predicates (semantic configuration) as s'.
- Their weights are 10 for the forward and 0.1 for the inverse loss. These losses have other scales than those here.
- The forward loss trains phi, as in their code. This may shrink features, see icm.py.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from curiobench.methods.checks import check_positive
from curiobench.methods.learned import InverseFeatures, LearnedReward, adam, descend, perceptron
from curiobench.methods.reward import Transitions, given


@dataclass(frozen=True)
class RIDEConfig:
    """Settings of RIDE."""

    forward_weight: float = 0.1
    """Weight of the forward loss; the inverse loss has 1."""
    hidden: int = 128
    """Units in the hidden layer of each network."""
    features: int = 32
    """Length of phi."""
    learning_rate: float = 1e-3
    """Adam's learning rate; the agent's."""

    def __post_init__(self) -> None:
        check_positive(self, "forward_weight", "hidden", "features", "learning_rate")


class RIDE(LearnedReward):
    """Change of the features, divided by the square root of the visits in the episode."""

    Config = RIDEConfig
    uses_episode = True
    _STATEFUL = ("phi", "forward", "optimiser")

    def __init__(self, state_size: int, action_size: int, config: RIDEConfig, generator: torch.Generator) -> None:
        self.config = config
        self.phi = InverseFeatures(state_size, action_size, config.hidden, config.features, generator)
        self.forward = perceptron([config.features + action_size, config.hidden, config.features], generator)
        self.optimiser = adam([self.phi, self.forward], config.learning_rate)

    @staticmethod
    def visits(transitions: Transitions) -> Tensor:
        """N_ep(s') (B,), at least 1: number of the episode's steps up to s' with the same predicates as s'."""
        goals = given(transitions.episode_achieved_goals, "episode_achieved_goals")
        same = (goals == given(transitions.next_achieved_goal, "next_achieved_goal").unsqueeze(1)).all(2)
        place = torch.arange(same.shape[1], device=same.device)
        return (same & (place <= given(transitions.step, "step").unsqueeze(1) + 1)).sum(1).clamp(min=1)

    @torch.no_grad()
    def reward(self, transitions: Transitions) -> Tensor:
        """r_int (B,)."""
        features, reached = self.phi.of(transitions)
        return (reached - features).norm(dim=1) / self.visits(transitions).sqrt()

    def update(self, transitions: Transitions) -> dict[str, Tensor]:
        """One step of all networks. Metrics: ride_inverse_loss and ride_forward_loss, both before that step."""
        features, reached = self.phi.of(transitions)
        predicted = self.forward(torch.cat([features, transitions.action], dim=1))
        forward_loss = 0.5 * (predicted - reached).square().sum(1).mean()
        inverse_loss = self.phi.loss(features, reached, transitions.action)
        descend(self.optimiser, inverse_loss + self.config.forward_weight * forward_loss)
        return {"ride_inverse_loss": inverse_loss.detach(), "ride_forward_loss": forward_loss.detach()}
