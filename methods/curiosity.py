"""A curiosity method inside an agent: prepares its inputs, normalises its reward and checks what it returns."""

import math
from collections.abc import Callable
from typing import Any, TypeVar

import torch
from torch import Tensor

from curiobench.methods.agents.losses import Metrics
from curiobench.methods.agents.pairs import PairLayout
from curiobench.methods.guard import (
    blamed,
    checks_values,
    fault,
    flaw_of_metrics,
    flaw_of_reward,
    flaw_of_state,
    flaw_of_term,
    flaw_of_values,
)
from curiobench.methods.moments import RunningMoments
from curiobench.methods.reward import Batch, Collected, IntrinsicReward, PolicyView, Transitions

Normalise = Callable[[Tensor], Tensor]
Maybe = TypeVar("Maybe", Tensor, Tensor | None)


class Curiosity:
    """A method, the statistics that z-score its reward, and its weight tau.

    Every call of the method goes through here. It raises MethodError if the method raises or breaks a rule of
    `IntrinsicReward`. SAC, the hybrid mechanism and the probe all use this class.

    Attributes:
        method: the curiosity method.
        moments: running mean and variance of r_int, over all updates or a window.
        factor: the method's factor of tau at the last batch.
        scale: a further factor of tau, set by the hybrid mechanism with `adaptive_tau`.
        updates: number of batches that the method has learned from.
    """

    def __init__(
        self,
        method: IntrinsicReward,
        layout: PairLayout,
        tau: float,
        window: int | None = None,
        device: str | torch.device = "cpu",
    ) -> None:
        """
        Args:
            method: the curiosity method.
            layout: columns of the blocks in a state.
            tau: weight of the normalised reward, before its factors.
            window: number of updates over which old statistics decay; None keeps all history.
            device: device of the statistics.
        """
        self.method, self._tau = method, tau
        self.moments = RunningMoments((), min_std=1e-8, window=window, device=device)
        self._columns = None if method.sees == "full" else layout.columns(method.sees)
        self._names: tuple[str, ...] | None = None  # of the method's metrics
        self.factor = self.scale = 1.0
        self.updates = 0

    @property
    def tau(self) -> float:
        """Present weight of the intrinsic reward."""
        return self._tau * self.factor * self.scale

    def visible(self, state: Tensor) -> Tensor:
        """The columns (..., S) of normalised states (..., D) that the method reads."""
        return state if self._columns is None else state[..., self._columns]

    def transitions(
        self, states: tuple[Tensor, Tensor], batch: Batch, epoch: int, policy: PolicyView | None, normalise: Normalise
    ) -> Transitions:
        """The method's input for a batch.

        Args:
            states: normalised, (B, D), before and after the step.
            batch: the raw batch, on any device and of any numeric type.
            epoch: on the paper's scale of 500.
            policy: for a method with `uses_policy`.
            normalise: maps raw observations (..., D) to states.
        """
        before, after = map(self.visible, states)

        def moved(part: Maybe, dtype: torch.dtype | None = torch.float32) -> Maybe:
            return None if part is None else part.to(before.device, dtype or part.dtype)

        def normalised(raw: Tensor | None, wanted: bool) -> Tensor | None:
            return self.visible(normalise(moved(raw))) if wanted and raw is not None else None

        with_episode = self.method.uses_episode
        return Transitions(
            before,
            moved(batch.action),
            after,
            epoch,
            policy,
            normalised(batch.particles, self.method.n_particles > 0),
            achieved_goal=moved(batch.achieved_goal),
            next_achieved_goal=moved(batch.next_achieved_goal),
            raw_state=moved(batch.observation),
            raw_next_state=moved(batch.next_observation),
            step=moved(batch.step, None),
            episode=moved(batch.episode, None),
            episode_states=normalised(batch.episode_observation, with_episode),
            episode_achieved_goals=moved(batch.episode_achieved_goal) if with_episode else None,
        )

    def observe(self, observation: Tensor, action: Tensor, achieved_goal: Tensor, normalise: Normalise) -> None:
        """Give the method collected episodes: observations (N, T + 1, D), actions (N, T, A), goals (N, T + 1, bits)."""
        if type(self.method).observe is not IntrinsicReward.observe:
            with blamed(self.method, "observe", self.updates):
                self.method.observe(Collected(self.visible(normalise(observation)), action, achieved_goal))

    def reward(self, transitions: Transitions) -> Tensor:
        """r_int (B,), raw: finite, float32 and without gradients."""
        # gradients are enabled so that a method without @torch.no_grad() fails here
        with blamed(self.method, "reward", self.updates), torch.enable_grad():
            reward = self.method.reward(transitions)
        found = flaw_of_reward(reward, len(transitions.state))
        if not found and checks_values(reward, self.updates):
            found = flaw_of_values(reward)
        self._refuse("reward", found)
        return reward

    @torch.no_grad()
    def learn(self, transitions: Transitions) -> tuple[Tensor, Tensor, Metrics]:
        """Score a batch, then let the method learn from it.

        Returns r_int (B,), raw and z-scored by the statistics before this batch, and metrics.
        """
        self.factor = self._factor(transitions.epoch)
        raw = self.reward(transitions)
        normalised = self.moments.normalise(raw)
        self.moments.update(raw)
        learned = self._update(transitions)
        self._names = tuple(learned)
        self.updates += 1
        metrics = {
            "intrinsic_raw": raw.mean(),
            "intrinsic_normalised": normalised.mean(),
            "bonus_spread": self.tau * normalised.std(correction=0),
        }
        return raw, normalised, metrics | learned

    def policy_term(self, transitions: Transitions, desired_goal: Tensor, action: Tensor) -> Tensor | None:
        """The method's term (B,) in the policy's loss for actions (B, A) drawn from the policy, or None."""
        update = self.updates - 1  # the method has learned from this batch already
        with blamed(self.method, "policy_loss_term", update):
            term = self.method.policy_loss_term(transitions, desired_goal, action)
        if term is None:
            return None
        found = flaw_of_term(term, len(action))
        if not found and checks_values(term, update):
            found = flaw_of_values(term.detach())
        self._refuse("policy_loss_term", found, update)
        return term

    def _factor(self, epoch: int) -> float:
        with blamed(self.method, "bonus_factor", self.updates):
            factor = self.method.bonus_factor(epoch)
        legal = isinstance(factor, int | float) and 0 <= factor < math.inf
        self._refuse("bonus_factor", None if legal else f"{factor!r:.80}; expected a finite number of at least 0")
        return float(factor)

    def _update(self, transitions: Transitions) -> Metrics:
        """The method's gradient step. Its metrics have the same names each time: they are columns of progress.csv."""
        with blamed(self.method, "update", self.updates), torch.enable_grad():
            metrics = self.method.update(transitions)
        found = flaw_of_metrics(metrics, self._names)
        self._refuse("update", found)
        for name, value in metrics.items():
            if checks_values(value, self.updates) and not value.isfinite():
                self._refuse("update", f"{name} = {value.item()}; expected a finite number")
        return metrics

    def _refuse(self, call: str, found: str | None, update: int | None = None) -> None:
        if found:
            raise fault(self.method, self.updates if update is None else update, f"{call}() returned {found}")

    def state_dict(self) -> dict[str, Any]:
        """The method's state, the statistics, factors of tau and the number of updates. Plain values and tensors."""
        with blamed(self.method, "state_dict", self.updates):
            state = self.method.state_dict()
        self._refuse("state_dict", flaw_of_state(state))
        own = {"factor": self.factor, "scale": self.scale, "updates": self.updates}
        return {"method": state, "moments": self.moments.state_dict(), **own}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a `state_dict`. Raises MethodError if the method cannot load its part."""
        self.moments.load_state_dict(state["moments"])
        self.factor, self.scale, self.updates = state["factor"], state["scale"], state["updates"]
        with blamed(self.method, "load_state_dict", self.updates):
            self.method.load_state_dict(state["method"])
