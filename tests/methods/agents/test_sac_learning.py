"""SAC in worlds with a known solution: the exact value of two states, and a goal on a line."""

from dataclasses import MISSING, fields

import numpy as np
import torch
from agents import sac_of, two_state_batch
from layouts import SMALL

from curiobench.methods.agents.sac import SAC
from curiobench.methods.reward import Batch


def test_critic_recovers_the_exact_value_of_a_two_state_world():
    gamma, batch = 0.5, two_state_batch()
    agent = sac_of(gamma=gamma, temperature=1e-6, learning_rate=3e-3, polyak=0.2, layer_norm=False)
    for step in range(800):
        agent.learner.optimiser.param_groups[0]["lr"] = 3e-3 * (1 - step / 800)  # to nothing, so that the values settle
        agent.update(batch)
    inputs = agent.learner.encoder.encode(batch.observation, batch.achieved_goal.float(), batch.desired_goal.float())
    values = agent.learner.critics(inputs, batch.action.unsqueeze(0))[:, 0].detach()
    expected = {0.0: gamma / (1 - gamma**2), 1.0: 1 / (1 - gamma**2)}
    exact = torch.tensor([expected[r] for r in batch.reward.tolist()]).expand_as(values)
    error = values - exact
    assert error[:, ::2].mean().abs() < 0.01
    assert error[:, 1::2].mean().abs() < 0.01
    assert error.square().mean().sqrt() < 0.02


class PointWorld:
    """A hand on a line, at x, moves by action[0] / 4. Bit "close" is set where x > 0.5, the other two never."""

    size, steps = 16, 6

    def __init__(self, rng: np.random.Generator) -> None:
        self.x = rng.uniform(-0.9, 0.9, self.size).astype(np.float32)

    def view(self) -> tuple[np.ndarray, np.ndarray]:
        observation = np.zeros((self.size, SMALL.observation_size), np.float32)
        observation[:, 0] = self.x
        goal = np.zeros((self.size, SMALL.goal_size), np.float32)
        goal[:, 0] = self.x > 0.5
        return observation, goal

    def step(self, action: np.ndarray) -> None:
        self.x = np.clip(self.x + 0.25 * action[:, 0], -1, 1)


def run_episode(agent: SAC, rng: np.random.Generator, deterministic: bool) -> tuple[list[dict], float]:
    """Transitions of one episode in all worlds, half of which want the bit set; and the share that succeeds."""
    world, transitions = PointWorld(rng), []
    desired = np.zeros((world.size, SMALL.goal_size), np.float32)
    desired[::2, 0] = 1
    for _ in range(world.steps):
        observation, achieved = world.view()
        action = agent.act(observation, achieved, desired, deterministic)
        world.step(action)
        next_observation, next_achieved = world.view()
        reward = (next_achieved == desired).all(1).astype(np.float32)
        names = [f.name for f in fields(Batch) if f.default is MISSING]
        row = (observation, action, next_observation, achieved, next_achieved, desired, reward)
        transitions.append(dict(zip(names, row, strict=True)))
    return transitions, float(reward.mean())


def test_sac_solves_a_goal_reaching_task():
    rng = np.random.default_rng(0)
    agent, memory = sac_of(gamma=0.9, temperature=0.05, hidden=32, learning_rate=3e-3), []
    before = np.mean([run_episode(agent, rng, deterministic=True)[1] for _ in range(5)])
    for _ in range(40):
        memory += run_episode(agent, rng, deterministic=False)[0]
        agent.observe(memory[-1]["observation"], memory[-1]["achieved_goal"], memory[-1]["desired_goal"])
        for _ in range(10):
            chosen = [memory[k] for k in rng.integers(0, len(memory), 8)]
            agent.update(Batch.from_numpy({n: np.concatenate([c[n] for c in chosen]) for n in chosen[0]}))
    after = np.mean([run_episode(agent, rng, deterministic=True)[1] for _ in range(5)])
    assert after > 0.95 > before
