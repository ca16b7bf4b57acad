"""PopArt: normalises the targets of a value network and keeps its denormalised outputs unchanged.

Van Hasselt et al. 2016 (arXiv 1602.07714); Hessel et al. 2018 (arXiv 1809.04474). The network's last layer gives
n = (Q - mean) / scale, with running statistics of the targets y. A batch of targets updates them,

    mean'     = mean + b · (mean of y - mean)
    variance' = (1 - b) · (variance + b · (mean of y - mean)²) + b · (variance of y)
    scale'    = sqrt(variance'),    b = rate / (1 - (1 - rate)^t) in the t-th update

and the last layer is rescaled, so that Q = mean + scale · n stays what it was ("preserve outputs precisely"):

    weight' = weight · scale / scale'
    bias'   = (scale · bias + mean - mean') / scale'

The network then learns (y - mean') / scale', so its gradient does not depend on the scale of y.

The variance is that of van Hasselt et al., (1 - b) · E[y²] + b · (mean of y²) minus mean'², written in a form
without cancellation if the mean is much larger than the spread. Their bias correction b makes the statistics after the
first update those of its batch. Old statistics decay, because values change while the policy learns. The default rate
is that of Hessel et al.
"""

from collections.abc import Iterable

import torch
from torch import Tensor


class PopArt:
    """Statistics of targets, in float64, and the layers that are rescaled when they change.

    Several layers can share the statistics. A value network and its target network have to, because a weighted mean of
    their weights requires the same unit.
    """

    min_scale = 1e-6
    """Lower bound of the scale, in the targets' unit; a constant target must not divide by zero."""

    def __init__(
        self,
        layers: Iterable[tuple[Tensor, Tensor]],
        rate: float = 3e-4,
        device: str | torch.device = "cpu",
    ) -> None:
        """
        Args:
            layers: weight and bias of each output layer, changed in place.
            rate: share of a batch in the statistics, in (0, 1]; they forget over about 1 / rate updates.
            device: device of the statistics.
        """
        self.layers, self.rate = list(layers), rate
        self.mean = torch.zeros((), dtype=torch.float64, device=device)
        self.variance = torch.ones((), dtype=torch.float64, device=device)
        self.weight = torch.zeros((), dtype=torch.float64, device=device)
        """1 - (1 - rate)^t: how much of the statistics is data."""

    @property
    def scale(self) -> Tensor:
        """() standard deviation of the targets, at least `min_scale`; 1 before the first update."""
        return self.variance.sqrt().clamp(min=self.min_scale)

    @torch.no_grad()
    def update(self, targets: Tensor) -> None:
        """Update the statistics by targets (...), at least one, and rescale the layers."""
        mean, scale = self.mean.clone(), self.scale
        targets = targets.to(torch.float64)
        self.weight += self.rate * (1 - self.weight)
        rate = self.rate / self.weight
        delta = targets.mean() - mean
        self.mean += rate * delta
        self.variance.copy_((1 - rate) * (self.variance + rate * delta**2) + rate * targets.var(correction=0))
        new_scale = self.scale
        for weight, bias in self.layers:  # denormalised outputs stay what they were
            weight.mul_(scale / new_scale)
            bias.mul_(scale / new_scale).add_((mean - self.mean) / new_scale)

    def normalise(self, values: Tensor) -> Tensor:
        """(values - mean) / scale, float64, in the unit of the layers' outputs. Never updates."""
        return (values.to(torch.float64) - self.mean) / self.scale

    def denormalise(self, outputs: Tensor) -> Tensor:
        """mean + scale · outputs, float64, in the unit of the targets."""
        return self.mean + self.scale * outputs.to(torch.float64)

    def state_dict(self) -> dict[str, Tensor]:
        """Copies of the statistics, each (), float64. Layers are saved with their networks."""
        return {name: getattr(self, name).clone() for name in ("mean", "variance", "weight")}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Restore a `state_dict` without rescaling; layers are restored with their networks."""
        for name in ("mean", "variance", "weight"):
            getattr(self, name).copy_(state[name])
