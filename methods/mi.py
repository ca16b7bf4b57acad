"""MI, decoupled mutual information (Han et al. 2023, doi 10.3389/fnbot.2023.1089270): rare, predictable states.

The mutual information of the next state S' and the state-action pair C is H(S') - H(S'|C). Its two parts are
estimated separately and added with separate weights:

    curiosity         r_H = log(m + mean over the k nearest particles p of ‖s' - p‖)                      (Eq. 9)
    conservativeness  r_C = log(m + D_G(s' | s, a)),  D_G a Gaussian, factored over dimensions           (Eq. 10)
    r_int  = r_H + lambda · r_C                                                                          (Eq. 11)
    lambda = min(1 - xi^epoch, beta) · sigma_H / sigma_C
    loss   = - mean over the batch of log D_G(s' | s, a)                                    (maximum likelihood)

A transition has a high reward if few other states are similar to its next state, and if the model predicted that next
state. The paper argues that a falling block is as rare as a lifted one, but that its landing is harder to predict.
(docs/probes.md measures whether that is so.) lambda is 0 in epoch 0, so that the agent first explores. sigma_H and
sigma_C are running standard deviations of the r_H and r_C of past batches.

A deviation: the particles are drawn uniformly from the replay instead of taken from the minibatch. The minibatch is
balanced over goals: in it a state of a rarely reached goal has as many neighbours as one of a common goal, and is not
more novel.

What the paper leaves open, and what we chose:

- D_G overflows in many dimensions, so r_C is computed as log m + softplus(log D_G - log m): softplus(log D_G) for
  m = 1. It is about log D_G where the model is sharp, and 0 where log D_G is well below 0. A state that the model
  does not know only loses this bonus, and curiosity decides.
- Mean and log-std come from one MLP. The log-std is squashed into a range, and precision beyond its lower end does not
  count. Otherwise a dimension that never changes would be infinitely sharp and outweigh all others. The log-std is not
  clipped, because the gradient vanishes at a clipped bound and an overconfident model could not recover.
- The network predicts s' and not a change of s. A predicted change would be accurate from the start for everything
  that does not move, even in states that the model was never trained on.
- sigma_C in lambda is at least LEAST_SPREAD.
- The "reparameterisation trick" that the paper mentions is not needed: nothing is sampled.
- The paper's list of settings calls xi "gamma" once.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from curiobench.methods.checks import Sees, check_at_least, check_option, check_positive, check_share
from curiobench.methods.learned import LearnedReward, adam, descend, perceptron
from curiobench.methods.moments import RunningMoments
from curiobench.methods.neighbours import neighbour_distances
from curiobench.methods.reward import Transitions

LEAST_SPREAD = 0.1
"""Lower bound of sigma_C in lambda, in nats. While D_G is still flat, r_C and sigma_C are 0. Without the bound, the
first state that it predicts would be worth thousands of others. With a trained D_G, sigma_C is tens of nats."""


@dataclass(frozen=True)
class MIConfig:
    """Settings of MI. Those without a source are ours; the paper does not print them."""

    k: int = 3
    """Nearest neighbours whose distances are averaged; the paper's."""
    particles: int = 512
    """States of the replay among which they are searched."""
    m: float = 1.0
    """Added inside both logarithms; the paper's."""
    xi: float = 0.99
    """Conservativeness grows as 1 - xi^epoch, in epochs of a run of 500; the paper's, where xi lies in (0, 1)."""
    beta: float = 0.7
    """Largest weight of conservativeness, in [0, 1]; the paper's."""
    hidden: int = 128
    """Units in each of the density network's two hidden layers."""
    learning_rate: float = 1e-3
    """Adam's learning rate of the density network; the agent's."""
    min_log_std: float = -3.0
    """Lower end of the density's log-std: errors below 5 % of a dimension's usual spread count as none."""
    max_log_std: float = 2.0
    """Upper end of the log-std. A larger standard deviation than the clipped range of states makes no difference."""
    sees: Sees = "full"
    """Part of the state that it gets: all (full; the paper's), positions of hand and blocks (positions), or of the
    blocks alone (blocks). Most of the distance between full states is that of angles and angular velocities."""

    def __post_init__(self) -> None:
        check_positive(self, "k", "m", "particles", "hidden", "learning_rate")
        check_at_least(self, self.k, "particles")
        check_option(self, "sees", Sees)
        if not 0 < self.xi < 1:
            raise ValueError(f"xi is {self.xi}; it must lie in (0, 1), without its ends")
        check_share(self, "beta")
        if not -math.inf < self.min_log_std < self.max_log_std < math.inf:
            ends = f"min_log_std is {self.min_log_std} and max_log_std {self.max_log_std}"
            raise ValueError(f"{ends}; they must be finite, and the first below the second")


