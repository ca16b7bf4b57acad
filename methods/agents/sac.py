"""Goal-conditioned soft actor-critic (Haarnoja et al. 2018, arXiv 1812.05905) over pairs of blocks.

    y          = r + gamma · (min_k Q'_k(s', a', g) - alpha · log pi(a' | s', g)),   a' ~ pi
                 (the last term only with `entropy_in_targets`)
    critics    : mean over the batch, summed over k, of ½ (Q_k(s, a, g) - y)²
    policy     : mean of alpha · log pi(a | s, g) - min_k Q_k(s, a, g),              a ~ pi
    temperature: mean of -log alpha · (log pi(a | s, g) + target entropy)            (only if tuned)
    r          = r_ext + tau · n(r_int)                                              (r_ext alone without a method)
                 (tau times the method's factor, which is 1 but for RE3)

Every transition bootstraps: episodes end by time limit only. Targets are not clipped: with r_ext in {0, 1} the reward's
part of Q lies in [0, 1 / (1 - gamma)], but the entropy's part has no lower bound and r_int may be negative.
"""

import copy
import math
from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from curiobench.methods.agents.capture import CapturedStep, StaticBatch
from curiobench.methods.agents.losses import Metrics, bootstrapped_target, critic_loss, policy_loss, temperature_loss
from curiobench.methods.agents.networks import Actor, TwinCritics, squashed_gaussian
from curiobench.methods.agents.pairs import PairEncoder, PairInputs, PairLayout
from curiobench.methods.agents.policy_view import view_policy
from curiobench.methods.agents.settings import SACConfig
from curiobench.methods.curiosity import Curiosity
from curiobench.methods.guard import CUDA_CHECK_EVERY, NonFiniteError
from curiobench.methods.reward import Batch, IntrinsicReward, Transitions

LEAST_RATE = 0.1  # share of the learning rate that is left when it has fallen


