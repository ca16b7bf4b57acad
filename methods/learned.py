"""What the built-in curiosity methods share: MLPs, one gradient step, saving and restoring."""

import copy
import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn

from curiobench.methods.reward import IntrinsicReward, Transitions


def perceptron(sizes: Sequence[int], generator: torch.Generator, out_gain: float = math.sqrt(2.0)) -> nn.Sequential:
    """An MLP: linear layers of these sizes with ReLU in between.

    It has no normalisation layers, so a reward depends on its transition alone. Weights are orthogonal (Saxe et al.
    2014, arXiv 1312.6120), times √2 before a ReLU, which keeps the scale of activations. Biases are zero.

    Args:
        sizes: inputs, hidden units…, outputs.
        generator: draws the weights, on its device.
        out_gain: scale of the last layer's weights.
    """
    layers: list[nn.Module] = []
    for inputs, outputs in pairwise(sizes):
        # skip_init: the default initialisation would draw from torch's global generator
        layer = nn.utils.skip_init(nn.Linear, inputs, outputs, device=generator.device)
        last = len(layers) == 2 * (len(sizes) - 2)
        nn.init.orthogonal_(layer.weight, out_gain if last else math.sqrt(2.0), generator)
        nn.init.zeros_(layer.bias)
        layers += [layer] if last else [layer, nn.ReLU(inplace=True)]
    return nn.Sequential(*layers)


def adam(networks: Iterable[nn.Module], learning_rate: float) -> torch.optim.Adam:
    """Adam (Kingma and Ba 2015) on all weights of these networks."""
    weights = [weight for network in networks for weight in network.parameters()]
    return torch.optim.Adam(weights, lr=learning_rate, fused=True, capturable=weights[0].is_cuda)


def descend(optimiser: torch.optim.Adam, loss: Tensor) -> None:
    """One optimiser step on `loss` (). Only the optimiser's own weights get gradients."""
    (group,) = optimiser.param_groups
    for weight, gradient in zip(group["params"], torch.autograd.grad(loss, group["params"]), strict=True):
        weight.grad = gradient
    optimiser.step()


class InverseFeatures(nn.Module):
    """Features phi(s) that let a network infer the action from phi(s) and phi(s') (Pathak et al. 2017).

    They represent what the agent can influence. The encoder and the inverse network have one hidden layer each.
    """

    def __init__(
        self, state_size: int, action_size: int, hidden: int, features: int, generator: torch.Generator
    ) -> None:
        super().__init__()
        self.encoder = perceptron([state_size, hidden, features], generator)
        self.inverse = perceptron([2 * features, hidden, action_size], generator, out_gain=1.0)

    def forward(self, state: Tensor) -> Tensor:
        """phi (..., features) of states (..., D)."""
        return self.encoder(state)

    def of(self, transitions: Transitions) -> tuple[Tensor, Tensor]:
        """phi(s) and phi(s'), each (B, features), in one pass."""
        return self(torch.cat([transitions.state, transitions.next_state])).chunk(2)

    def loss(self, features: Tensor, next_features: Tensor, action: Tensor) -> Tensor:
        """Mean over batch and actions of the squared error of the action inferred from phi(s) and phi(s')."""
        inferred = self.inverse(torch.cat([features, next_features], dim=1))
        return (inferred - action).square().mean()


class LearnedReward(IntrinsicReward):
    """A method whose state is in the attributes named in `_STATEFUL`: networks, optimisers, moments.

    The generator is not one of them, because it belongs to the agent, which saves it.
    """

    _STATEFUL: tuple[str, ...]

    def state_dict(self) -> dict[str, Any]:
        """A copy of the method's state."""
        return copy.deepcopy({name: getattr(self, name).state_dict() for name in self._STATEFUL})

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a `state_dict`. Raises KeyError, ValueError or RuntimeError if sizes differ."""
        for name in self._STATEFUL:
            getattr(self, name).load_state_dict(copy.deepcopy(state[name]))  # optimisers keep references to it
