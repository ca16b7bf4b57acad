"""ICM: values in plain numpy, and which loss trains the encoder."""

import copy

import numpy as np
import pytest
import torch
from curiosity import fresh, plain, random_transitions, with_random_biases

from curiobench.methods.icm import ICM


def some_method(**config) -> ICM:
    method = fresh(ICM, features=3, **config)
    return with_random_biases(method, method.phi.encoder, method.phi.inverse, method.forward)


def squared_errors(method: ICM, batch) -> tuple[np.ndarray, np.ndarray]:
    """Of the forward model, summed over features (B,); of the inverse model, each number (B, A)."""
    state, action, next_state = (t.double().numpy() for t in (batch.state, batch.action, batch.next_state))
    features, next_features = plain(method.phi.encoder, state), plain(method.phi.encoder, next_state)
    predicted = plain(method.forward, np.hstack([features, action]))
    guessed = plain(method.phi.inverse, np.hstack([features, next_features]))
    return ((predicted - next_features) ** 2).sum(1), (guessed - action) ** 2


def test_reward_and_losses_in_numpy():
    method, batch = some_method(eta=0.5), random_transitions(6)
    forward, inverse = squared_errors(method, batch)
    np.testing.assert_allclose(method.reward(batch), 0.5 / 2 * forward, rtol=1e-4)
    metrics = method.update(batch)
    np.testing.assert_allclose(metrics["icm_forward_loss"], forward.mean() / 2, rtol=1e-4)
    np.testing.assert_allclose(metrics["icm_inverse_loss"], inverse.mean(), rtol=1e-4)


@pytest.mark.parametrize("joint", [True, False])
def test_forward_loss_trains_the_encoder_only_where_asked(joint):
    """With beta = 1 there is no other loss."""
    method = some_method(beta=1.0, forward_trains_encoder=joint)
    before = copy.deepcopy(method.phi.encoder.state_dict())
    method.update(random_transitions(6))
    unmoved = all(torch.equal(before[name], value) for name, value in method.phi.encoder.state_dict().items())
    assert unmoved is not joint


def test_features_shrink_together_where_the_forward_loss_trains_them():
    """Why that is not the default: on noise, where nothing can be learned, the reward falls nevertheless."""

    def left(joint: bool) -> float:
        method = fresh(ICM, forward_trains_encoder=joint, beta=0.9, hidden=16)
        seen = random_transitions(64, seed=1)
        before = method.reward(seen).mean()
        for k in range(200):
            method.update(random_transitions(64, seed=100 + k))
        return float(method.reward(seen).mean() / before)

    assert left(joint=True) < 0.2 * left(joint=False)
