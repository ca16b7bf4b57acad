"""The part of an agent that does not depend on its losses: networks, targets, normalisers, curiosity and Adam."""

import copy
import math
from collections.abc import Callable, Iterable
from functools import reduce
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from curiobench.methods.agents.batch_buffers import BatchBuffers
from curiobench.methods.agents.losses import Losses, Metrics, bootstrapped_target
from curiobench.methods.agents.networks import Actor, TwinCritics, squashed_gaussian, squashed_log_prob
from curiobench.methods.agents.pairs import PairEncoder, PairInputs, PairLayout
from curiobench.methods.agents.q_int import IntrinsicValues
from curiobench.methods.agents.settings import SACConfig
from curiobench.methods.curiosity import Curiosity
from curiobench.methods.guard import CUDA_CHECK_EVERY, NonFiniteError
from curiobench.methods.reward import Batch, IntrinsicReward, PolicyView, Transitions

LEAST_RATE = 0.1  # final share of the learning rate, if it decays
TensorPair = tuple[Tensor, Tensor]


class Step(NamedTuple):
    """What the losses of an update are computed from: B transitions and P policies. The last policy explores."""

    batch: BatchBuffers
    inputs: PairInputs  # before the transitions
    next_inputs: PairInputs  # after them
    next_noise: Tensor  # (B, A) standard normal, for the next actions
    sample: TensorPair | None  # actions (P, B, A) and log-densities (P, B); None where only the critics are updated
    transitions: Transitions | None  # input of the curiosity method; None without one
    intrinsic: TensorPair | None  # r_int (B,), raw and z-scored; None without a curiosity method

    def actions(self, first: int = 0) -> Tensor:
        """The stored actions and, if there is a sample, those of policies `first` and later: (K, B, A)."""
        stored = self.batch.action.unsqueeze(0)
        return stored if self.sample is None else torch.cat([stored, self.sample[0][first:]])


