"""Computes the `PolicyView` of a tanh-squashed Gaussian policy for methods with `uses_policy`."""

import math

import torch
from torch import Tensor

from curiobench.methods.reward import PolicyView

LARGEST_ACTION = 1.0 - 1e-6
"""Stored actions are clipped to ± this. float32 can round tanh to ±1, where the density is infinite."""


def squashed_log_prob(mean: Tensor, log_std: Tensor, action: Tensor) -> Tensor:
    """log pi(a) (B,) of given actions a = tanh(u), u normal with these mean and log-std, all (B, A).

    log pi(a) = sum of log N(atanh a) - log(1 - a²), the inverse of `networks.squashed_gaussian`.
    """
    action = action.clamp(-LARGEST_ACTION, LARGEST_ACTION)
    error = (action.atanh() - mean) * (-log_std).exp()
    log_normal = -0.5 * error.square() - log_std - 0.5 * math.log(2 * math.pi)
    return (log_normal - torch.log1p(-action.square())).sum(-1)


@torch.no_grad()
def view_policy(
    distribution: tuple[Tensor, Tensor], sample: tuple[Tensor, Tensor], stored_action: Tensor, desired_goal: Tensor
) -> PolicyView:
    """A view without gradients.

    Args:
        distribution: the policy's mean and log-std before squashing, each (B, A).
        sample: actions (B, A) drawn from it, squashed, and their log-densities (B,).
        stored_action: (B, A) actions of the batch.
        desired_goal: (B, bits) that the policy pursues.
    """
    action, log_prob = (tensor.detach() for tensor in sample)
    return PolicyView(desired_goal, action, log_prob, squashed_log_prob(*distribution, stored_action))
