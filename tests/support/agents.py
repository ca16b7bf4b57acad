"""Small agents, a curiosity method that can be computed by hand, and batches for both."""

from dataclasses import dataclass

import numpy as np
import torch
from layouts import SMALL

from curiobench.methods.agents.hybrid import HybridAgent
from curiobench.methods.agents.pairs import PairLayout
from curiobench.methods.agents.sac import SAC
from curiobench.methods.agents.settings import HybridConfig, SACConfig
from curiobench.methods.reward import Batch, IntrinsicReward, Transitions


class Counting(IntrinsicReward):
    """Rewards the size of the change of state; counts its updates; optionally adds a term to the policy's loss."""

    @dataclass(frozen=True)
    class Config:
        term: float | None = None
        """Added to log pi."""

    def __init__(self, state_size, action_size, config, generator):
        self.config, self.updates, self.seen = config, 0, []

    def reward(self, transitions: Transitions) -> torch.Tensor:
        self.seen.append((self.updates, transitions))
        return (transitions.next_state - transitions.state).abs().mean(1)

    def update(self, transitions: Transitions) -> dict[str, torch.Tensor]:
        self.updates += 1
        return {"counted": torch.tensor(float(self.updates))}

    def policy_loss_term(self, transitions, desired_goal, action):
        return None if self.config.term is None else self.config.term * action.sum(1)

    def state_dict(self):
        return {"updates": self.updates}

    def load_state_dict(self, state):
        self.updates = state["updates"]


def random_batch(layout: PairLayout, size: int, rng: np.random.Generator) -> Batch:
    """Noise."""

    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    def bits() -> np.ndarray:
        return rng.integers(0, 2, (size, layout.goal_size)).astype(np.uint8)

    return Batch.from_numpy(
        {
            "observation": normal(size, layout.observation_size),
            "action": np.tanh(normal(size, layout.action_size)),
            "next_observation": normal(size, layout.observation_size),
            "achieved_goal": bits(),
            "next_achieved_goal": bits(),
            "desired_goal": bits(),
            "reward": rng.integers(0, 2, size).astype(np.float32),
            **_more(layout, size),
        }
    )


def _more(layout: PairLayout, size: int, steps: int = 5) -> dict[str, np.ndarray]:
    """Particles and episodes, which some methods ask for; the same each time."""
    rng = np.random.default_rng(0)
    return {
        "step": rng.integers(0, steps, size),
        "episode": np.arange(size),
        "particles": rng.normal(size=(512, layout.observation_size)).astype(np.float32),
        "episode_observation": rng.normal(size=(size, steps + 1, layout.observation_size)).astype(np.float32),
        "episode_achieved_goal": rng.integers(0, 2, (size, steps + 1, layout.goal_size)).astype(np.uint8),
    }


def two_state_batch(size: int = 256) -> Batch:
    """State A leads to B with reward 0, B to A with reward 1, whatever the action, of which many are at the bounds."""
    at_b = np.arange(size) % 2 == 1
    observation = np.zeros((size, SMALL.observation_size), np.float32)
    observation[:, 0] = np.where(at_b, 1.0, -1.0)
    bits = np.zeros((size, SMALL.goal_size), np.uint8)
    action = np.random.default_rng(0).uniform(-2, 2, (size, 2)).clip(-1, 1).astype(np.float32)
    return Batch.from_numpy(
        dict(
            observation=observation,
            action=action,
            next_observation=-observation,
            achieved_goal=bits,
            next_achieved_goal=bits,
            desired_goal=bits,
            reward=at_b.astype(np.float32),
        )
    )


def raw_of(batch: Batch) -> list[np.ndarray]:
    """What an agent acts on: observation, achieved goal and desired goal."""
    return [getattr(batch, name).numpy() for name in ("observation", "achieved_goal", "desired_goal")]


def counting(term: float | None = None, cls: type[Counting] = Counting) -> Counting:
    """A method that needs no sizes."""
    return cls(0, 0, Counting.Config(term), None)


def sac_of(method: IntrinsicReward | None = None, **config) -> SAC:
    """A small agent; settings by name."""
    return SAC(SMALL, SACConfig(**{"hidden": 16, **config}), torch.Generator().manual_seed(0), method)


def hybrid_of(method: IntrinsicReward | None = None, **config) -> HybridAgent:
    """A small agent whose curiosity is `Counting` unless given; settings of the mechanism and of the agent by name."""
    names = HybridConfig.__dataclass_fields__
    hybrid = HybridConfig(**{name: config.pop(name) for name in list(config) if name in names})
    generator = torch.Generator().manual_seed(0)
    return HybridAgent(SMALL, SACConfig(**{"hidden": 16, **config}), generator, method or counting(), hybrid)


def step(agent: SAC | HybridAgent, batch: Batch, epoch: int = 0) -> tuple[np.ndarray, dict[str, torch.Tensor]]:
    """Observe, act and learn, as in a run. Returns actions and metrics."""
    agent.observe(*raw_of(batch))
    return agent.act(*raw_of(batch)), agent.update(batch, epoch)
