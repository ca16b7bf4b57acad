"""Visit counts over semantic configurations: the plain count bonus (Strehl and Littman 2008, MBIE-EB).

    c     a configuration: the predicates that hold in a state
    N(c)  number of collected steps that led to c
    r_int = 1 / sqrt(max(1, N(c')))                    c' after the step

The tasks' predicates are prior knowledge of what matters, like the image hash in #Exploration (Tang et al. 2017,
arXiv 1611.04717). So this is a baseline. Its comparison with methods that only get the state is not a fair one.

Collected steps are counted. Samples from the replay are not.
"""

from typing import Any

import torch
from torch import Tensor

from curiobench.methods.curriculum import NoSettings
from curiobench.methods.reward import Collected, IntrinsicReward, Transitions, given


class Counts(IntrinsicReward):
    """A bonus for configurations that were seldom reached."""

    Config = NoSettings

    def __init__(self, state_size: int, action_size: int, config: NoSettings, generator: torch.Generator) -> None:
        self.codes = torch.zeros(0, dtype=torch.int64, device=generator.device)
        """(C,) codes of the configurations reached so far, ascending."""
        self.visits = torch.zeros(0, dtype=torch.int64, device=generator.device)
        """(C,) N of each configuration."""

    @staticmethod
    def code(achieved_goal: Tensor) -> Tensor:
        """Integer codes (...) of configurations (..., bits), of at most 62 bits; five blocks have 30."""
        return (achieved_goal.long() << torch.arange(achieved_goal.shape[-1], device=achieved_goal.device)).sum(-1)

    def observe(self, episodes: Collected) -> None:
        """Count the configuration that each step led to."""
        new, numbers = self.code(episodes.achieved_goals[:, 1:]).unique(return_counts=True)
        self.codes, places = torch.cat([self.codes, new]).unique(return_inverse=True)
        self.visits = torch.zeros_like(self.codes).scatter_add_(0, places, torch.cat([self.visits, numbers]))

    def number_of_visits(self, achieved_goal: Tensor) -> Tensor:
        """N (B,) of configurations (B, bits); 0 for one that was never reached."""
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
        """Learn nothing from a batch. Metrics: counts_configurations, the number of configurations reached so far."""
        return {"counts_configurations": torch.tensor(float(len(self.codes)))}

    def state_dict(self) -> dict[str, Any]:
        """The counts."""
        return {"codes": self.codes.clone(), "visits": self.visits.clone()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a `state_dict`."""
        self.codes, self.visits = (state[name].to(self.codes.device, copy=True) for name in ("codes", "visits"))
