"""RND, random network distillation (Burda et al. 2018, arXiv 1810.12894): novel is where imitation still fails.

    target    f(s')    fixed, random
    predictor f^(s')   trained to imitate it, one hidden layer deeper
    r_int = mean over features of (f(s') - f^(s'))²
    loss  = mean over the batch of r_int

Where the agent has been often, the predictor has learned the target's outputs, and the reward is small. Transitions
need not be predictable for that, so noise fascinates it less than it does ICM; but noise that never repeats stays
novel.

Differences from the authors' code (openai/random-network-distillation), which works on images with PPO:

- Perceptrons on the agent's normalised state, clipped to ±5 as theirs, in place of convolutions. Their predictor has
  two more layers than the target, ours one: depth costs time, and inputs are small.
- Rectifiers where they have leaky ones in the convolutions.
- The intrinsic reward has no value function and no discount of its own; the agent normalises and adds it.
- The predictor learns from the whole batch; theirs from a random share of it when environments are many.
- No batch normalisation, there as here: in train mode it would move the target with the batch.
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
    """What it sees of the state: all (full; the paper's), positions of hand and blocks (positions), or of the blocks
    alone (blocks). Most of the distance between full states is that between angles and angular velocities."""

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
