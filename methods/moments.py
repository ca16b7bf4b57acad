"""Running mean and standard deviation of observations, goals and rewards."""

import torch
from torch import Tensor


class RunningMoments:
    """Mean and standard deviation of all samples passed to `update`, or of recent ones, in float64.

    Batches are merged by the parallel formula of Chan, Golub and LeVeque (1983), which loses no precision if the mean
    is much larger than the spread:

        delta = mean_b - mean,  n' = n + n_b
        mean' = mean + delta · n_b / n'
        m2'   = m2 + m2_b + delta² · n · n_b / n'          variance = m2 / n (population)

    With a window of w updates, n and m2 are multiplied by 1 - 1/w before each merge. Mean and variance are then
    exponentially weighted: each sample has the weight (1 - 1/w)^(updates since). The weights add up to n, so there is
    no bias at the start.

    `normalise` never updates: evaluation and reward normalisation use past statistics only.
    """

    clip = 5.0
    """Normalised values are clipped to ± this."""

    def __init__(
        self,
        shape: tuple[int, ...] = (),
        min_std: float = 1e-2,
        window: int | None = None,
        device: str | torch.device = "cpu",
    ) -> None:
        """
        Args:
            shape: shape of one sample; `()` for scalars such as rewards.
            min_std: lower bound of the standard deviation, in the samples' unit. It keeps values that hardly vary from
                being amplified, and avoids a division by zero after a single sample.
            window: w, at least 1; None keeps all history.
            device: device of the statistics.
        """
        self.shape, self.min_std, self.window = shape, min_std, window
        self.count = torch.zeros((), dtype=torch.float64, device=device)
        self.mean = torch.zeros(shape, dtype=torch.float64, device=device)
        self.m2 = torch.zeros(shape, dtype=torch.float64, device=device)

    @property
    def std(self) -> Tensor:
        """(*shape) population standard deviation, at least `min_std`; 1 before the first sample."""
        variance = self.m2 / self.count.clamp(min=1.0)
        return torch.where(self.count > 0, variance.sqrt().clamp(min=self.min_std), 1.0)

    @property
    def inverse_std(self) -> Tensor:
        """(*shape) 1 / std."""
        return self.std.reciprocal()

    @torch.no_grad()
    def update(self, samples: Tensor) -> None:
        """Merge samples (..., *shape) into the statistics. An empty batch changes nothing.

        Raises ValueError if the trailing shape differs from `shape`.
        """
        if samples.shape[samples.dim() - len(self.shape) :] != self.shape:
            raise ValueError(f"samples have shape {tuple(samples.shape)}; expected (..., {self.shape})")
        batch = samples.to(torch.float64).reshape(-1, *self.shape)
        if len(batch) == 0:
            return
        if self.window is not None:
            self.count *= 1.0 - 1.0 / self.window
            self.m2 *= 1.0 - 1.0 / self.window
        batch_mean = batch.mean(0)
        delta = batch_mean - self.mean
        total = self.count + len(batch)
        self.mean += delta * (len(batch) / total)
        self.m2 += (batch - batch_mean).square().sum(0) + delta.square() * (self.count * len(batch) / total)
        self.count.copy_(total)

    def normalise(self, samples: Tensor) -> Tensor:
        """(samples - mean) / std, clipped to ±clip, in the samples' own float type. Never updates."""
        centred = (samples - self.mean) * self.inverse_std
        return centred.clamp(-self.clip, self.clip).to(samples.dtype)

    def state_dict(self) -> dict[str, Tensor]:
        """Copies of count (), mean and m2 (*shape), float64."""
        return {"count": self.count.clone(), "mean": self.mean.clone(), "m2": self.m2.clone()}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Restore a `state_dict`. Raises ValueError if a shape differs."""
        for name in ("count", "mean", "m2"):
            own = getattr(self, name)
            if state[name].shape != own.shape:
                raise ValueError(f"saved {name} has shape {tuple(state[name].shape)}; expected {tuple(own.shape)}")
            own.copy_(state[name])
