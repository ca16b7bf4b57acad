"""The hybrid policy mechanism (Han et al. 2023, doi 10.3389/fnbot.2023.1089270, sections 4.2 and 4.3), for any reward.

Curiosity decides where data comes from, and no more: the policy that is evaluated never learns from it.

    Q_ext(s, a, g)     twin critics on r_ext alone: y = r_ext + gamma · (min_k Q'_k - alpha_d · log pi_d),  a_d' ~ pi_d
    Q_int(s, a)        on r_int alone, bootstrapped with a_c' ~ pi_c; see q_int.py
    pi_d, to exploit   SAC on Q_d = min_k Q_k                                                              (Eq. 14)
    pi_c, to explore   SAC on Q_c = min_k Q_k + tau · n_PopArt(Q_int)                                      (Eq. 13)
    collecting         a_d if Q_c(s, a_c, g) < Q_d(s, a_d, g), else a_c; every step, every world           (Eq. 15)
    evaluation         pi_d, its mode

What the paper leaves open, and what we chose:

- "Q_ext" in Q_c and Q_d, also in Eq. 15, is the lesser of the twin critics, which is what both policies climb.
- Q_ext has SAC's entropy of pi_d in its bootstrap, Q_int none; V_c and V_d in Eq. 15 have no entropy of their own.
- Both policies share their noise, and pi_c starts as a copy of pi_d. Each loss is as it would be with noise of its own,
  Eq. 15 compares like with like (where Q_int is flat, its sign decides and not the draw), and with tau = 0 both stay
  equal to the bit: the agent is then SAC on r_ext.
- Each policy has its own temperature, all weights one Adam.
- tau is fixed. With `adaptive_tau`, which the paper wishes for in its last section, it follows the spreads of Q_int and
  Q_ext over actions: how far pi_c can differ from pi_d depends on these, not on the size of either.
- A method's term in the policy's loss (DAC's) goes to pi_c, and so does its view of the policy: it shapes exploration,
  and in pi_d it would bring back the distraction that the mechanism removes.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from curiobench.methods.agents.capture import StaticBatch
from curiobench.methods.agents.losses import Metrics, critic_loss, policy_loss, temperature_loss
from curiobench.methods.agents.networks import LOG_STD_RANGE, Actor, squashed_gaussian
from curiobench.methods.agents.pairs import PairInputs, PairLayout
from curiobench.methods.agents.q_int import MEMBERS, IntrinsicValues
from curiobench.methods.agents.sac import SAC
from curiobench.methods.agents.settings import HybridConfig, SACConfig
from curiobench.methods.reward import IntrinsicReward, Transitions

EXPLOIT, EXPLORE = 0, 1
"""pi_d and pi_c, wherever a tensor has one entry a policy."""
PROBE_STATES, PROBE_ACTIONS = 64, 16
"""States and random actions in each of them over which the spreads of Q_ext and Q_int are measured."""
TAU_RANGE = (1e-2, 1e3)
"""Ends of the factor of tau under `adaptive_tau`."""


class PolicyPair(nn.Module):
    """pi_d and pi_c, evaluated together; both start as the given actor."""

    def __init__(self, actor: Actor) -> None:
        super().__init__()
        self.net = actor.net
        for name, weights in list(self.net.named_parameters()):
            setattr(self.net, name, nn.Parameter(weights.detach().repeat(2, 1, 1)))

    def forward(self, inputs: PairInputs) -> tuple[Tensor, Tensor]:
        """Mean and log standard deviation, each (2, B, A), of the actions before squashing."""
        mean, log_std = self.net(inputs.context.unsqueeze(0), inputs.pairs)[:, 0].chunk(2, dim=-1)
        return mean, log_std.clamp(*LOG_STD_RANGE)

    def sample(self, inputs: PairInputs, noise: Tensor) -> tuple[Tensor, Tensor]:
        """Actions (2, B, A) and their log-densities (2, B), both from the same standard normal noise (B, A)."""
        return squashed_gaussian(*self(inputs), noise)


class HybridAgent(SAC):
    """SAC on r_ext, whose critics and policy learn from what a second, curious policy collects where it promises more.

    Everything that `SAC` holds once is here the exploiting policy's; `actor` and `log_alpha` hold both policies'.
    """

    _STATEFUL = (*SAC._STATEFUL, "intrinsic_values")

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
            layout: where blocks and predicate bits stand in observations and goals.
            config: settings of both policies and all critics; tau weighs Q_int.
            generator: its device is the agent's.
            method: the curiosity method.
            hybrid: settings of the mechanism; its defaults if None.
        """
        super().__init__(layout, config, generator, method)
        self.hybrid = hybrid = hybrid or HybridConfig()
        self.actor = PolicyPair(self.actor)
        self.log_alpha = nn.Parameter(self.log_alpha.detach().repeat(2))
        self.intrinsic_values = IntrinsicValues(
            layout, config.hidden, config.layer_norm, config.gamma, hybrid.popart_rate, generator
        )
        self._explores_by = MEMBERS.index(hybrid.q_int_normalisation)
        values = self.intrinsic_values
        self._train([*self.actor.parameters(), *self.critics.parameters(), *values.net.parameters()])
        self._targets += values.target_net.parameters()
        self._sources += values.net.parameters()
        self._exploited = self._acted = 0
        self._measured: dict[str, float] = {}
        self._probe: Tensor | None = None  # rows of `StaticBatch`

    @torch.no_grad()
    def act(
        self, observation: np.ndarray, achieved_goal: np.ndarray, desired_goal: np.ndarray, deterministic: bool = False
    ) -> np.ndarray:
        """Actions (N, A) of all worlds at once; arguments as in `SAC.act`.

        Each world's action is pi_d's or pi_c's, by Eq. 15; with `deterministic` the mode of pi_d, and then neither the
        generator nor the count of pi_d's share is touched.
        """
        inputs = self.encoder.encode(*self._tensors(observation, achieved_goal, desired_goal))
        if deterministic:
            return self.actor(inputs)[0][EXPLOIT].tanh().cpu().numpy()
        shape = (len(observation), self.layout.action_size)
        noise = torch.randn(shape, generator=self.generator, device=self.device)
        actions, _ = self.actor.sample(inputs, noise)
        value_d, value_c = self._values(inputs, actions)
        exploit = value_c < value_d
        self._exploited += int(exploit.sum())
        self._acted += len(exploit)
        return torch.where(exploit.unsqueeze(1), actions[EXPLOIT], actions[EXPLORE]).cpu().numpy()

    def _values(self, inputs: PairInputs, actions: Tensor) -> Tensor:
        """Q_d(s, a_d, g) and Q_c(s, a_c, g) together (2, N), of actions (2, N, A)."""
        values = self.critics(inputs, actions).min(0).values
        values[EXPLORE] += (
            self.curiosity.tau * self.intrinsic_values(inputs.state, actions[EXPLORE:])[self._explores_by, 0]
        )
        return values

    @torch.no_grad()
    def q_int(self, observation: np.ndarray, action: np.ndarray) -> dict[str, np.ndarray]:
        """Q_int of given actions, to look at.

        Args:
            observation: (N, D), raw.
            action: (N, A) in [-1, 1].

        Returns:
            "popart" and "zscore", the two normalised values (N,); "raw", the one under PopArt in the unit of r_int.
        """
        no_goal = np.zeros((len(observation), self.layout.goal_size))
        state = self.encoder.encode(*self._tensors(observation, no_goal, no_goal)).state
        values = self.intrinsic_values(state, next(iter(self._tensors(action))).unsqueeze(0))[:, 0]
        found = dict(zip(MEMBERS, values, strict=True))
        found["raw"] = self.intrinsic_values.popart.denormalise(found["popart"])
        return {name: value.cpu().numpy() for name, value in found.items()}

    def _learn(self, batch: StaticBatch, epoch: int, acts: bool) -> Metrics:
        """As `SAC._learn`, whose metrics are pi_d's and Q_ext's here. Beside them: explorer_policy_loss,
        explorer_entropy, explorer_temperature (and explorer_temperature_loss), pi_c's; those of `IntrinsicValues.loss`;
        and what `_measure` finds.
        """
        inputs, next_inputs = self.encoder.encode_rows(batch.rows)
        noise = torch.randn((2, *batch.action.shape), generator=self.generator, device=self.device)
        sample, explorer = None, (None, None)
        if acts or self._shows_policy:
            with torch.set_grad_enabled(acts):
                distributions = self.actor(inputs)
                sample = squashed_gaussian(*distributions, noise[1])
            explorer = [(first[EXPLORE], second[EXPLORE]) for first, second in (distributions, sample)]
        transitions = self.transitions(batch, (inputs.state, next_inputs.state), epoch, *explorer)
        raw, normalised, learned = self.curiosity.learn(transitions)
        targets = self._both_targets(next_inputs, batch.reward, (raw, normalised), noise[0])
        losses, metrics = self._all_losses(inputs, batch, targets, sample if acts else None, transitions)
        self._descend(losses, acts)
        if self._acted:
            self._measure(batch)
        measured = {name: torch.tensor(value, device=self.device) for name, value in self._measured.items()}
        return {"reward": batch.reward.mean()} | learned | metrics | measured

    @torch.no_grad()
    def _both_targets(
        self, next_inputs: PairInputs, reward: Tensor, curiosity: tuple[Tensor, Tensor], noise: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Targets of Q_ext (B,) and of both Q_int (2, B), from r_ext and r_int, raw and z-scored, each (B,)."""
        actions, log_probs = self.actor.sample(next_inputs, noise)
        next_values = self.target_critics(next_inputs, actions[:EXPLORE]).squeeze(1)
        target = self._bootstrapped(reward, next_values, log_probs[EXPLOIT], self.log_alpha[EXPLOIT])
        of_curiosity = self.intrinsic_values.targets(next_inputs.state, actions[EXPLORE], *curiosity)
        if self.device.type == "cpu":  # before PopArt writes them into weights
            self._check({"target of q_int": of_curiosity.sum()})
        return target, self.intrinsic_values.adapt(of_curiosity)

    def _all_losses(
        self,
        inputs: PairInputs,
        batch: StaticBatch,
        targets: tuple[Tensor, Tensor],
        sample: tuple[Tensor, Tensor] | None,
        transitions: Transitions,
    ) -> tuple[dict[str, Tensor], Metrics]:
        """Losses by name, all at the same weights, and metrics; from the policies' actions (2, B, A) and log-densities,
        or None where only the critics learn.

        No loss reaches another's weights: critics pass gradients of the policies' actions on to those actions only.
        """
        actions = batch.action.unsqueeze(0)
        every = actions if sample is None else torch.cat([actions, sample[0]])
        curious = actions if sample is None else torch.cat([actions, sample[0][EXPLORE:]])
        stored, *own = self.critics(inputs, every, trained=1).unbind(1)
        stored_int, *own_int = self.intrinsic_values(inputs.state, curious, trained=1).unbind(1)
        found = {
            "critics": critic_loss(stored, targets[0]),
            "q_int": self.intrinsic_values.loss(stored_int, targets[1]),
        }
        if sample is not None:
            own[EXPLORE] = own[EXPLORE] + self.curiosity.tau * own_int[0][self._explores_by]
            term = self._policy_term(transitions, batch.desired_goal[0], sample[0][EXPLORE])
            found |= self._policy_losses(own, sample[1], (None, term))
        metrics = {name: value for _, of_loss in found.values() for name, value in of_loss.items()}
        return {name: loss for name, (loss, _) in found.items()}, metrics

    def _policy_losses(
        self, values: list[Tensor], log_probs: Tensor, terms: tuple[Tensor | None, Tensor | None]
    ) -> dict[str, tuple[Tensor, Metrics]]:
        """Losses of both policies, with metrics: from values (2, B) of each one's actions, and log-densities (2, B)."""
        found = {}
        for policy, name in ((EXPLOIT, ""), (EXPLORE, "explorer_")):
            alpha = self.log_alpha[policy]
            loss = policy_loss(values[policy], log_probs[policy], alpha.detach().exp(), terms[policy])
            found[f"{name}policy"] = _named(name, loss)
            if self.config.tune_temperature:
                loss = temperature_loss(alpha, log_probs[policy], -float(self.layout.action_size))
                found[f"{name}temperature"] = _named(name, loss)
        return found

    @torch.no_grad()
    def _measure(self, batch: StaticBatch) -> None:
        """Once after each collection: share_exploitation, pi_d's share of its steps, two spreads over actions, and tau.

        q_ext_action_spread and q_int_action_spread: standard deviations of Q_ext and of tau · Q_int over random actions
        in one state, mean over states of the first batch. The explorer differs from the exploiter as far as the second
        is no small part of the first.
        """
        if self._probe is None:
            self._probe = batch.rows[:1, :PROBE_STATES].clone()
        generator = torch.Generator().manual_seed(0)  # the same actions each time
        shape = (PROBE_ACTIONS, self._probe.shape[1], self.layout.action_size)
        tried = torch.rand(shape, generator=generator).to(self.device) * 2.0 - 1.0
        (inputs,) = self.encoder.encode_rows(self._probe)
        q_ext = self.critics(inputs, tried).min(0).values
        q_int = self.curiosity.tau * self.intrinsic_values(inputs.state, tried)[self._explores_by]
        self._measured = {
            "share_exploitation": self._exploited / self._acted,
            "q_ext_action_spread": q_ext.std(0, correction=0).mean().item(),
            "q_int_action_spread": q_int.std(0, correction=0).mean().item(),
            "tau": self.curiosity.tau,
        }
        self._exploited = self._acted = 0
        if self.hybrid.adaptive_tau:
            self._steer(self._measured["q_ext_action_spread"], self._measured["q_int_action_spread"])

    def _steer(self, of_q_ext: float, of_q_int: float) -> None:
        """Move tau by `tau_rate` of the way, in logarithms, to where the spread of tau · Q_int is as wished."""
        if of_q_ext > 0 and of_q_int > 0:
            step = self.hybrid.spread_ratio * of_q_ext / of_q_int
            low, high = TAU_RANGE
            self.curiosity.scale = min(max(self.curiosity.scale * step**self.hybrid.tau_rate, low), high)

    def state_dict(self) -> dict[str, Any]:
        """As `SAC.state_dict`, with Q_int, the counts of pi_d's share, and what was measured on which states."""
        counts = {"exploited": self._exploited, "acted": self._acted, "measured": dict(self._measured)}
        return super().state_dict() | counts | {"probe": None if self._probe is None else self._probe.clone()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """As `SAC.load_state_dict`."""
        super().load_state_dict(state)
        self._exploited, self._acted, self._measured = state["exploited"], state["acted"], dict(state["measured"])
        self._probe = None if state["probe"] is None else state["probe"].to(self.device, copy=True)


def _named(prefix: str, loss: tuple[Tensor, Metrics]) -> tuple[Tensor, Metrics]:
    """A loss whose metrics' names begin with `prefix`."""
    return loss[0], {prefix + name: value for name, value in loss[1].items()}
