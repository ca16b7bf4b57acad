"""E3B, RIDE and NGU, whose rewards depend on what the episode met before: values in plain numpy, one at a time."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from curiosity import fresh, plain, random_transitions, with_random_biases

from curiobench.methods.e3b import E3B
from curiobench.methods.ngu import NGU
from curiobench.methods.ride import RIDE


def some_method(cls, **config):
    method = fresh(cls, features=3, **config)
    return with_random_biases(method, method.phi.encoder, method.phi.inverse)


def features_of(method, states: torch.Tensor) -> np.ndarray:
    return plain(method.phi.encoder, states.double().numpy())


def e3b(method: E3B, batch) -> np.ndarray:
    rewards = []
    for i, step in enumerate(batch.step.tolist()):
        features = features_of(method, batch.episode_states[i])
        before = features[: step + 1]
        covariance = method.config.ridge * np.eye(3) + before.T @ before
        rewards.append(features[step + 1] @ np.linalg.inv(covariance) @ features[step + 1])
    return np.array(rewards)


def ride(method: RIDE, batch) -> np.ndarray:
    rewards = []
    for i, step in enumerate(batch.step.tolist()):
        features = features_of(method, batch.episode_states[i])
        goals = batch.episode_achieved_goals[i].tolist()
        visits = goals[: step + 2].count(goals[step + 1])
        rewards.append(np.linalg.norm(features[step + 1] - features[step]) / np.sqrt(visits))
    return np.array(rewards)


def ngu(method: NGU, batch, usual: float) -> np.ndarray:
    rewards, config = [], method.config
    for i, step in enumerate(batch.step.tolist()):
        features = features_of(method, batch.episode_states[i])
        squared = np.sort(((features[: step + 1] - features[step + 1]) ** 2).sum(1))[: config.k]
        kernel = config.epsilon / (np.maximum(squared / usual - config.cluster, 0) + config.epsilon)
        similarity = np.sqrt(kernel.sum()) + config.c
        rewards.append(0 if similarity > config.most else 1 / similarity)
    return np.array(rewards)


def test_e3b_in_numpy():
    method, batch = some_method(E3B, ridge=0.5), random_transitions(8)
    np.testing.assert_allclose(method.reward(batch), e3b(method, batch), rtol=1e-3)


def test_e3b_with_one_hot_features_counts_visits():
    method, batch = fresh(E3B, features=3, ridge=0.25), random_transitions(2)
    method.phi.encoder = torch.nn.Identity()
    states = torch.eye(3)[torch.tensor([[0, 1, 1, 2, 1, 0]] * 2)]
    batch = replace(batch, episode_states=states, step=torch.tensor([3, 4]), next_state=states[[0, 1], [4, 5]])
    assert method.reward(batch).tolist() == pytest.approx([1 / 2.25, 1 / 1.25])


def with_one_predicate(batch):
    """The batch with predicates of which only the first ever holds: an episode comes back to what it had."""
    mask = torch.tensor([1.0, 0, 0, 0])
    goals = {name: getattr(batch, name) * mask for name in ("episode_achieved_goals", "next_achieved_goal")}
    return replace(batch, **goals)


def test_ride_in_numpy():
    method, batch = some_method(RIDE), with_one_predicate(random_transitions(8))
    np.testing.assert_allclose(method.reward(batch), ride(method, batch), rtol=1e-4)
    assert (method.visits(batch) > 1).any()


@pytest.mark.parametrize("k", [2, 10])
def test_ngu_in_numpy(k):
    """The distances of past batches are what is usual."""
    method, batch = some_method(NGU, k=k, epsilon=0.5), random_transitions(8)
    for seed in (1, 2):
        method.update(random_transitions(8, seed))
    usual = float(method.distances.mean)
    assert usual > 0
    np.testing.assert_allclose(method.reward(batch), ngu(method, batch, usual), rtol=1e-3)


def test_the_first_reward_of_ngu_has_the_scale_of_later_ones():
    """Before there are past distances, the batch's own are what is usual."""
    method = some_method(NGU)
    first = method.reward(random_transitions(64)).mean()
    for seed in range(3):
        method.update(random_transitions(64, seed))
    assert 0.5 < first / method.reward(random_transitions(64, 5)).mean() < 2


def test_e3b_stays_finite_with_large_features_that_hardly_change():
    method, batch = some_method(E3B), random_transitions(8)
    method.phi.encoder = torch.nn.Linear(3, 3)
    with torch.no_grad():
        method.phi.encoder.weight.mul_(1e-3)
        method.phi.encoder.bias.fill_(1e4)
    assert method.reward(batch).isfinite().all()


def test_ngu_rewards_nothing_that_the_episode_met_before():
    method, batch = some_method(NGU, most=1.5), random_transitions(8)
    method.update(batch)
    still = batch.state.unsqueeze(1).expand(-1, batch.episode_states.shape[1], -1)
    batch = replace(batch, episode_states=still, next_state=batch.state, step=torch.full((8,), 4))
    assert not method.reward(batch).any()
