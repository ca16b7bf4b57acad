"""Soft actor-critic's targets and losses (Haarnoja et al. 2018, arXiv 1812.05905), as pure functions of a batch."""

from torch import Tensor, addcmul

Metrics = dict[str, Tensor]
"""Scalar tensors by name."""
Losses = dict[str, tuple[Tensor, Metrics]]
"""Losses () by name, each with its metrics."""


def bootstrapped_target(
    reward: Tensor, next_values: Tensor, gamma: float, next_log_prob: Tensor, alpha: Tensor | None
) -> Tensor:
    """y (B,) from rewards (B,), target values (2, B) and log-densities (B,) of the next actions.

    Without `alpha` the policy's entropy is not part of the value.
    """
    value = next_values.min(0).values
    if alpha is not None:
        value = addcmul(value, alpha, next_log_prob, value=-1)
    return (value * gamma).add_(reward)


def critic_loss(values: Tensor, target: Tensor) -> tuple[Tensor, Metrics]:
    """Squared error of values (2, B), with targets (B,) for both critics or (2, B) for each."""
    loss = 0.5 * (values - target).square().mean(1).sum()
    return loss, {"critic_loss": loss.detach(), "q": values.detach().mean(), "target_q": target.mean()}


def policy_loss(values: Tensor, log_prob: Tensor, alpha: Tensor, term: Tensor | None = None) -> tuple[Tensor, Metrics]:
    """Loss from values (2, B) of the policy's own actions, which carry gradients, and their log-densities (B,).

    A curiosity method's term (B,) is added to the log-densities in the loss, but is not part of the entropy.
    """
    penalty = log_prob if term is None else log_prob + term
    loss = addcmul(-values.min(0).values, alpha, penalty).mean()
    return loss, {"policy_loss": loss.detach(), "entropy": -log_prob.detach().mean(), "temperature": alpha}


def temperature_loss(log_alpha: Tensor, log_prob: Tensor, target_entropy: float) -> tuple[Tensor, Metrics]:
    """Loss from log alpha () and log-densities (B,)."""
    loss = -log_alpha * (log_prob.detach().mean() + target_entropy)
    return loss, {"temperature_loss": loss.detach()}


def policy_losses(
    values: Tensor,
    log_prob: Tensor,
    log_alpha: Tensor,
    target_entropy: float | None,
    term: Tensor | None = None,
    prefix: str = "",
) -> Losses:
    """`policy_loss` and, if there is a target entropy, `temperature_loss`. All names start with `prefix`."""
    found = {"policy": policy_loss(values, log_prob, log_alpha.detach().exp(), term)}
    if target_entropy is not None:
        found["temperature"] = temperature_loss(log_alpha, log_prob, target_entropy)
    return {
        prefix + name: (loss, {prefix + key: value for key, value in metrics.items()})
        for name, (loss, metrics) in found.items()
    }
