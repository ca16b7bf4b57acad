"""Small curiosity methods, transitions for them, and their networks in plain numpy."""

import numpy as np
import torch

from curiobench.methods.registry import parse_spec
from curiobench.methods.reward import IntrinsicReward, PolicyView, Transitions
from curiobench.methods.specs import BUILT_IN

STATE, ACTION, GOAL = 3, 2, 4
"""Sizes of states, actions and goals."""
STEPS = 5
"""Length of episodes."""
PARTICLES = 12
"""States among which a method looks for neighbours."""
REWARDS = {spec: parse_spec(spec).reward for spec, method in BUILT_IN.items() if method.rewards}
"""Classes of the built-in curiosity methods."""


def transitions_of(state, action, next_state, epoch: int = 0, policy: PolicyView | None = None) -> Transitions:
    """From anything that numpy reads, in float32; the next states are the particles, too."""
    tensors = [torch.as_tensor(np.asarray(array), dtype=torch.float32) for array in (state, action, next_state)]
    return Transitions(*tensors, epoch, policy, particles=tensors[-1])


def random_transitions(size: int = 8, seed: int = 0, epoch: int = 3) -> Transitions:
    """Noise, with a random policy."""
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> torch.Tensor:
        return torch.tensor(rng.normal(size=shape), dtype=torch.float32)

    goals = torch.tensor(rng.integers(0, 2, (size, GOAL)), dtype=torch.float32)
    policy = PolicyView(goals, normal(size, ACTION).tanh(), normal(size), normal(size))
    parts = normal(size, STATE), normal(size, ACTION).tanh(), normal(size, STATE).clamp(-5, 5)
    particles = normal(PARTICLES, STATE).clamp(-5, 5)
    rows, step = torch.arange(size), torch.tensor(rng.integers(0, STEPS, size))
    states, goals = normal(size, STEPS + 1, STATE), torch.tensor(rng.integers(0, 2, (size, STEPS + 1, GOAL))).float()
    states[rows, step], states[rows, step + 1] = parts[0], parts[2]
    return Transitions(
        *parts,
        epoch,
        policy,
        particles,
        achieved_goal=goals[rows, step],
        next_achieved_goal=goals[rows, step + 1],
        raw_state=parts[0],
        raw_next_state=parts[2],
        step=step,
        episode=rows,
        episode_states=states,
        episode_achieved_goals=goals,
    )


def fresh(method: type[IntrinsicReward], seed: int = 0, sizes: tuple[int, int] = (STATE, ACTION), **config):
    """A method with small networks unless `config` says otherwise."""
    config = ({"hidden": 8} if "hidden" in method.Config.__dataclass_fields__ else {}) | config
    goals = {"goal_size": GOAL} if method.uses_policy else {}
    return method(*sizes, method.Config(**config), torch.Generator().manual_seed(seed), **goals)


def with_random_biases(method: IntrinsicReward, *networks: torch.nn.Module) -> IntrinsicReward:
    """The method, with random biases in these networks, which start at zero."""
    generator = torch.Generator().manual_seed(9)
    for network in networks:
        for layer in network[::2]:
            layer.bias.data.normal_(generator=generator)
    return method


def plain(network: torch.nn.Sequential, inputs: np.ndarray) -> np.ndarray:
    """Outputs of a perceptron, computed in numpy and float64."""
    layers = [(layer.weight.detach().double().numpy(), layer.bias.detach().double().numpy()) for layer in network[::2]]
    for weight, bias in layers[:-1]:
        inputs = np.maximum(inputs @ weight.T + bias, 0)
    weight, bias = layers[-1]
    return inputs @ weight.T + bias
