"""RE3: values in plain numpy, an encoder that never changes, rare states that score high."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch
from curiosity import fresh, mutated, plain, random_transitions, shaken, transitions_of
from test_sac import same_state

from curiobench.methods.re3 import RE3


def some_method(cls: type[RE3] = RE3, **config) -> RE3:
    method = fresh(cls, features=3, **config)
    return shaken(method, method.encoder)


def expected(method: RE3, batch, k: int) -> np.ndarray:
    """log(1 + distance to the k-th nearest particle) (B,), one state at a time."""
    features, particles = (plain(method.encoder, s.double().numpy()) for s in (batch.next_state, batch.particles))
    distances = (np.sort(np.linalg.norm(particles - feature, axis=1)) for feature in features)
    return np.array([np.log(1 + nearest[k - 1]) for nearest in distances])


@pytest.mark.parametrize("k", [1, 3])
def test_reward_in_numpy(k):
    method, batch = some_method(k=k, beta=2.0), random_transitions(8)
    np.testing.assert_allclose(method.reward(batch), 2 * expected(method, batch, k), rtol=1e-4)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("distances[:, -1]", "distances[:, -2]"),
        ("(transitions.next_state)", "(transitions.state)"),
        ("(transitions.particles)", "(transitions.next_state)"),
    ],
    ids=["one neighbour too near", "state before the step", "neighbours in the batch"],
)
def test_mistakes_fail_the_values(old, new):
    method, batch = some_method(mutated(RE3, old, new)), random_transitions(8)
    assert not np.allclose(method.reward(batch), expected(method, batch, 3), rtol=0.05)


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


def test_rare_states_score_higher_than_common_ones():
    rng = np.random.default_rng(0)
    states = np.concatenate([0.1 * rng.normal(size=(60, 3)), rng.uniform(-5, 5, (4, 3))])
    rewards = fresh(RE3, hidden=32).reward(transitions_of(states, np.zeros((64, 2)), states))
    assert rewards[60:].min() > 2 * rewards[:60].max()


def test_settings_out_of_range_and_too_few_particles_are_refused():
    with pytest.raises(ValueError, match="decay is 1"):
        RE3.Config(decay=1.0)
    batch = random_transitions(8)
    with pytest.raises(ValueError, match=r"k is 3.* which is 2"):
        fresh(RE3).reward(replace(batch, particles=batch.particles[:2]))
