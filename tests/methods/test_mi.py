"""MI: values in plain numpy over several batches, its growing conservativeness, and its density."""

import math

import numpy as np
import pytest
import torch
from curiosity import fresh, plain, random_transitions, transitions_of, with_random_biases

from curiobench.methods.mi import MI

CAP_EPOCH = 120
"""First epoch in which 1 - 0.99^epoch exceeds 0.7."""


def curiosity(batch, k: int, m: float) -> np.ndarray:
    """r_H (B,), one state at a time (Eq. 9)."""
    particles = batch.particles.double().numpy()
    distances = (np.sort(np.linalg.norm(particles - state, axis=1)) for state in batch.next_state.double().numpy())
    return np.array([np.log(m + nearest[:k].mean()) for nearest in distances])


def conservativeness(method: MI, batch, m: float) -> np.ndarray:
    """r_C (B,), the density as a product over dimensions (Eq. 10)."""
    state, action, next_state = (t.double().numpy() for t in (batch.state, batch.action, batch.next_state))
    mean, raw = np.split(plain(method.density, np.hstack([state, action])), 2, axis=1)
    low, high = method.config.min_log_std, method.config.max_log_std
    std = np.exp((low + high) / 2 + (high - low) / 2 * np.tanh(raw))
    density = np.exp(-0.5 * ((next_state - mean) / std) ** 2) / (std * np.sqrt(2 * np.pi))
    return np.log(m + density.prod(1))


@pytest.mark.parametrize(("k", "m"), [(3, 0.01), (3, 1.0), (1, 1.0), (2, 0.5)])
def test_rewards_of_three_batches_in_numpy(k, m):
    """From the weights and all past parts. A small m makes r_C vary by more than the least spread."""
    method, given, wanted, past = fresh(MI, k=k, m=m, xi=0.5, beta=0.9), [], [], []
    with_random_biases(method, method.density)
    for seed, epoch in ((0, 1), (1, 2), (2, 7)):
        batch = random_transitions(8, seed, epoch)
        parts = curiosity(batch, k, m), conservativeness(method, batch, m)
        sigma = [np.concatenate(p).std() for p in zip(*past, strict=True)] if past else (1.0, 1.0)
        wanted.append(parts[0] + min(1 - 0.5**epoch, 0.9) * sigma[0] / max(sigma[1], 0.1) * parts[1])
        given.append(method.reward(batch).numpy())
        method.update(batch)
        past.append(parts)
    np.testing.assert_allclose(given, wanted, rtol=1e-4)


def test_metrics_are_those_of_the_reward():
    method, batch = fresh(MI), random_transitions(8, epoch=5)
    method.update(random_transitions(8, seed=1))
    reward, metrics = method.reward(batch).mean(), method.update(batch)
    parts = metrics["mi_curiosity"] + metrics["mi_weight"] * metrics["mi_conservativeness"]
    assert reward.item() == pytest.approx(parts.item(), rel=1e-5)


def test_weight_starts_at_zero_and_rises_to_its_cap():
    method = fresh(MI)
    weights = [method.weight(epoch).item() for epoch in range(150)]
    assert weights[:3] == pytest.approx([0, 0.01, 1 - 0.99**2])
    assert weights == sorted(weights)
    assert weights[CAP_EPOCH - 1] < 0.7
    assert weights[CAP_EPOCH:] == pytest.approx([0.7] * 30)
    batch = random_transitions(8, epoch=0)
    torch.testing.assert_close(method.reward(batch), method.curiosity(batch))


def test_a_density_that_is_still_flat_gives_no_transition_a_huge_weight():
    """r_C of 40 dimensions is 0 to float precision at first, and so is its spread: nothing to divide by."""
    method = fresh(MI, sizes=(40, 2))
    noise = np.random.default_rng(0).normal(size=(3, 64, 40))
    batch = transitions_of(noise[0], noise[1, :, :2], noise[2], epoch=CAP_EPOCH)
    assert max(method.update(batch)["mi_weight"].item() for _ in range(3)) < 5


def test_sharp_densities_of_many_dimensions_stay_finite():
    zeros, method = np.zeros((8, 200)), fresh(MI, sizes=(200, 2))
    with torch.no_grad():
        method.density[-1].weight.zero_()
        method.density[-1].bias[200:] = -20.0
    assert method.reward(transitions_of(zeros, zeros[:, :2], zeros, CAP_EPOCH)).isfinite().all()


def test_density_learns_mean_and_spread_by_maximum_likelihood():
    rng, method = np.random.default_rng(0), fresh(MI, sizes=(1, 1), hidden=32)
    noise = {-1: 0.5, 1: 0.1}  # by action

    def batch(size: int):
        action = rng.choice([-1, 1], (size, 1))
        spread = np.where(action < 0, noise[-1], noise[1])
        return transitions_of(np.zeros((size, 1)), action, 2 * action + spread * rng.normal(size=(size, 1)))

    for _ in range(1500):
        loss = method.update(batch(64))["mi_density_loss"]
    assert loss.isfinite()
    for action, std in noise.items():
        best = -np.log(std * math.sqrt(2 * math.pi)) - 0.5  # expected log-likelihood under the truth
        test = batch(4000)
        chosen = test.action[:, 0] == action
        assert method.log_density(test)[chosen].mean().item() == pytest.approx(best, abs=0.1)
