"""Buffers for a batch."""

import torch

from curiobench.methods.agents.pairs import PairLayout
from curiobench.methods.reward import Batch


class BatchBuffers:
    """A batch in float32 buffers, which the next batch reuses, in the layout that the encoder reads."""

    def __init__(self, layout: PairLayout, batch: Batch, device: torch.device) -> None:
        """
        Args:
            layout: sizes of observations, goals and actions.
            batch: the first batch of B transitions; sets the size.
            device: device of the buffers.
        """
        self.size = size = len(batch.reward)
        self.rows = torch.empty((2, size, layout.observation_size + 2 * layout.goal_size), device=device)
        """[observation | achieved | desired] before and after the step."""
        self.action = torch.empty((size, layout.action_size), device=device)
        self.reward = torch.empty(size, device=device)
        """r_ext; becomes r_ext + tau · n(r_int)."""
        parts = (layout.observation_size, layout.goal_size, layout.goal_size)
        self.source = batch
        """The batch that was loaded last. The curiosity method reads it."""
        self.observation, self.achieved_goal, self.desired_goal = self.rows.split(parts, dim=2)

    def load(self, batch: Batch) -> None:
        """Copy in a batch of the same size and any numeric types."""
        self.observation[0].copy_(batch.observation)
        self.observation[1].copy_(batch.next_observation)
        self.achieved_goal[0].copy_(batch.achieved_goal)
        self.achieved_goal[1].copy_(batch.next_achieved_goal)
        self.desired_goal.copy_(batch.desired_goal)
        self.action.copy_(batch.action)
        self.reward.copy_(batch.reward)
        self.source = batch
