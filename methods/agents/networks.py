"""Goal-conditioned actor and twin critics over pairs of blocks.

Each network has two inputs: a context (the hand, and for a critic also the action) and a set of pairs of blocks. It
pools the pairs by Deep Sets, after DECSTR (Akakzia et al. 2021, arXiv 2006.07185), or by attention. Differences from
DECSTR: phi ends in `hidden` units, not in three times the size of its input; layers may be normalised; pairs may be
symmetric; and statistics of the inputs are shared by blocks.
"""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from curiobench.methods.agents.deepsets import DeepSets
from curiobench.methods.agents.pair_attention import PairAttention
from curiobench.methods.agents.pairs import PairEncoder, PairInputs
from curiobench.methods.agents.settings import SACConfig

LOG_STD_RANGE = (-5.0, 2.0)
LOG_2 = math.log(2.0)
LOG_SQRT_2_PI = 0.5 * math.log(2.0 * math.pi)
LARGEST_ACTION = 1.0 - 1e-6
"""Stored actions are clipped to ± this. float32 can round tanh to ±1, where the density is infinite."""


def make_net(
    config: SACConfig, members: int, context_size: int, pair_size: int, out_size: int, generator: torch.Generator
) -> DeepSets | PairAttention:
    """`members` networks of the kind and size in the config; all kinds have the same `forward`."""
    kinds: dict[str, type[DeepSets | PairAttention]] = {"deep_sets": DeepSets, "pair_attention": PairAttention}
    return kinds[config.network](
        members, context_size, pair_size, config.hidden, out_size, config.layer_norm, generator
    )


class Actor(nn.Module):
    """P tanh-squashed diagonal Gaussian policies pi(a | s, g) with the same initial weights, evaluated together."""

    def __init__(
        self, encoder: PairEncoder, config: SACConfig, generator: torch.Generator, n_policies: int = 1
    ) -> None:
        super().__init__()
        outputs = 2 * encoder.layout.action_size
        self.net = make_net(config, 1, encoder.context_size, encoder.pair_size, outputs, generator)
        if n_policies > 1:
            for name, weights in list(self.net.named_parameters()):
                setattr(self.net, name, nn.Parameter(weights.detach().repeat(n_policies, 1, 1)))

    def forward(self, inputs: PairInputs) -> tuple[Tensor, Tensor]:
        """Mean and log standard deviation, each (P, B, A), of the actions before squashing."""
        mean, log_std = self.net(inputs.context.unsqueeze(0), inputs.pairs)[:, 0].chunk(2, dim=-1)
        return mean, log_std.clamp(*LOG_STD_RANGE)

    def sample(self, inputs: PairInputs, noise: Tensor) -> tuple[Tensor, Tensor]:
        """Actions (P, B, A) in (-1, 1) and log-densities (P, B), all from the same standard normal noise (B, A)."""
        mean, log_std = self(inputs)
        return squashed_gaussian(mean, log_std, noise)


class TwinCritics(nn.Module):
    """Two action values Q(s, a, g), evaluated together."""

    def __init__(self, encoder: PairEncoder, config: SACConfig, generator: torch.Generator) -> None:
        super().__init__()
        context = encoder.context_size + encoder.layout.action_size
        self.net = make_net(config, 2, context, encoder.pair_size, 1, generator)

    def forward(self, inputs: PairInputs, actions: Tensor, trained: int | None = None) -> Tensor:
        """Values (2, K, B) of K actions in each state (K, B, A).

        Gradients of the first `trained` actions' values reach the weights; those of the others reach the actions. By
        default all reach the weights.
        """
        context = inputs.context.expand(len(actions), -1, -1)
        return self.net(torch.cat([context, actions], dim=2), inputs.pairs, trained).squeeze(-1)


def squashed_gaussian(mean: Tensor, log_std: Tensor, noise: Tensor) -> tuple[Tensor, Tensor]:
    """a = tanh(u), u = mean + std · noise: actions (…, A) and log pi(a) (…), from three arrays (…, A).

    log pi(a) = sum of log N(u) - log(1 - tanh(u)²) (Haarnoja et al. 2018, appendix C). The last term is taken as
    2 (log 2 - u - softplus(-2u)), which stays finite where tanh saturates.
    """
    pre_squash = torch.addcmul(mean, log_std.exp(), noise)
    # what depends on the weights, and what does not
    varying = (F.softplus(-2.0 * pre_squash) + pre_squash).mul(2.0) - log_std
    constant = -0.5 * noise.square() - (LOG_SQRT_2_PI + 2.0 * LOG_2)
    return pre_squash.tanh(), (varying + constant).sum(-1)


def squashed_log_prob(mean: Tensor, log_std: Tensor, action: Tensor) -> Tensor:
    """log pi(a) (B,) of given actions a = tanh(u), u normal with these mean and log-std, all (B, A).

    log pi(a) = sum of log N(atanh a) - log(1 - a²), the inverse of `squashed_gaussian`.
    """
    action = action.clamp(-LARGEST_ACTION, LARGEST_ACTION)
    error = (action.atanh() - mean) * (-log_std).exp()
    log_normal = -0.5 * error.square() - log_std - LOG_SQRT_2_PI
    return (log_normal - torch.log1p(-action.square())).sum(-1)
