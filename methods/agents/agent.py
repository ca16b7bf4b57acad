"""The interface of an agent, which training, evaluation, saved agents and the probe use."""

import copy
from abc import ABC, abstractmethod
from typing import Any

import numpy as np
import torch

from curiobench.methods.agents.learner import Learner, Step
from curiobench.methods.agents.losses import Losses, Metrics
from curiobench.methods.agents.networks import squashed_gaussian
from curiobench.methods.reward import Batch, Transitions


class LearningAgent(ABC):
    """Chooses actions, and computes the losses that its learner minimises."""

    learner: Learner
    """Holds the networks, the curiosity method and the optimiser."""

    @abstractmethod
    def act(
        self, observation: np.ndarray, achieved_goal: np.ndarray, desired_goal: np.ndarray, deterministic: bool = False
    ) -> np.ndarray:
        """Actions for N observations.

        Args:
            observation: (N, D), raw.
            achieved_goal: (N, bits).
            desired_goal: (N, bits).
            deterministic: take the mode of the evaluated policy. The agent does not change.

        Returns:
            (N, A) float32 in [-1, 1].
        """

    @abstractmethod
    def losses(self, step: Step) -> Losses:
        """All losses of an update, computed before any weight changes."""

    def observe(
        self,
        observation: np.ndarray,
        achieved_goal: np.ndarray,
        desired_goal: np.ndarray,
        action: np.ndarray | None = None,
    ) -> None:
        """Add collected observations (..., D) and goals (..., bits) to the normalisers. Never called in evaluation.

        Complete episodes, (N, T + 1, ...) with their actions (N, T, A), also go to the curiosity method.
        """
        learner, observed = self.learner, (observation, achieved_goal, desired_goal)
        learner.encoder.observe(*(learner.tensor(np.reshape(a, (-1, a.shape[-1]))) for a in observed))
        if learner.curiosity is not None and action is not None:
            states, actions, achieved = map(learner.tensor, (observation, action, achieved_goal))
            learner.curiosity.observe(states, actions, achieved, learner.encoder.normalise)

    def update(self, batch: Batch, epoch: int = 0) -> Metrics:
        """One gradient update on a batch.

        Args:
            batch: B raw transitions of any numeric type; copied.
            epoch: passed to the curiosity method, on the paper's scale of 500 (`RunConfig.paper_epoch`).

        Returns:
            Scalar tensors by name, means over the batch: reward (r_ext) and the metrics of the losses; with a curiosity
            method also intrinsic_raw, intrinsic_normalised, bonus_spread (the standard deviation of tau · n(r_int) over
            the batch), and the method's own. Read them only to log them: reading waits for the device.

        Raises:
            NonFiniteError: a loss is NaN or infinite. Weights and optimiser are unchanged. (On CUDA the error is raised
                up to CUDA_CHECK_EVERY updates late.)
            MethodError: the curiosity method raised or broke a rule. Only the normaliser of rewards may have changed.
        """
        return self.learner.update(batch, epoch)

    @torch.no_grad()
    def transitions(self, batch: Batch, epoch: int) -> Transitions:
        """The curiosity method's input for a batch, as in `update`. Does not change how training continues.

        Raises ValueError if there is no curiosity method.
        """
        learner, view = self.learner, None
        inputs, next_inputs = learner.encoder.encode_rows(learner.buffers(batch).rows)
        if learner.shows_policy:
            mean, log_std = learner.actor(inputs)
            noise = torch.randn(mean.shape[1:], generator=torch.Generator().manual_seed(0)).to(learner.device)
            view = learner.view(batch, (mean, log_std), squashed_gaussian(mean, log_std, noise))
        return learner.transitions(batch, (inputs.state, next_inputs.state), epoch, view)

    def state_dict(self) -> dict[str, Any]:
        """A copy of all state that training depends on; loads with `torch.load(weights_only=True)`."""
        learner = self.learner
        own = {
            "curiosity": None if learner.curiosity is None else learner.curiosity.state_dict(),
            "updates": learner.updates,
            "generator": learner.generator.get_state(),
            "log_alpha": learner.log_alpha.detach(),
        }
        return copy.deepcopy({name: part.state_dict() for name, part in learner.parts.items()} | own)

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a `state_dict` of an agent with the same layout, config and method.

        Raises KeyError, ValueError or RuntimeError if another kind of agent saved the state, and MethodError if the
        curiosity method cannot load its part.
        """
        learner = self.learner
        if (state["curiosity"] is None) != (learner.curiosity is None):
            raise ValueError("the saved agent and this one do not have the same curiosity method")
        state = copy.deepcopy(state)  # the optimiser keeps references to it
        for name, part in learner.parts.items():
            part.load_state_dict(state[name])
        learner.updates = state["updates"]
        learner.generator.set_state(state["generator"])
        learner.log_alpha.data.copy_(state["log_alpha"])
        if learner.curiosity is not None:
            learner.curiosity.load_state_dict(state["curiosity"])
