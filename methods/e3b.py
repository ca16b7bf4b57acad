"""E3B, exploration via elliptical episodic bonuses (Henaff et al. 2022, arXiv 2210.05805).

It rewards states that are new within the episode:

    phi(s)   features that let a network infer the action (ICM's inverse model)
    C_t    = ridge · I + sum over i = 0 … t of phi(s_i) phi(s_i)ᵀ          over the episode's states up to s_t
    r_int  = phi(s_{t+1})ᵀ C_t⁻¹ phi(s_{t+1})
    loss   = mean squared error of the inferred action

The bonus generalises visit counts to continuous states: with one-hot features it is 1 / (visits + ridge).

Differences from the authors' code (facebookresearch/e3b), which works with IMPALA:

- C_t is computed from the stored episode for each sampled transition, with the present features. Theirs is updated
  while the episode is collected, with the features at that time.
- MLPs on the agent's normalised state.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from curiobench.methods.checks import check_positive
from curiobench.methods.learned import InverseFeatures, LearnedReward, adam, descend
from curiobench.methods.reward import Transitions, given


@dataclass(frozen=True)
class E3BConfig:
    """Settings of E3B."""

    ridge: float = 0.1
    """Added to the diagonal of C; the authors'."""
    hidden: int = 128
    """Units in the hidden layer of each network."""
    features: int = 16
    """Length of phi."""
    learning_rate: float = 1e-3
    """Adam's learning rate; the agent's."""

    def __post_init__(self) -> None:
        check_positive(self, "ridge", "hidden", "features", "learning_rate")


class E3B(LearnedReward):
    """The elliptical episodic bonus."""

    Config = E3BConfig
    uses_episode = True
    _STATEFUL = ("phi", "optimiser")

    def __init__(self, state_size: int, action_size: int, config: E3BConfig, generator: torch.Generator) -> None:
        self.config = config
        self.phi = InverseFeatures(state_size, action_size, config.hidden, config.features, generator)
        self.optimiser = adam([self.phi], config.learning_rate)

    @torch.no_grad()
    def reward(self, transitions: Transitions) -> Tensor:
        """r_int (B,)."""
        features = self.phi(given(transitions.episode_states, "episode_states"))  # (B, T + 1, F)
        place = torch.arange(features.shape[1], device=features.device)
        before = place <= given(transitions.step, "step").unsqueeze(1)
        visited = (features * before.unsqueeze(2)).double()  # in float32 C becomes singular if nothing moves
        ridge = self.config.ridge * torch.eye(features.shape[2], dtype=torch.float64, device=features.device)
        covariance = visited.mT @ visited + ridge
        reached = self.phi(transitions.next_state).unsqueeze(2).double()
        whitened = torch.linalg.solve_triangular(torch.linalg.cholesky(covariance), reached, upper=False)
        return whitened.square().sum((1, 2)).float()

    def update(self, transitions: Transitions) -> dict[str, Tensor]:
        """One step of the features. Metrics: e3b_inverse_loss, before that step."""
        loss = self.phi.loss(*self.phi.of(transitions), transitions.action)
        descend(self.optimiser, loss)
        return {"e3b_inverse_loss": loss.detach()}