class Learner:
    """Networks, curiosity method and optimiser of an agent. The agent passes its losses to `prepare`."""

    def __init__(
        self,
        layout: PairLayout,
        config: SACConfig,
        generator: torch.Generator,
        method: IntrinsicReward | None,
        n_policies: int = 1,
    ) -> None:
        """Arguments are those of `SAC`. All policies start with the same weights. Call `prepare` next."""
        self.layout, self.config, self.generator, self.device = layout, config, generator, generator.device
        curious = layout, config.tau, config.reward_window, self.device
        self.curiosity = None if method is None else Curiosity(method, *curious)
        self.encoder = PairEncoder(layout, config, self.device)
        self.actor = Actor(self.encoder, config, generator, n_policies)
        self.critics = TwinCritics(self.encoder, config, generator)
        self.target_critics = copy.deepcopy(self.critics).requires_grad_(False)
        log_alpha = torch.tensor(config.temperature, device=self.device).log()
        self.log_alpha = nn.Parameter(log_alpha if n_policies == 1 else log_alpha.repeat(n_policies))
        self.target_entropy = -float(layout.action_size) if config.tune_temperature else None
        self.updates = 0
        self.batch: BatchBuffers | None = None

    def prepare(self, losses: Callable[[Step], Losses], **more: IntrinsicValues) -> None:
        """Set up Adam for the weights of actor, critics and `more` values, and for a temperature that is tuned."""
        self.losses = losses
        self.sources = _weights([self.critics, *(value.net for value in more.values())])
        self.targets = _weights([self.target_critics, *(value.target_net for value in more.values())])
        self.trained = [*self.actor.parameters(), *self.sources]
        self.trained += [self.log_alpha] if self.config.tune_temperature else []
        self.optimiser = torch.optim.Adam(self.trained, lr=self.config.learning_rate, fused=True)
        names = ("encoder", "actor", "critics", "target_critics", "optimiser")
        self.parts = {name: getattr(self, name) for name in names} | more

    def encode(self, *raw: np.ndarray) -> PairInputs:
        """Network inputs from observations (N, D), achieved and desired goals (N, bits)."""
        return self.encoder.encode(*map(self.tensor, raw))

    def tensor(self, array: np.ndarray) -> Tensor:
        """The array as float32 on the agent's device."""
        return torch.as_tensor(array, dtype=torch.float32, device=self.device)

    def noise(self, *shape: int) -> Tensor:
        """Standard normal numbers."""
        return torch.randn(shape, generator=self.generator, device=self.device)

    def buffers(self, batch: Batch) -> BatchBuffers:
        """Fixed buffers with a batch copied in."""
        if self.batch is None or self.batch.size != len(batch.reward):
            self.batch = BatchBuffers(self.layout, batch, self.device)
        self.batch.load(batch)
        return self.batch

    def update(self, batch: Batch, epoch: int) -> Metrics:
        """See `LearningAgent.update`."""
        buffers = self.buffers(batch)
        self._set_learning_rate()
        with_policy = self.updates % self.config.actor_every == 0
        metrics = self._step(buffers, epoch, with_policy)
        if self.device.type == "cuda" and self.updates % CUDA_CHECK_EVERY == 0:
            self.check({name: value for name, value in metrics.items() if name.endswith("_loss")})
        self.updates += 1
        if self.updates % self.config.target_every == 0:
            with torch.no_grad():  # otherwise the targets' autograd graph would grow with each update
                torch._foreach_lerp_(self.targets, self.sources, self.config.polyak)
        return metrics

    def _set_learning_rate(self) -> None:
        """Decay the learning rate linearly to `LEAST_RATE` of its first value over `decay_updates` updates, if set."""
        if self.config.decay_updates is None:
            return
        passed = min(1.0, self.updates / self.config.decay_updates)
        rate = self.config.learning_rate * (1.0 - passed * (1.0 - LEAST_RATE))
        self.optimiser.param_groups[0]["lr"] = rate

    def _step(self, batch: BatchBuffers, epoch: int, with_policy: bool) -> Metrics:
        """Update the critics and, `with_policy`, the policies and temperatures."""
        inputs, next_inputs = self.encoder.encode_rows(batch.rows)
        metrics = {"reward": batch.reward.mean()}
        next_noise, noise = self.noise(2, *batch.action.shape)
        sample = view = transitions = intrinsic = None
        if with_policy or self.shows_policy:
            with torch.set_grad_enabled(with_policy):
                mean, log_std = self.actor(inputs)
                sample = squashed_gaussian(mean, log_std, noise)
            view = self.view(batch.source, (mean, log_std), sample)
        if self.curiosity is not None:
            transitions = self.transitions(batch.source, (inputs.state, next_inputs.state), epoch, view)
            raw, normalised, learned = self.curiosity.learn(transitions)
            intrinsic, metrics = (raw, normalised), metrics | learned
        sample = sample if with_policy else None
        step = Step(batch, inputs, next_inputs, next_noise, sample, transitions, intrinsic)
        return metrics | self.descend(self.losses(step), with_policy)

    @property
    def shows_policy(self) -> bool:
        """Whether the curiosity method reads a `PolicyView` of the exploring policy."""
        return self.curiosity is not None and self.curiosity.method.uses_policy

    @property
    def required_curiosity(self) -> Curiosity:
        """The curiosity method. Raises ValueError if there is none."""
        if self.curiosity is None:
            raise ValueError("this agent has no curiosity method")
        return self.curiosity

    @torch.no_grad()
    def view(self, batch: Batch, policies: TensorPair, sample: TensorPair) -> PolicyView | None:
        """The exploring policy's `PolicyView`, from mean, log-std and samples (P, …); None if the method reads none."""
        if not self.shows_policy:
            return None
        (mean, log_std), (action, log_prob) = policies, sample
        stored, desired = (part.to(self.device, torch.float32) for part in (batch.action, batch.desired_goal))
        of_stored = squashed_log_prob(mean[-1], log_std[-1], stored)
        return PolicyView(desired, action[-1].detach(), log_prob[-1].detach(), of_stored)

    def transitions(self, batch: Batch, states: TensorPair, epoch: int, view: PolicyView | None) -> Transitions:
        """Input of the curiosity method, from states (B, D) before and after the step; ValueError without a method."""
        return self.required_curiosity.transitions(states, batch, epoch, view, self.encoder.normalise)

    def policy_term(self, step: Step, actions: Tensor) -> Tensor | None:
        """The method's term (B,), added to log pi of actions (B, A) in the exploring policy's loss."""
        if step.transitions is None:
            return None
        return self.required_curiosity.policy_term(step.transitions, step.batch.desired_goal[0], actions)

    def bootstrapped(self, reward: Tensor, next_values: Tensor, next_log_prob: Tensor, log_alpha: Tensor) -> Tensor:
        """Targets (B,) by `bootstrapped_target`, with entropy if `config.entropy_in_targets`."""
        alpha = log_alpha.exp() if self.config.entropy_in_targets else None
        return bootstrapped_target(reward, next_values, self.config.gamma, next_log_prob, alpha)

    def descend(self, found: Losses, with_policy: bool) -> Metrics:
        """One optimiser step on the sum of losses; returns their metrics. On a CPU, first checks that they are finite.

        Without `with_policy` no loss depends on the policy's weights: they have no gradient, and Adam skips them.
        """
        losses = {name: loss for name, (loss, _) in found.items()}
        if self.device.type == "cpu":
            self.check(losses)
        gradients = torch.autograd.grad(reduce(torch.add, losses.values()), self.trained, allow_unused=not with_policy)
        for parameter, gradient in zip(self.trained, gradients, strict=True):
            parameter.grad = gradient
        self.optimiser.step()
        return {name: value for _, metrics in found.values() for name, value in metrics.items()}

    def check(self, losses: dict[str, Tensor]) -> None:
        """Raise NonFiniteError unless all losses are finite. Synchronises with the device."""
        if not math.isfinite(reduce(torch.add, losses.values()).item()):
            broken = ", ".join(f"{name} ({loss.item()})" for name, loss in losses.items() if not loss.isfinite())
            raise NonFiniteError(f"update {self.updates}: loss not finite: {broken}")


def _weights(nets: Iterable[nn.Module]) -> list[Tensor]:
    return [weights for net in nets for weights in net.parameters()]
