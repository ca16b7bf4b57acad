"""The hybrid policy mechanism (Han et al. 2023, doi 10.3389/fnbot.2023.1089270, sections 4.2 and 4.3), for any reward.

Curiosity only decides which data is collected. The policy that is evaluated never learns from intrinsic reward.

    Q_ext(s, a, g)     twin critics on r_ext alone: y = r_ext + gamma · (min_k Q'_k - alpha_d · log pi_d),  a_d' ~ pi_d
    Q_int(s, a)        on r_int alone, bootstrapped with a_c' ~ pi_c; see q_int.py
    pi_d, to exploit   SAC on Q_d = min_k Q_k                                                              (Eq. 14)
    pi_c, to explore   SAC on Q_c = min_k Q_k + tau · n_PopArt(Q_int)                                      (Eq. 13)
    collecting         a_d if Q_c(s, a_c, g) < Q_d(s, a_d, g), else a_c; every step, every world           (Eq. 15)
    evaluation         pi_d, its mode

What the paper leaves open, and what we chose:

- "Q_ext" in Q_c and Q_d, also in Eq. 15, is the minimum of the twin critics. Both policies maximise it.
- Q_ext has SAC's entropy of pi_d in its bootstrap (if `entropy_in_targets`), and Q_int has no entropy. V_c and V_d in
  Eq. 15 have no entropy of their own.
- Both policies share their noise, and pi_c starts as a copy of pi_d. This changes neither loss. Eq. 15 then compares
  actions of the same draw: if Q_int is flat, its sign decides and not the draw. With tau = 0 both policies stay
  bitwise equal, and the agent is SAC on r_ext.
- Each policy has its own temperature. One Adam trains all weights.
- tau is fixed. With `adaptive_tau`, which the paper names as future work, it follows the spreads of Q_int and Q_ext
  over actions. How far pi_c can differ from pi_d depends on these spreads, not on the size of the values.
- A method's term in the policy's loss (DAC's) goes to pi_c, and its `PolicyView` shows pi_c. In pi_d the term would
  bring back the distraction that the mechanism removes.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from curiobench.methods.agents.agent import LearningAgent
from curiobench.methods.agents.learner import Learner, Step
from curiobench.methods.agents.losses import Losses, Metrics, critic_loss, policy_losses
from curiobench.methods.agents.pairs import PairInputs, PairLayout
from curiobench.methods.agents.q_int import MEMBERS, IntrinsicValues
from curiobench.methods.agents.settings import HybridConfig, SACConfig
from curiobench.methods.reward import Batch, IntrinsicReward

EXPLOIT, EXPLORE = 0, 1
"""Positions of pi_d and pi_c in tensors with one entry per policy."""
PROBE_STATES, PROBE_ACTIONS = 64, 16
"""Number of states, and of random actions in each, over which the spreads of Q_ext and Q_int are measured."""
TAU_RANGE = (1e-2, 1e3)
"""Smallest and largest factor of tau under `adaptive_tau`."""


class HybridAgent(LearningAgent):
    """SAC with an exploiting and an exploring policy. Its learner has both policies, and Q_ext as its critics."""

    def __init__(
        self,
        layout: PairLayout,
        config: SACConfig,
        generator: torch.Generator,
        method: IntrinsicReward,
        hybrid: HybridConfig | None = None,
    ) -> None:
        """
        Args:
            layout: columns of blocks and predicate bits in observations and goals.
            config: settings of both policies and all critics; tau weighs Q_int.
            generator: as in `SAC`.
            method: the curiosity method.
            hybrid: settings of the mechanism; its defaults if None.
        """
        self.hybrid = hybrid = hybrid or HybridConfig()
        self.learner = Learner(layout, config, generator, method, n_policies=2)
        self.intrinsic_values = IntrinsicValues(layout, config, hybrid.popart_rate, generator)
        self.learner.prepare(self.losses, intrinsic_values=self.intrinsic_values)
        self._explores_by = MEMBERS.index(hybrid.q_int_normalisation)
        self._exploited = self._acted = 0
        self._measured: dict[str, float] = {}
        self._probe: Tensor | None = None  # rows of `BatchBuffers`

    @torch.no_grad()
    def act(
        self, observation: np.ndarray, achieved_goal: np.ndarray, desired_goal: np.ndarray, deterministic: bool = False
    ) -> np.ndarray:
        """As `LearningAgent.act`. Eq. 15 chooses pi_d's or pi_c's action for each world; the mode is pi_d's."""
        learner = self.learner
        inputs = learner.encode(observation, achieved_goal, desired_goal)
        if deterministic:
            return learner.actor(inputs)[0][EXPLOIT].tanh().cpu().numpy()
        actions, _ = learner.actor.sample(inputs, learner.noise(len(observation), learner.layout.action_size))
        value_d, value_c = self._values(inputs, actions)
        exploit = value_c < value_d
        self._exploited += int(exploit.sum())
        self._acted += len(exploit)
        return torch.where(exploit.unsqueeze(1), actions[EXPLOIT], actions[EXPLORE]).cpu().numpy()

    def _values(self, inputs: PairInputs, actions: Tensor) -> Tensor:
        """Q_d(s, a_d, g) and Q_c(s, a_c, g), stacked (2, N), of actions (2, N, A)."""
        values = self.learner.critics(inputs, actions).min(0).values
        of_explorer = self.intrinsic_values(inputs.state, actions[EXPLORE:])[self._explores_by, 0]
        values[EXPLORE] += self.learner.required_curiosity.tau * of_explorer
        return values

    @torch.no_grad()
    def q_int(self, observation: np.ndarray, action: np.ndarray) -> dict[str, np.ndarray]:
        """Q_int of given actions, for inspection.

        Args:
            observation: (N, D), raw.
            action: (N, A) in [-1, 1].

        Returns:
            "popart" and "zscore", the two normalised values (N,); "raw", the PopArt value in the unit of r_int.
        """
        no_goal = np.zeros((len(observation), self.learner.layout.goal_size))
        state = self.learner.encode(observation, no_goal, no_goal).state
        values = self.intrinsic_values(state, self.learner.tensor(action).unsqueeze(0))[:, 0]
        found = dict(zip(MEMBERS, values, strict=True))
        found["raw"] = self.intrinsic_values.popart.denormalise(found["popart"])
        return {name: value.cpu().numpy() for name, value in found.items()}

    def update(self, batch: Batch, epoch: int = 0) -> Metrics:
        """As `LearningAgent.update`, with the metrics of `_measure`."""
        metrics = super().update(batch, epoch)
        if self._acted:
            self._measure(batch)
        device = self.learner.device
        return metrics | {name: torch.tensor(value, device=device) for name, value in self._measured.items()}

    def losses(self, step: Step) -> Losses:
        """Losses of all critics and, if they are updated, of both policies and their temperatures.

        Each loss trains only its own weights: the policies' losses pass gradients through the critics to the actions,
        but not to the critics' weights. Metrics: those of `SAC.losses`, for Q_ext and pi_d; explorer_policy_loss,
        explorer_entropy, explorer_temperature (and explorer_temperature_loss), for pi_c; those of
        `IntrinsicValues.loss`.
        """
        learner, (target, target_int) = self.learner, self._targets(step)
        stored, *own = learner.critics(step.inputs, step.actions(), trained=1).unbind(1)
        stored_int, *own_int = self.intrinsic_values(step.inputs.state, step.actions(EXPLORE), trained=1).unbind(1)
        found = {"critics": critic_loss(stored, target), "q_int": self.intrinsic_values.loss(stored_int, target_int)}
        if step.sample is not None:
            own[EXPLORE] = own[EXPLORE] + learner.required_curiosity.tau * own_int[0][self._explores_by]
            added = learner.policy_term(step, step.sample[0][EXPLORE])
            for policy, name, term in ((EXPLOIT, "", None), (EXPLORE, "explorer_", added)):
                of_policy = own[policy], step.sample[1][policy], learner.log_alpha[policy]
                found |= policy_losses(*of_policy, learner.target_entropy, term, name)
        return found

    @torch.no_grad()
    def _targets(self, step: Step) -> tuple[Tensor, Tensor]:
        """Targets of Q_ext (B,) and of both Q_int (2, B)."""
        learner, next_inputs = self.learner, step.next_inputs
        actions, log_probs = learner.actor.sample(next_inputs, step.next_noise)
        next_values = learner.target_critics(next_inputs, actions[:EXPLORE]).squeeze(1)
        target = learner.bootstrapped(step.batch.reward, next_values, log_probs[EXPLOIT], learner.log_alpha[EXPLOIT])
        assert step.intrinsic is not None  # there is a method
        target_int = self.intrinsic_values.targets(next_inputs.state, actions[EXPLORE], *step.intrinsic)
        if learner.device.type == "cpu":  # before PopArt writes them into weights
            learner.check({"target of q_int": target_int.sum()})
        return target, self.intrinsic_values.adapt(target_int)

    @torch.no_grad()
    def _measure(self, batch: Batch) -> None:
        """Measure share_exploitation (pi_d's share of the steps), two action spreads and tau, once per collection.

        q_ext_action_spread and q_int_action_spread: standard deviations of Q_ext and of tau · Q_int over random actions
        in one state, mean over states of the first batch. The policies can differ only if the second is not much
        smaller than the first.
        """
        if self._probe is None:
            self._probe = self.learner.buffers(batch).rows[:1, :PROBE_STATES].clone()
        generator = torch.Generator().manual_seed(0)  # the same actions each time
        shape = (PROBE_ACTIONS, self._probe.shape[1], self.learner.layout.action_size)
        tried = torch.rand(shape, generator=generator).to(self.learner.device) * 2.0 - 1.0
        (inputs,) = self.learner.encoder.encode_rows(self._probe)
        q_ext = self.learner.critics(inputs, tried).min(0).values
        q_int = self.learner.required_curiosity.tau * self.intrinsic_values(inputs.state, tried)[self._explores_by]
        self._measured = {
            "share_exploitation": self._exploited / self._acted,
            "q_ext_action_spread": q_ext.std(0, correction=0).mean().item(),
            "q_int_action_spread": q_int.std(0, correction=0).mean().item(),
            "tau": self.learner.required_curiosity.tau,
        }
        self._exploited = self._acted = 0
        if self.hybrid.adaptive_tau:
            self._steer(self._measured["q_ext_action_spread"], self._measured["q_int_action_spread"])

    def _steer(self, of_q_ext: float, of_q_int: float) -> None:
        """Move log tau by the share `tau_rate` towards the value that gives the spreads the ratio `spread_ratio`.

        The ratio is that of the spread of tau · Q_int to the spread of Q_ext.
        """
        if of_q_ext > 0 and of_q_int > 0:
            step = self.hybrid.spread_ratio * of_q_ext / of_q_int
            curiosity, (low, high) = self.learner.required_curiosity, TAU_RANGE
            curiosity.scale = min(max(curiosity.scale * step**self.hybrid.tau_rate, low), high)

    def state_dict(self) -> dict[str, Any]:
        """As `LearningAgent.state_dict`, with the counts of actions, and the measurements with their states."""
        counts = {"exploited": self._exploited, "acted": self._acted, "measured": dict(self._measured)}
        return super().state_dict() | counts | {"probe": None if self._probe is None else self._probe.clone()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """As `LearningAgent.load_state_dict`."""
        super().load_state_dict(state)
        self._exploited, self._acted, self._measured = state["exploited"], state["acted"], dict(state["measured"])
        self._probe = None if state["probe"] is None else state["probe"].to(self.learner.device, copy=True)
