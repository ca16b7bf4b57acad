"""NewMethod, a curiosity method for curiobench: the formula comes first, in plain text.

    model  m(s, a)   trained to predict s'
    r_int = mean over dimensions of (m(s, a) - s')²
    loss  = mean over the batch of r_int

What stands here is a working example. Replace reward and update by your idea, then

    curiobench check new_method:NewMethod
    curiobench train --method new_method:NewMethod --task stack2 --preset smoke --out runs/new_method

and with the hybrid policy mechanism, `--method new_method:NewMethod+hm`.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from curiobench.methods.checks import check_positive
from curiobench.methods.learned import LearnedReward, adam, descend, perceptron
from curiobench.methods.reward import Transitions


@dataclass(frozen=True)
class NewMethodConfig:
    """Settings. Each becomes a flag, `--method.hidden 64`; the line under it is the flag's help."""

    hidden: int = 128
    """Units in the model's hidden layer."""
    learning_rate: float = 1e-3
    """Adam's learning rate."""

    def __post_init__(self) -> None:
        check_positive(self, "hidden", "learning_rate")


class NewMethod(LearnedReward):
    """What is rewarded, and why that should lead somewhere."""

    Config = NewMethodConfig

    # The attributes that checkpoints keep. Each has state_dict and load_state_dict: networks, optimisers, moments. For
    # anything else (a counter, a memory of states) write these two methods, as methods/counts.py does.
    _STATEFUL = ("model", "optimiser")

    def __init__(self, state_size: int, action_size: int, config: NewMethodConfig, generator: torch.Generator) -> None:
        # Draw all random numbers from `generator`: a run is then a function of its seed. torch.nn.Linear's own initial
        # weights come from torch's global generator, so use `perceptron`, or torch.nn.init with this generator.
        self.model = perceptron([state_size + action_size, config.hidden, state_size], generator)
        self.optimiser = adam([self.model], config.learning_rate)

    def error(self, transitions: Transitions) -> Tensor:
        """Mean squared error (B,) of the model; states are normalised, (B, D), actions in [-1, 1], (B, A)."""
        predicted = self.model(torch.cat([transitions.state, transitions.action], dim=1))
        return (predicted - transitions.next_state).square().mean(1)

    @torch.no_grad()
    def reward(self, transitions: Transitions) -> Tensor:
        """r_int (B,). Its scale does not matter, the agent normalises it. Nothing may change in here."""
        return self.error(transitions)

    def update(self, transitions: Transitions) -> dict[str, Tensor]:
        """One step of the model, after this batch was rewarded. Metrics, scalar tensors, go to progress.csv."""
        loss = self.error(transitions).mean()
        descend(self.optimiser, loss)  # reaches the optimiser's own weights and nothing else
        return {"new_method_loss": loss.detach()}
