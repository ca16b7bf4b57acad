"""The episodic bonus of NGU, never give up (Badia et al. 2020, arXiv 2002.06038).

It rewards states that are far from all earlier states of the episode:

    phi(s)   features that let a network infer the action
    d_i²     squared distance of phi(s_{t+1}) to the i-th nearest of phi(s_0) … phi(s_t), i = 1 … k
    d_m²     running mean of these distances
    K_i    = epsilon / (max(d_i² / d_m² - cluster, 0) + epsilon)
    s      = sqrt(sum of K_i) + c
    r_int  = 1 / s, or 0 where s > most

Differences from the paper:

- The paper multiplies this bonus by RND's error over all of training. That factor is left out; `rnd` is a separate
  method.
- If an episode has fewer than k earlier states, the sum is over those.
- MLPs on the agent's normalised state; the paper's features come from a network trained on images.
- d_m² is an exponential moving average over batches. Its decay here is 1 - 1/100 per update; the paper does not say.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from curiobench.methods.checks import check_positive
from curiobench.methods.learned import InverseFeatures, LearnedReward, adam, descend
from curiobench.methods.moments import RunningMoments
from curiobench.methods.reward import Transitions, given

WINDOW = 100
"""Window of the running mean of distances, in updates."""


@dataclass(frozen=True)
class NGUConfig:
    """Settings of NGU's episodic bonus."""

    k: int = 10
    """Nearest steps of the episode; the paper's."""
    epsilon: float = 1e-3
    """Constant of the kernel; the paper's."""
    cluster: float = 8e-3
    """Relative squared distance below which steps count as the same; the paper's."""
    c: float = 1e-3
    """Added to the similarity; the paper's."""
    most: float = 8.0
    """Similarity above which there is no reward; the paper's."""
    hidden: int = 128
    """Units in the hidden layer of each network."""
    features: int = 32
    """Length of phi; the paper's."""
    learning_rate: float = 1e-3
    """Adam's learning rate; the agent's."""

    def __post_init__(self) -> None:
        check_positive(self, "k", "epsilon", "cluster", "c", "most", "hidden", "features", "learning_rate")


class NGU(LearnedReward):
    """The episodic bonus alone."""

    Config = NGUConfig
    uses_episode = True
    _STATEFUL = ("phi", "optimiser", "distances")

    def __init__(self, state_size: int, action_size: int, config: NGUConfig, generator: torch.Generator) -> None:
        self.config = config
        self.phi = InverseFeatures(state_size, action_size, config.hidden, config.features, generator)
        self.optimiser = adam([self.phi], config.learning_rate)
        self.distances = RunningMoments((), window=WINDOW, device=generator.device)
        self._last: tuple[Transitions, Tensor] | None = None

    def nearest(self, transitions: Transitions) -> Tensor:
        """d_i² (B, k) in ascending order; infinite where there are fewer than k earlier states.

        Computed once for a batch that is passed to `reward` and then to `update`.
        """
        if self._last is None or self._last[0] is not transitions:
            self._last = transitions, self._nearest(transitions)
        return self._last[1]

    @torch.no_grad()
    def _nearest(self, transitions: Transitions) -> Tensor:
        features = self.phi(given(transitions.episode_states, "episode_states"))
        squared = (features - self.phi(transitions.next_state).unsqueeze(1)).square().sum(2)
        place = torch.arange(squared.shape[1], device=squared.device)
        squared = squared.masked_fill(place > given(transitions.step, "step").unsqueeze(1), torch.inf)
        return squared.topk(min(self.config.k, squared.shape[1]), dim=1, largest=False).values

    @torch.no_grad()
    def reward(self, transitions: Transitions) -> Tensor:
        """r_int (B,)."""
        config, nearest = self.config, self.nearest(transitions)
        of_batch = nearest[nearest.isfinite()].double().mean()  # before the first update
        usual = torch.where(self.distances.count > 0, self.distances.mean, of_batch).clamp(min=1e-8).float()
        relative = (nearest / usual - config.cluster).clamp(min=0)
        similarity = (config.epsilon / (relative + config.epsilon)).sum(1).sqrt() + config.c
        return torch.where(similarity > config.most, 0.0, 1 / similarity)

    def update(self, transitions: Transitions) -> dict[str, Tensor]:
        """One step of the features. Adds the distances to d_m². Metrics: ngu_inverse_loss, ngu_distance (d_m²)."""
        nearest = self.nearest(transitions)
        self.distances.update(nearest[nearest.isfinite()])
        loss = self.phi.loss(*self.phi.of(transitions), transitions.action)
        descend(self.optimiser, loss)
        self._last = None  # the features have changed
        return {"ngu_inverse_loss": loss.detach(), "ngu_distance": self.distances.mean.clone()}
