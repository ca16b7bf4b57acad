"""Disagreement (Pathak et al. 2019, arXiv 1906.04161): rewards transitions on which models disagree.

    models   f_k(s, a), k = 1 … K, each from its own random weights
    r_int  = mean over dimensions of the variance over k of f_k(s, a)
    loss   = sum over k of the mean of ‖f_k(s, a) - s'‖² / D over a batch without every K-th transition

Noise does not stay novel: all models learn its mean and then agree.

Differences from the authors' code (pathak22/exploration-by-disagreement), which works on images with PPO:

- The models predict the normalised next state itself; theirs predict features of images.
- Each model leaves out part of the batch. In their code this is a random fifth, here every K-th transition, a
  different one for each model. The order within each part of a batch is random.
- MLPs with two hidden layers; theirs are residual.
- They differentiate the bonus with respect to the policy, as their paper proposes for short horizons. Here it is a
  reward like the others.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from curiobench.methods.checks import check_at_least, check_positive
from curiobench.methods.learned import LearnedReward, adam, descend, perceptron
from curiobench.methods.reward import Transitions


@dataclass(frozen=True)
class DisagreementConfig:
    """Settings of disagreement."""

    models: int = 5
    """K, at least 2; the paper's."""
    hidden: int = 128
    """Units in each of a model's two hidden layers."""
    learning_rate: float = 1e-3
    """Adam's learning rate; the agent's."""

    def __post_init__(self) -> None:
        check_positive(self, "hidden", "learning_rate")
        check_at_least(self, 2, "models")


class Disagreement(LearnedReward):
    """Variance over an ensemble of forward models."""

    Config = DisagreementConfig
    _STATEFUL = ("models", "optimiser")

    def __init__(
        self, state_size: int, action_size: int, config: DisagreementConfig, generator: torch.Generator
    ) -> None:
        self.config = config
        sizes = [state_size + action_size, config.hidden, config.hidden, state_size]
        self.models = torch.nn.ModuleList(perceptron(sizes, generator) for _ in range(config.models))
        self.optimiser = adam([self.models], config.learning_rate)

    def predictions(self, transitions: Transitions) -> Tensor:
        """f_k(s, a) (K, B, D)."""
        inputs = torch.cat([transitions.state, transitions.action], dim=1)
        return torch.stack([model(inputs) for model in self.models])

    @torch.no_grad()
    def reward(self, transitions: Transitions) -> Tensor:
        """r_int (B,)."""
        return self.predictions(transitions).var(0, correction=0).mean(1)

    def update(self, transitions: Transitions) -> dict[str, Tensor]:
        """One step of all models. Metrics: disagreement_loss, the mean over models before that step."""
        errors = (self.predictions(transitions) - transitions.next_state).square().mean(2)
        k, rows = (torch.arange(size, device=errors.device) for size in errors.shape)
        kept = rows % len(k) != k.unsqueeze(1)
        losses = (errors * kept).sum(1) / kept.sum(1)
        descend(self.optimiser, losses.sum())
        return {"disagreement_loss": losses.detach().mean()}
