"""DAC, diversity actor-critic (Han and Sung 2021, arXiv 2006.01419): rewards actions that are new in a state.

DAC maximises the entropy of a mixture instead of the policy's: q_mix = alpha · pi + (1 - alpha) · q, where q is the
distribution of the actions in the replay buffer. A network R estimates alpha · pi / q_mix:

    ratio loss  = - mean over the batch of alpha · log R(s, a_pi) + (1 - alpha) · log(1 - R(s, a)),  a_pi ~ pi, a stored
    r_int       = - log q_mix(a | s) = log R(s, a) - log alpha - log pi(a | s),  clipped to ± dim(a)
    policy loss = temperature · (log pi(a_pi | s) - log R(s, a_pi)) - Q                 (`policy_loss_term` is - log R)

R is a binary classifier between actions of pi and stored actions. R = alpha where both have the same density.
`adapt_alpha` makes alpha(s) = 0.5 + 0.49 · sigmoid(network(s)), which minimises

    alpha loss = mean of alpha · (log R(s, a_pi) - log alpha - log pi(a_pi | s) - c) + (1 - alpha) · r_int(s, a)

with c = -control · dim(a) and R held fixed: alpha rises above 0.5 where actions of pi are less surprising than stored
ones by more than control · dim(a).

Goals and relabelling. DAC regularises the entropy of actions and does not score states. It is the one method here that
gets goals as input: pi(a | s, g) depends on g, so R has to depend on g too. With hindsight, g is the relabelled goal.
Then q is the distribution of actions over transitions that were *relabelled* with g, and the reward of a transition
changes with its goal. The paper has no goals.

Differences from the authors' code (seungyulhan/dac), which extends SAC with a state value function:

- In their code the entropy of q_mix is part of the value. It has two parts: the policy's, alpha · (log R - log alpha -
  log pi), and the buffer's, (1 - alpha) · r_int. Here the reward is r_int, normalised and weighted like the reward of
  any other method. The targets contain SAC's - log pi only if the agent has `entropy_in_targets`.
- The policy's part is weighted by the agent's temperature in both. In their code alpha(s) is a further factor. With
  the fixed 0.5 it only changes the scale. With `adapt_alpha` the term here does not follow alpha(s).
- R is an MLP whose output x is a logit: log R = -softplus(-x) needs no small constant inside a logarithm.
- The policy's term uses R after its update on the same batch.
"""

import math
from dataclasses import dataclass
from functools import reduce

import torch
from torch import Tensor
from torch.nn import functional as F

from curiobench.methods.checks import check_positive
from curiobench.methods.learned import LearnedReward, adam, descend, perceptron
from curiobench.methods.reward import PolicyView, Transitions, given


@dataclass(frozen=True)
class DACConfig:
    """Settings of DAC."""

    alpha: float = 0.5
    """Share of the policy in the mixture, in (0, 1); the paper's where it is fixed. Not used with adapt_alpha."""
    adapt_alpha: bool = False
    """Learn alpha(s) in (0.5, 0.99) in place of the fixed one."""
    control: float = 2.0
    """How strongly the adapted alpha is pulled to 0.5: c = -control · dim(a); the authors' code's."""
    hidden: int = 128
    """Units in each of two hidden layers; the authors' code has 256."""
    learning_rate: float = 3e-4
    """Adam's learning rate of ratio and alpha; the authors' code's."""

    def __post_init__(self) -> None:
        check_positive(self, "hidden", "learning_rate")
        if not 0 < self.alpha < 1:
            raise ValueError(f"alpha is {self.alpha}; a share lies in (0, 1), without its ends")
        if not math.isfinite(self.control):
            raise ValueError(f"control is {self.control}; it must be finite")