class MI(LearnedReward):
    """Decoupled mutual information."""

    Config = MIConfig
    _STATEFUL = ("density", "optimiser", "moments")

    def __init__(self, state_size: int, action_size: int, config: MIConfig, generator: torch.Generator) -> None:
        self.config, self.sees, self.n_particles = config, config.sees, config.particles
        sizes = [state_size + action_size, config.hidden, config.hidden, 2 * state_size]
        self.density = perceptron(sizes, generator, out_gain=0.1)
        self.optimiser = adam([self.density], config.learning_rate)
        self.moments = RunningMoments((2,), min_std=1e-8, device=generator.device)  # of r_H and r_C
        self._last: tuple[Transitions, Tensor] | None = None

    def curiosity(self, transitions: Transitions) -> Tensor:
        """r_H (B,). Computed once for a batch that is passed to `reward` and then to `update`."""
        if self._last is None or self._last[0] is not transitions:
            distance = neighbour_distances(transitions.next_state, transitions.particles, self.config.k).mean(1)
            self._last = transitions, (self.config.m + distance).log()
        return self._last[1]

    def log_density(self, transitions: Transitions) -> Tensor:
        """log D_G(s' | s, a) (B,)."""
        mean, raw = self.density(torch.cat([transitions.state, transitions.action], dim=1)).chunk(2, dim=1)
        low, high = self.config.min_log_std, self.config.max_log_std
        log_std = low + 0.5 * (high - low) * (raw.tanh() + 1)
        error = (transitions.next_state - mean) * (-log_std).exp()
        return -(0.5 * error.square() + log_std).sum(1) - 0.5 * math.log(2 * math.pi) * mean.shape[1]

    def conservativeness(self, log_density: Tensor) -> Tensor:
        """r_C (B,) from log D_G (B,)."""
        log_m = math.log(self.config.m)
        return log_m + F.softplus(log_density - log_m)

    def weight(self, epoch: int) -> Tensor:
        """lambda () in this epoch, from the statistics of past batches."""
        of_curiosity, of_conservativeness = self.moments.std
        share = min(1 - self.config.xi**epoch, self.config.beta)
        return share * of_curiosity / of_conservativeness.clamp(min=LEAST_SPREAD)

    @torch.no_grad()
    def reward(self, transitions: Transitions) -> Tensor:
        """r_int (B,). Raises ValueError if there are fewer than k particles."""
        conservativeness = self.conservativeness(self.log_density(transitions))
        curiosity = self.curiosity(transitions)
        return curiosity + self.weight(transitions.epoch).to(curiosity.dtype) * conservativeness

    def update(self, transitions: Transitions) -> dict[str, Tensor]:
        """One step of the density network. Adds the batch to the statistics.

        Metrics, with the values in this batch's reward: mi_curiosity and mi_conservativeness, the means of r_H and r_C;
        mi_weight, lambda; mi_density_loss, the mean of -log D_G.
        """
        log_density = self.log_density(transitions)
        curiosity, conservativeness = self.curiosity(transitions), self.conservativeness(log_density.detach())
        weight, loss = self.weight(transitions.epoch), -log_density.mean()
        self.moments.update(torch.stack([curiosity, conservativeness], dim=1))
        descend(self.optimiser, loss)
        return {
            "mi_curiosity": curiosity.mean(),
            "mi_conservativeness": conservativeness.mean(),
            "mi_weight": weight,
            "mi_density_loss": loss.detach(),
        }
