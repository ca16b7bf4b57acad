"""Goal-conditioned soft actor-critic (Haarnoja et al. 2018, arXiv 1812.05905) over pairs of blocks.

    y          = r + gamma · (min_k Q'_k(s', a', g) - alpha · log pi(a' | s', g)),   a' ~ pi
                 (the last term only with `entropy_in_targets`)
    critics    : mean over the batch, summed over k, of ½ (Q_k(s, a, g) - y)²
    policy     : mean of alpha · log pi(a | s, g) - min_k Q_k(s, a, g),              a ~ pi
    temperature: mean of -log alpha · (log pi(a | s, g) + target entropy)            (only if tuned)
    r          = r_ext + tau · n(r_int)                                              (r_ext alone without a method)
                 (tau times the method's factor, which is 1 except for RE3)

Every transition bootstraps, because episodes end by time limit only. Targets are not clipped. With r_ext in {0, 1} the
reward's part of Q lies in [0, 1 / (1 - gamma)], but the entropy's part has no lower bound and r_int may be negative.
"""

import numpy as np
import torch
from torch import Tensor

from curiobench.methods.agents.agent import LearningAgent
from curiobench.methods.agents.learner import Learner, Step
from curiobench.methods.agents.losses import Losses, critic_loss, policy_losses
from curiobench.methods.agents.pairs import PairLayout
from curiobench.methods.agents.settings import SACConfig
from curiobench.methods.reward import IntrinsicReward


class SAC(LearningAgent):
    """Soft actor-critic on r. One policy collects episodes and is evaluated."""

    def __init__(
        self, layout: PairLayout, config: SACConfig, generator: torch.Generator, method: IntrinsicReward | None = None
    ) -> None:
        """
        Args:
            layout: columns of blocks and predicate bits in observations and goals.
            config: settings.
            generator: source of initial weights, exploration and noise in the losses; its device is the agent's.
            method: the curiosity method; None uses the extrinsic reward alone.
        """
        self.learner = Learner(layout, config, generator, method)
        self.learner.prepare(self.losses)

    @torch.no_grad()
    def act(
        self, observation: np.ndarray, achieved_goal: np.ndarray, desired_goal: np.ndarray, deterministic: bool = False
    ) -> np.ndarray:
        """As `LearningAgent.act`; the mode is tanh(mean)."""
        learner = self.learner
        (mean,), (log_std,) = learner.actor(learner.encode(observation, achieved_goal, desired_goal))
        if not deterministic:
            mean = torch.addcmul(mean, log_std.exp(), learner.noise(*mean.shape))
        return mean.tanh().cpu().numpy()

    def losses(self, step: Step) -> Losses:
        """Losses of critics and, if it is updated, of the policy and temperature. Adds r_int to the batch's reward.

        Metrics: critic_loss, q (of stored actions), target_q, policy_loss, entropy (of the squashed policy),
        temperature, and temperature_loss if it is tuned.
        """
        learner = self.learner
        if step.intrinsic is not None:
            step.batch.reward.add_(step.intrinsic[1], alpha=learner.required_curiosity.tau)
        stored, *own = learner.critics(step.inputs, step.actions(), trained=1).unbind(1)
        found = {"critics": critic_loss(stored, self._target(step))}
        if step.sample is not None:
            (log_prob,), term = step.sample[1], learner.policy_term(step, step.sample[0][-1])
            found |= policy_losses(own[0], log_prob, learner.log_alpha, learner.target_entropy, term)
        return found

    @torch.no_grad()
    def _target(self, step: Step) -> Tensor:
        """Bootstrapped targets (B,) of both critics."""
        learner = self.learner
        actions, (log_prob,) = learner.actor.sample(step.next_inputs, step.next_noise)
        next_values = learner.target_critics(step.next_inputs, actions).squeeze(1)
        return learner.bootstrapped(step.batch.reward, next_values, log_prob, learner.log_alpha)
