"""RND, random network distillation (Burda et al. 2018, arXiv 1810.12894): rewards errors in imitating a network.

    target    f(s')    fixed, random
    predictor f^(s')   trained to imitate it, one hidden layer deeper
    r_int = mean over features of (f(s') - f^(s'))²
    loss  = mean over the batch of r_int

In states that the agent has often visited, the predictor has learned the target's outputs, and the reward is small.
This does not require predictable transitions, so noise attracts RND less than ICM. Noise that never repeats stays
novel.

Differences from the authors' code (openai/random-network-distillation), which works on images with PPO:

- MLPs on the agent's normalised state, clipped to ±5 like theirs, instead of convolutions. Their predictor has two
  more layers than the target, ours one, because depth costs time and inputs are small.
- ReLU instead of the leaky ReLU in their convolutions.
- The intrinsic reward has no value function and no discount of its own; the agent normalises and adds it.
- The predictor learns from the complete batch; theirs from a random share of it if there are many environments.
- Neither uses batch normalisation: in train mode the target would change with the batch.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from curiobench.methods.checks import Sees, check_option, check_positive
from curiobench.methods.learned import LearnedReward, adam, descend, perceptron
from curiobench.methods.reward import Transitions


@dataclass(frozen=True)
class RNDConfig:
    """Settings of RND."""

    hidden: int = 128
    """Units in each hidden layer of target and predictor."""
    features: int = 64
    """Outputs of target and predictor; the paper has 512, for images."""
    learning_rate: float = 1e-4
    """Adam's learning rate of the predictor; the paper's."""
    sees: Sees = "full"
    """Part of the state that it gets: all (full; the paper's), positions of hand and blocks (positions), or of the
    blocks alone (blocks). Most of the distance between full states is that of angles and angular velocities."""

    def __post_init__(self) -> None:
        check_positive(self, "hidden", "features", "learning_rate")
        check_option(self, "sees", Sees)


class RND(LearnedReward):
    """Random network distillation."""

    Config = RNDConfig
    _STATEFUL = ("target", "predictor", "optimiser")

    def __init__(self, state_size: int, action_size: int, config: RNDConfig, generator: torch.Generator) -> None:
        self.sees = config.sees
        hidden, features = config.hidden, config.features
        self.target = perceptron([state_size, hidden, features], generator).requires_grad_(False)
        self.predictor = perceptron([state_size, hidden, hidden, features], generator)
        self.optimiser = adam([self.predictor], config.learning_rate)

    def error(self, next_state: Tensor) -> Tensor:
        """Mean squared error (B,) of the predictor at states (B, D)."""
        return (self.target(next_state) - self.predictor(next_state)).square().mean(1)

    @torch.no_grad()
    def reward(self, transitions: Transitions) -> Tensor:
        """r_int (B,): the predictor's error at s'."""
        return self.error(transitions.next_state)

    def update(self, transitions: Transitions) -> dict[str, Tensor]:
        """One step of the predictor. Metrics: rnd_loss, its mean error before that step."""
        loss = self.error(transitions.next_state).mean()
        descend(self.optimiser, loss)
        return {"rnd_loss": loss.detach()}
