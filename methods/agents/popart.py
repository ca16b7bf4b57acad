"""PopArt: a value network whose targets are normalised while its outputs keep their meaning.

Van Hasselt et al. 2016 (arXiv 1602.07714); Hessel et al. 2018 (arXiv 1809.04474). The network's last layer gives
n = (Q - mean) / scale, with running statistics of the targets y. A batch of targets moves them,

    mean'     = mean + b · (mean of y - mean)
    variance' = (1 - b) · (variance + b · (mean of y - mean)²) + b · (variance of y)
    scale'    = sqrt(variance'),    b = rate / (1 - (1 - rate)^t) in the t-th update

and the last layer is rescaled, so that Q = mean + scale · n stays what it was ("preserve outputs precisely"):

    weight' = weight · scale / scale'
    bias'   = (scale · bias + mean - mean') / scale'

The network then learns (y - mean') / scale'. Its gradient never sees the scale of y.

The variance is that of van Hasselt et al., (1 - b) · E[y²] + b · (mean of y²) less mean'², written so that a mean far
above the spread costs no digits. Their correction b of the bias towards the initial statistics makes the first update
take over the batch's own. Statistics decay, rather than counting all targets alike, because the values of a policy that
learns move away from where they began. The default rate is that of Hessel et al.
"""

from collections.abc import Iterable

import torch
from torch import Tensor


class PopArt:
    """Statistics of targets, in float64, and the layers that are rescaled when they move.

    Several layers may share the statistics: a value network and its target network must, for a weighted mean of their
    weights means something only where both count in the same unit.
    """

    def __init__(
        self,
        layers: Iterable[tuple[Tensor, Tensor]],
        rate: float = 3e-4,
        min_scale: float = 1e-6,
        device: str | torch.device = "cpu",
    ) -> None:
        """
        Args:
            layers: weight and bias of each output layer, changed in place.
            rate: share of a batch in the statistics, in (0, 1]; they forget over about 1 / rate updates.
            min_scale: lower bound of the scale, in the targets' unit; a constant target must not divide by zero.
            device: where the statistics live.

        Raises:
            ValueError: rate or min_scale out of range.
        """
        if not 0 < rate <= 1:
            raise ValueError(f"rate is {rate}; it must lie in (0, 1]")
        if not min_scale > 0:
            raise ValueError(f"min_scale is {min_scale}; it must be positive")
        self.layers, self.rate, self.min_scale = list(layers), rate, min_scale
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
        """Move the statistics towards those of targets (...), at least one, and rescale the layers."""
        mean, scale = self.mean.clone(), self.scale
        targets = targets.to(torch.float64)
        self.weight += self.rate * (1 - self.weight)
        rate = self.rate / self.weight
        delta = targets.mean() - mean
        self.mean += rate * delta
        self.variance.copy_((1 - rate) * (self.variance + rate * delta**2) + rate * targets.var(correction=0))
        self._rescale(mean, scale)

    def _rescale(self, old_mean: Tensor, old_scale: Tensor) -> None:
        """Make every layer's denormalised output what it was under the old statistics."""
        new_scale = self.scale
        for weight, bias in self.layers:
            weight.mul_(old_scale / new_scale)
            bias.mul_(old_scale / new_scale).add_((old_mean - self.mean) / new_scale)

    def normalise(self, values: Tensor) -> Tensor:
        """(values - mean) / scale, float64, in the unit of the layers' outputs. Never updates."""
        return (values.to(torch.float64) - self.mean) / self.scale

    def denormalise(self, outputs: Tensor) -> Tensor:
        """mean + scale · outputs, float64, in the unit of the targets."""
        return self.mean + self.scale * outputs.to(torch.float64)

    def state_dict(self) -> dict[str, Tensor]:
        """Copies of the statistics, each (), float64. The layers belong to their networks and are not among them."""
        return {name: getattr(self, name).clone() for name in ("mean", "variance", "weight")}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Restore what `state_dict` gave, without rescaling: the layers are restored with their networks."""
        for name in ("mean", "variance", "weight"):
            getattr(self, name).copy_(state[name])
