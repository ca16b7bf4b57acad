"""RE3: values in plain numpy, a decaying weight, and an encoder that never changes."""

import copy

import numpy as np
import pytest
import torch
from curiosity import fresh, plain, random_transitions, with_random_biases

from curiobench.check.subject import same as same_state
from curiobench.methods.re3 import RE3


def some_method(**config) -> RE3:
    method = fresh(RE3, features=3, **config)
    return with_random_biases(method, method.encoder)


def expected(method: RE3, batch, k: int) -> np.ndarray:
    """log(1 + distance to the k-th nearest particle) (B,), one state at a time."""
    features, particles = (plain(method.encoder, s.double().numpy()) for s in (batch.next_state, batch.particles))
    distances = (np.sort(np.linalg.norm(particles - feature, axis=1)) for feature in features)
    return np.array([np.log(1 + nearest[k - 1]) for nearest in distances])


@pytest.mark.parametrize("k", [1, 3])
def test_reward_in_numpy(k):
    method, batch = some_method(k=k, beta=2.0), random_transitions(8)
    np.testing.assert_allclose(method.reward(batch), 2 * expected(method, batch, k), rtol=1e-4)


def test_the_weight_decays_as_over_the_authors_updates():
    """500 of their updates an epoch of a run of 500; the reward itself does not fade."""
    method = some_method(decay=1e-5)
    assert method.bonus_factor(0) == 1
    assert method.bonus_factor(100) == pytest.approx(np.exp(50_000 * np.log1p(-1e-5)))
    early, late = random_transitions(8, epoch=0), random_transitions(8, epoch=400)
    assert torch.equal(method.reward(early), method.reward(late))
    assert method.update(late)["re3_factor"].item() == pytest.approx(method.bonus_factor(400))


def test_encoder_never_changes():
    method = some_method()
    before, batch = copy.deepcopy(method.encoder.state_dict()), random_transitions(8)
    first = method.reward(batch)
    for seed in range(5):
        method.update(random_transitions(8, seed))
    assert same_state(method.encoder.state_dict(), before)
    assert torch.equal(method.reward(batch), first)
    assert not any(weight.requires_grad for weight in method.encoder.parameters())