class SAC:
    """The agent. All randomness comes from `generator`: initial weights, exploration, and noise in the losses."""

    _STATEFUL = ("encoder", "actor", "critics", "target_critics", "optimiser")

    def __init__(
        self, layout: PairLayout, config: SACConfig, generator: torch.Generator, method: IntrinsicReward | None = None
    ) -> None:
        """
        Args:
            layout: where blocks and predicate bits stand in observations and goals.
            config: settings.
            generator: its device is the agent's.
            method: the curiosity method, or None for the extrinsic reward alone.
        """
        self.layout, self.config, self.generator, self.device = layout, config, generator, generator.device
        curious = layout, config.tau, config.reward_window, self.device
        self.curiosity = None if method is None else Curiosity(method, *curious)
        self.encoder = PairEncoder(layout, config, self.device)
        self.actor = Actor(self.encoder, config, generator)
        self.critics = TwinCritics(self.encoder, config, generator)
        self.target_critics = copy.deepcopy(self.critics).requires_grad_(False)
        self.log_alpha = nn.Parameter(torch.tensor(config.temperature, device=self.device).log())
        self._train([*self.actor.parameters(), *self.critics.parameters()])
        self._targets, self._sources = list(self.target_critics.parameters()), list(self.critics.parameters())
        self.updates = 0
        self._static: StaticBatch | None = None

    def _train(self, weights: list[nn.Parameter]) -> None:
        """Set up Adam for these weights and, if it is tuned, the temperature."""
        self._trained = [*weights, *([self.log_alpha] if self.config.tune_temperature else [])]
        on_cuda, rate = self.device.type == "cuda", self.config.learning_rate
        rate = torch.tensor(rate, device=self.device) if on_cuda else rate  # a tensor, or a graph would keep its value
        self.optimiser = torch.optim.Adam(self._trained, lr=rate, fused=True, capturable=on_cuda)

    def _set_learning_rate(self) -> None:
        """Let it fall, if it is to, from its full value to `LEAST_RATE` of that."""
        if self.config.decay_updates is None:
            return
        passed = min(1.0, self.updates / self.config.decay_updates)
        rate = self.config.learning_rate * (1.0 - passed * (1.0 - LEAST_RATE))
        (group,) = self.optimiser.param_groups
        if self.device.type == "cuda":
            group["lr"].fill_(rate)
        else:
            group["lr"] = rate

    @torch.no_grad()
    def act(
        self, observation: np.ndarray, achieved_goal: np.ndarray, desired_goal: np.ndarray, deterministic: bool = False
    ) -> np.ndarray:
        """Actions of all worlds at once.

        Args:
            observation: (N, D), raw.
            achieved_goal: (N, bits).
            desired_goal: (N, bits).
            deterministic: the mode tanh(mean) instead of a sample; then the generator is not touched.

        Returns:
            (N, A) float32 in [-1, 1].
        """
        mean, log_std = self.actor(self.encoder.encode(*self._tensors(observation, achieved_goal, desired_goal)))
        if not deterministic:
            noise = torch.randn(mean.shape, generator=self.generator, device=self.device)
            mean = torch.addcmul(mean, log_std.exp(), noise)
        return mean.tanh().cpu().numpy()

    def observe(
        self,
        observation: np.ndarray,
        achieved_goal: np.ndarray,
        desired_goal: np.ndarray,
        action: np.ndarray | None = None,
    ) -> None:
        """Add collected observations (..., D) and goals (..., bits) to the normalisers. Never called in evaluation.

        Whole episodes, (N, T + 1, ...) with their actions (N, T, A), go to the curiosity method, too.
        """
        flat = (np.reshape(a, (-1, a.shape[-1])) for a in (observation, achieved_goal, desired_goal))
        self.encoder.observe(*self._tensors(*flat))
        if self.curiosity is not None and action is not None:
            self.curiosity.observe(*self._tensors(observation, action, achieved_goal), self.encoder.normalise)

    def update(self, batch: Batch, epoch: int = 0) -> Metrics:
        """One step of critics, policy, temperature and curiosity method on a batch.

        Args:
            batch: B transitions, raw, any numeric type; copied.
            epoch: of the paper's 500 (`RunConfig.paper_epoch`), passed to the curiosity method.

        Returns:
            Scalar tensors by name, means over the batch, to be read only when logged: reward (r_ext), critic_loss, q
            (of stored actions), target_q, policy_loss, entropy (of the policy, squashed), temperature; temperature_loss
            if it is tuned; with a curiosity method intrinsic_raw, intrinsic_normalised, bonus_spread (the standard
            deviation of tau · n(r_int) over the batch), and the method's own.

        Raises:
            NonFiniteError: a loss is NaN or infinite; neither weights nor optimiser have taken that step. (On CUDA
                it is noticed up to CUDA_CHECK_EVERY updates late.)
            MethodError: the curiosity method raised or broke a rule; agent as before, normaliser of rewards apart.
        """
        if self._static is None or self._static.size != len(batch.reward):
            self._static = StaticBatch(self.layout, len(batch.reward), self.device)
            self._captured = {
                acts: CapturedStep(partial(self._learn, self._static, 0, acts), self.generator)
                for acts in (True, False)
            }
        self._static.load(batch)
        self._set_learning_rate()
        acts = self.updates % self.config.actor_every == 0
        metrics = self._captured[acts]() if self.curiosity is None else self._learn(self._static, epoch, acts)
        if self.device.type == "cuda" and self.updates % CUDA_CHECK_EVERY == 0:
            self._check({name: value for name, value in metrics.items() if name.endswith("_loss")})
        self.updates += 1
        if self.updates % self.config.target_every == 0:
            with torch.no_grad():  # or the targets' history would grow by a node each time
                torch._foreach_lerp_(self._targets, self._sources, self.config.polyak)
        return metrics

    def _learn(self, batch: StaticBatch, epoch: int, acts: bool) -> Metrics:
        """`update` less target networks and counter: reads the batch in its fixed place and, on CUDA, never waits.

        `acts` says whether the policy makes a step, too.
        """
        inputs, next_inputs = self.encoder.encode_rows(batch.rows)
        metrics = {"reward": batch.reward.mean()}
        noise = torch.randn((2, *batch.action.shape), generator=self.generator, device=self.device)
        distribution = sample = transitions = None
        if acts or self._shows_policy:
            with torch.set_grad_enabled(acts):
                distribution = self.actor(inputs)
                sample = squashed_gaussian(*distribution, noise[1])
        if self.curiosity is not None:
            transitions = self.transitions(batch, (inputs.state, next_inputs.state), epoch, distribution, sample)
            _, normalised, learned = self.curiosity.learn(transitions)
            batch.reward.add_(normalised, alpha=self.curiosity.tau)
            metrics |= learned
        target = self._target(next_inputs, batch.reward, noise[0])
        losses, more = self._losses(inputs, batch, target, sample if acts else None, transitions)
        self._descend(losses, acts)
        return metrics | more

    def _descend(self, losses: dict[str, Tensor], acts: bool) -> None:
        """One step down the sum of losses; on a CPU, after a look whether they are finite.

        Unless the policy `acts`, its weights are in no loss, have no gradient, and Adam leaves them alone.
        """
        if self.device.type == "cpu":
            self._check(losses)
        gradients = torch.autograd.grad(sum(losses.values()), self._trained, allow_unused=not acts)
        for parameter, gradient in zip(self._trained, gradients, strict=True):
            parameter.grad = gradient
        self.optimiser.step()

    def transitions(
        self,
        batch: StaticBatch,
        states: tuple[Tensor, Tensor],
        epoch: int,
        distribution: tuple[Tensor, Tensor] | None,
        sample: tuple[Tensor, Tensor] | None,
    ) -> Transitions:
        """What the curiosity method sees, from states (B, D) before and after the step and the policy that explores."""
        shown = self._shows_policy
        view = view_policy(distribution, sample, batch.action, batch.desired_goal[0]) if shown else None
        return self.curiosity.transitions(states, batch.source, epoch, view, self.encoder.normalise)

    @property
    def n_particles(self) -> int:
        """How many states of the replay the curiosity method wants beside each batch."""
        return 0 if self.curiosity is None else self.curiosity.method.n_particles

    @property
    def uses_episode(self) -> bool:
        """Whether the curiosity method wants the whole episode of each transition."""
        return self.curiosity is not None and self.curiosity.method.uses_episode

    @property
    def _shows_policy(self) -> bool:
        """Whether the curiosity method asks for a view of the policy."""
        return self.curiosity is not None and self.curiosity.method.uses_policy

    @torch.no_grad()
    def _target(self, next_inputs: PairInputs, reward: Tensor, noise: Tensor) -> Tensor:
        """Bootstrapped targets (B,) of both critics."""
        next_action, next_log_prob = self.actor.sample(next_inputs, noise)
        next_values = self.target_critics(next_inputs, next_action.unsqueeze(0)).squeeze(1)
        return self._bootstrapped(reward, next_values, next_log_prob, self.log_alpha)

    def _bootstrapped(self, reward: Tensor, next_values: Tensor, next_log_prob: Tensor, log_alpha: Tensor) -> Tensor:
        """Targets (B,) as `bootstrapped_target` has them, with or without entropy as the config says."""
        alpha = log_alpha.exp() if self.config.entropy_in_targets else None
        return bootstrapped_target(reward, next_values, self.config.gamma, next_log_prob, alpha)

    def _losses(
        self,
        inputs: PairInputs,
        batch: StaticBatch,
        target: Tensor,
        sample: tuple[Tensor, Tensor] | None,
        transitions: Transitions | None,
    ) -> tuple[dict[str, Tensor], Metrics]:
        """Losses by name (critics, policy and, if it is tuned, temperature), all at the same weights; and metrics.

        Targets (B,); the policy's own actions (B, A) and their log-densities (B,), which carry its gradients, or None
        where only the critics learn.
        """
        actions = [batch.action] if sample is None else [batch.action, sample[0]]
        stored, *own = self.critics(inputs, torch.stack(actions), trained=1).unbind(1)
        found = {"critics": critic_loss(stored, target)}
        if sample is not None:
            action, log_prob = sample
            term = self._policy_term(transitions, batch.desired_goal[0], action)
            found["policy"] = policy_loss(own[0], log_prob, self.log_alpha.detach().exp(), term)
            if self.config.tune_temperature:
                found["temperature"] = temperature_loss(self.log_alpha, log_prob, -float(self.layout.action_size))
        metrics = {name: value for _, of_loss in found.values() for name, value in of_loss.items()}
        return {name: loss for name, (loss, _) in found.items()}, metrics

    def _policy_term(self, transitions: Transitions | None, desired_goal: Tensor, action: Tensor) -> Tensor | None:
        """What the curiosity method adds to log pi in the policy's loss, (B,) for the policy's own actions (B, A)."""
        if self.curiosity is None or transitions is None:
            return None
        return self.curiosity.policy_term(transitions, desired_goal, action)

    def _check(self, losses: dict[str, Tensor]) -> None:
        """Raise NonFiniteError unless all losses are finite. Waits for the device."""
        if not math.isfinite(sum(losses.values()).item()):
            broken = ", ".join(f"{name} ({loss.item()})" for name, loss in losses.items() if not loss.isfinite())
            raise NonFiniteError(f"update {self.updates}: loss not finite: {broken}")

    def _tensors(self, *arrays: np.ndarray) -> Iterable[Tensor]:
        return (torch.as_tensor(a, dtype=torch.float32, device=self.device) for a in arrays)

    def state_dict(self) -> dict[str, Any]:
        """A copy of everything that decides how training continues; loads with `torch.load(weights_only=True)`."""
        state = {name: getattr(self, name).state_dict() for name in self._STATEFUL}
        state |= {
            "curiosity": None if self.curiosity is None else self.curiosity.state_dict(),
            "updates": self.updates,
            "generator": self.generator.get_state(),
            "log_alpha": self.log_alpha.detach(),
        }
        return copy.deepcopy(state)

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore what `state_dict` gave, in an agent of the same layout, config and method.

        Raises KeyError, ValueError or RuntimeError where the state is of another kind of agent, MethodError where the
        curiosity method does not take its own.
        """
        if (state["curiosity"] is None) != (self.curiosity is None):
            raise ValueError("the saved agent and this one do not have the same curiosity method")
        state = copy.deepcopy(state)  # the optimiser keeps what it is given
        for name in self._STATEFUL:
            getattr(self, name).load_state_dict(state[name])
        self.updates = state["updates"]
        self.generator.set_state(state["generator"])
        self.log_alpha.data.copy_(state["log_alpha"])
        if self.curiosity is not None:
            self.curiosity.load_state_dict(state["curiosity"])
