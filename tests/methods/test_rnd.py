"""RND: values in plain numpy, its networks, and a fixed target."""

import copy

import numpy as np
import torch
from curiosity import fresh, plain, random_transitions, with_random_biases

from curiobench.methods.rnd import RND


def expected(method: RND, next_state: torch.Tensor) -> np.ndarray:
    """Mean over features of (target - predictor)² (B,)."""
    state = next_state.double().numpy()
    return ((plain(method.target, state) - plain(method.predictor, state)) ** 2).mean(1)


def some_method(**config) -> RND:
    method = fresh(RND, features=3, **config)
    return with_random_biases(method, method.target, method.predictor)


def test_reward_and_loss_in_numpy():
    method, batch = some_method(), random_transitions(6)
    values = expected(method, batch.next_state)
    np.testing.assert_allclose(method.reward(batch), values, rtol=1e-4)
    np.testing.assert_allclose(method.update(batch)["rnd_loss"], values.mean(), rtol=1e-4)


def test_predictor_is_deeper_than_the_target_and_both_are_orthogonal():
    method = fresh(RND, sizes=(40, 4), hidden=32, features=16)
    assert len(method.predictor[::2]) == len(method.target[::2]) + 1
    for network in (method.target, method.predictor):
        for layer in network[::2]:
            weight = layer.weight.detach()
            rows = weight @ weight.T if len(weight) <= weight.shape[1] else weight.T @ weight
            torch.testing.assert_close(rows, 2 * torch.eye(len(rows)), atol=1e-5, rtol=0)


def test_training_moves_the_predictor_by_adam_and_never_the_target():
    method, batch = some_method(learning_rate=1e-4), random_transitions(6)
    target, predictor = copy.deepcopy(method.target.state_dict()), copy.deepcopy(method.predictor.state_dict())
    method.update(batch)
    assert all(torch.equal(target[name], value) for name, value in method.target.state_dict().items())
    moved = torch.cat([(v - predictor[n]).abs().flatten() for n, v in method.predictor.state_dict().items()])
    assert 0.9e-4 < moved.max() < 1.1e-4  # Adam's first step is the learning rate, whatever the gradient
