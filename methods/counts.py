"""Visit counts over semantic configurations: the plain count bonus (Strehl and Littman 2008, MBIE-EB).

    N(c)  steps of collected episodes that led to the configuration c, the predicates that hold
    r_int = 1 / sqrt(max(1, N(c')))                    c' after the step

The tasks' predicates are prior knowledge of what matters, as a hash of images is in #Exploration (Tang et al. 2017,
arXiv 1611.04717). So this is a baseline to compare with, and no fair rival of methods that see the state alone.

Counts are of what was collected, not of what was sampled from the replay.
"""

from typing import Any

import torch
from torch import Tensor

from curiobench.methods.curriculum import NoSettings
from curiobench.methods.reward import Collected, IntrinsicReward, Transitions, given

LARGEST_BITS = 62
"""Predicates that fit the number which stands for a configuration."""


class Counts(IntrinsicReward):
    """A bonus for configurations that were seldom reached."""

    Config = NoSettings

    def __init__(self, state_size: int, action_size: int, config: NoSettings, generator: torch.Generator) -> None:
        self.codes = torch.zeros(0, dtype=torch.int64, device=generator.device)
        """(C,) numbers of the configurations met, ascending."""
        self.visits = torch.zeros(0, dtype=torch.int64, device=generator.device)
        """(C,) N of each."""

    @staticmethod
    def code(achieved_goal: Tensor) -> Tensor:
        """Numbers (...) of configurations (..., bits). Raises ValueError where there are too many bits."""
        bits = achieved_goal.shape[-1]
        if bits > LARGEST_BITS:
            raise ValueError(f"there are {bits} predicates; counts takes at most {LARGEST_BITS}")
        return (achieved_goal.long() << torch.arange(bits, device=achieved_goal.device)).sum(-1)

    def observe(self, episodes: Collected) -> None:
        """Count where each step led."""
        new, numbers = self.code(episodes.achieved_goals[:, 1:]).unique(return_counts=True)
        self.codes, places = torch.cat([self.codes, new]).unique(return_inverse=True)
        self.visits = torch.zeros_like(self.codes).scatter_add_(0, places, torch.cat([self.visits, numbers]))

    def number_of_visits(self, achieved_goal: Tensor) -> Tensor:
        """N (B,) of configurations (B, bits); 0 where never met."""
        if not len(self.codes):
            return torch.zeros(len(achieved_goal), dtype=torch.int64, device=achieved_goal.device)
        codes = self.code(achieved_goal)
        places = torch.searchsorted(self.codes, codes).clamp(max=len(self.codes) - 1)
        return torch.where(self.codes[places] == codes, self.visits[places], 0)

    @torch.no_grad()
    def reward(self, transitions: Transitions) -> Tensor:
        """r_int (B,)."""
        reached = given(transitions.next_achieved_goal, "next_achieved_goal")
        return self.number_of_visits(reached).clamp(min=1).float().rsqrt()

    def update(self, transitions: Transitions) -> dict[str, Tensor]:
        """Nothing is learned from a batch. Metrics: counts_configurations, how many were met."""
        return {"counts_configurations": torch.tensor(float(len(self.codes)))}

    def state_dict(self) -> dict[str, Any]:
        """The counts."""
        return {"codes": self.codes.clone(), "visits": self.visits.clone()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a `state_dict`."""
        self.codes, self.visits = (state[name].to(self.codes.device, copy=True) for name in ("codes", "visits"))