class DAC(LearnedReward):
    """Diversity actor-critic."""

    uses_policy = True
    Config = DACConfig

    def __init__(
        self, state_size: int, action_size: int, config: DACConfig, generator: torch.Generator, goal_size: int
    ) -> None:
        self.config, self.action_size = config, action_size
        hidden = [config.hidden, config.hidden, 1]
        self.ratio = perceptron([state_size + goal_size + action_size, *hidden], generator, out_gain=0.1)
        self.alpha_network = perceptron([state_size, *hidden], generator, out_gain=0.1) if config.adapt_alpha else None
        networks = {"ratio": self.ratio}
        if self.alpha_network is not None:
            networks["alpha_network"] = self.alpha_network
        self.optimiser = adam(networks.values(), config.learning_rate)
        self._STATEFUL = (*networks, "optimiser")

    def logit(self, state: Tensor, desired_goal: Tensor, action: Tensor) -> Tensor:
        """x (B,) with R = sigmoid(x), of states (B, D), goals (B, bits) and actions (B, A)."""
        return self.ratio(torch.cat([state, desired_goal, action], dim=1)).squeeze(1)

    def log_alpha(self, state: Tensor) -> Tensor:
        """log alpha(s): (B,), or () where it is fixed."""
        if self.alpha_network is None:
            return state.new_tensor(math.log(self.config.alpha))
        return (0.5 + 0.49 * self.alpha_network(state).squeeze(1).sigmoid()).log()

    def surprise(self, logit: Tensor, log_alpha: Tensor, log_prob: Tensor) -> Tensor:
        """-log q_mix (B,) of actions with these logits of R and log pi (B,)."""
        return F.logsigmoid(logit) - log_alpha - log_prob

    def clipped_surprise(self, logit: Tensor, log_alpha: Tensor, log_prob: Tensor) -> Tensor:
        """`surprise` of stored actions, clipped to ± dim(a), because the density of pi may be almost 0 there."""
        return self.surprise(logit, log_alpha, log_prob).clamp(-self.action_size, self.action_size)

    @torch.no_grad()
    def reward(self, transitions: Transitions) -> Tensor:
        """r_int (B,) of the stored actions. Raises ValueError without a view of the policy."""
        policy = given(transitions.policy, "policy")
        logit = self.logit(transitions.state, policy.desired_goal, transitions.action)
        return self.clipped_surprise(logit, self.log_alpha(transitions.state), policy.stored_log_prob)

    def policy_loss_term(self, transitions: Transitions, desired_goal: Tensor, action: Tensor) -> Tensor:
        """-log R(s, a) (B,), whose gradient reaches the policy through its action."""
        return -F.logsigmoid(self.logit(transitions.state, desired_goal, action))

    def update(self, transitions: Transitions) -> dict[str, Tensor]:
        """One step of R, and of alpha(s) if it is adapted.

        Metrics: dac_ratio_loss; dac_ratio_policy and dac_ratio_stored, the means of R at the policy's and at stored
        actions; dac_alpha, the mean of alpha; dac_alpha_loss if it is adapted.
        """
        policy, state = given(transitions.policy, "policy"), transitions.state
        actions = torch.cat([policy.action, transitions.action])
        own, stored = self.logit(state.repeat(2, 1), policy.desired_goal.repeat(2, 1), actions).chunk(2)
        log_alpha = self.log_alpha(state)
        alpha = log_alpha.detach().exp()
        ratio_loss = -(alpha * F.logsigmoid(own) + (1 - alpha) * F.logsigmoid(-stored)).mean()
        losses = {"dac_ratio_loss": ratio_loss}
        if self.alpha_network is not None:
            losses["dac_alpha_loss"] = self.alpha_loss(log_alpha, own.detach(), stored.detach(), policy)
        descend(self.optimiser, reduce(torch.add, losses.values()))
        means = {"dac_ratio_policy": own.sigmoid(), "dac_ratio_stored": stored.sigmoid(), "dac_alpha": alpha}
        return {name: value.detach() for name, value in losses.items()} | {
            n: v.detach().mean() for n, v in means.items()
        }

    def alpha_loss(self, log_alpha: Tensor, own: Tensor, stored: Tensor, policy: PolicyView) -> Tensor:
        """Loss () of alpha(s), from log alpha and the logits of R at the policy's and at stored actions, each (B,)."""
        alpha = log_alpha.exp()
        of_policy = self.surprise(own, log_alpha, policy.log_prob)
        of_buffer = self.clipped_surprise(stored, log_alpha, policy.stored_log_prob)
        return (alpha * of_policy + (1 - alpha) * of_buffer + alpha * self.config.control * self.action_size).mean()
