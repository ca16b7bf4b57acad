"""What an agent is: acting and learning, as training, evaluation, saved agents and the probe ask for it."""

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
    """Acts, and gives the losses that its learner descends."""

    learner: Learner
    """Has the networks, the curiosity method and the optimiser."""

    @abstractmethod
    def act(
        self, observation: np.ndarray, achieved_goal: np.ndarray, desired_goal: np.ndarray, deterministic: bool = False
    ) -> np.ndarray:
        """Actions of all worlds at once.

        Args:
            observation: (N, D), raw.
            achieved_goal: (N, bits).
            desired_goal: (N, bits).
            deterministic: the mode of the policy that is evaluated; nothing in the agent changes then.

        Returns:
            (N, A) float32 in [-1, 1].
        """

    @abstractmethod
    def losses(self, step: Step) -> Losses:
        """All losses of an update, at the same weights."""

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
        learner, observed = self.learner, (observation, achieved_goal, desired_goal)
        learner.encoder.observe(*(learner.tensor(np.reshape(a, (-1, a.shape[-1]))) for a in observed))
        if learner.curiosity is not None and action is not None:
            seen, actions, achieved = map(learner.tensor, (observation, action, achieved_goal))
            learner.curiosity.observe(seen, actions, achieved, learner.encoder.normalise)

    def update(self, batch: Batch, epoch: int = 0) -> Metrics:
        """One step of all that learns, on a batch.

        Args:
            batch: B transitions, raw, any numeric type; copied.
            epoch: of the paper's 500 (`RunConfig.paper_epoch`), passed to the curiosity method.

        Returns:
            Scalar tensors by name, means over the batch, to be read only when logged: reward (r_ext) and those of the
            losses; with a curiosity method intrinsic_raw, intrinsic_normalised, bonus_spread (the standard deviation
            of tau · n(r_int) over the batch), and the method's own.

        Raises:
            NonFiniteError: a loss is NaN or infinite; neither weights nor optimiser have taken that step. (On CUDA
                it is noticed up to CUDA_CHECK_EVERY updates late.)
            MethodError: the curiosity method raised or broke a rule; agent as before, normaliser of rewards apart.
        """
        return self.learner.update(batch, epoch)

    @torch.no_grad()
    def transitions(self, batch: Batch, epoch: int) -> Transitions:
        """What `update` shows of a batch to the curiosity method. Nothing that decides how the agent goes on changes.

        Raises ValueError where there is no curiosity method.
        """
        learner, view = self.learner, None
        inputs, next_inputs = learner.encoder.encode_rows(learner.buffers(batch).rows)
        if learner.shows_policy:
            mean, log_std = learner.actor(inputs)
            noise = torch.randn(mean.shape[1:], generator=torch.Generator().manual_seed(0)).to(learner.device)
            view = learner.view(batch, (mean, log_std), squashed_gaussian(mean, log_std, noise))
        return learner.transitions(batch, (inputs.state, next_inputs.state), epoch, view)

    def state_dict(self) -> dict[str, Any]:
        """A copy of everything that decides how training continues; loads with `torch.load(weights_only=True)`."""
        learner = self.learner
        own = {
            "curiosity": None if learner.curiosity is None else learner.curiosity.state_dict(),
            "updates": learner.updates,
            "generator": learner.generator.get_state(),
            "log_alpha": learner.log_alpha.detach(),
        }
        return copy.deepcopy({name: part.state_dict() for name, part in learner.parts.items()} | own)

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore what `state_dict` gave, in an agent of the same layout, config and method.

        Raises KeyError, ValueError or RuntimeError where the state is of another kind of agent, MethodError where the
        curiosity method does not take its own.
        """
        learner = self.learner
        if (state["curiosity"] is None) != (learner.curiosity is None):
            raise ValueError("the saved agent and this one do not have the same curiosity method")
        state = copy.deepcopy(state)  # the optimiser keeps what it is given
        for name, part in learner.parts.items():
            part.load_state_dict(state[name])
        learner.updates = state["updates"]
        learner.generator.set_state(state["generator"])
        learner.log_alpha.data.copy_(state["log_alpha"])
        if learner.curiosity is not None:
            learner.curiosity.load_state_dict(state["curiosity"])
