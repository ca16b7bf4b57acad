"""DAC: values in plain numpy, the ratio against the truth, alpha's range, and its view of the agent's policy."""

import numpy as np
import pytest
import torch
from agents import random_batch
from curiosity import ACTION, GOAL, STATE, fresh, plain, random_transitions, with_random_biases
from layouts import SMALL
from torch.distributions import Normal

from curiobench.methods.agents.networks import squashed_gaussian, squashed_log_prob
from curiobench.methods.agents.sac import SAC
from curiobench.methods.agents.settings import SACConfig
from curiobench.methods.dac import DAC
from curiobench.methods.reward import PolicyView, Transitions


def some_method(**config) -> DAC:
    method = fresh(DAC, **config)
    networks = [method.ratio] + ([method.alpha_network] if method.alpha_network is not None else [])
    return with_random_biases(method, *networks)


def values(method: DAC, batch: Transitions) -> dict[str, np.ndarray]:
    """R at the policy's and at stored actions, alpha, log densities, each (B,), and what follows from them."""
    state, goal = batch.state.double().numpy(), batch.policy.desired_goal.double().numpy()

    def ratio(action: torch.Tensor) -> np.ndarray:
        return 1 / (1 + np.exp(-plain(method.ratio, np.hstack([state, goal, action.double().numpy()]))[:, 0]))

    alpha = np.full(len(state), method.config.alpha)
    if method.config.adapt_alpha:
        alpha = 0.5 + 0.49 / (1 + np.exp(-plain(method.alpha_network, state)[:, 0]))
    own, stored = ratio(batch.policy.action), ratio(batch.action)
    of_policy = np.log(own) - np.log(alpha) - batch.policy.log_prob.double().numpy()
    of_buffer = np.log(stored) - np.log(alpha) - batch.policy.stored_log_prob.double().numpy()
    clipped = np.clip(of_buffer, -ACTION, ACTION)
    return {
        "own": own,
        "reward": clipped,
        "ratio_loss": -(alpha * np.log(own) + (1 - alpha) * np.log(1 - stored)).mean(),
        "alpha_loss": (alpha * of_policy + (1 - alpha) * clipped + 2 * ACTION * alpha).mean(),
    }


@pytest.mark.parametrize("config", [{}, {"alpha": 0.8}, {"adapt_alpha": True}])
def test_rewards_and_losses_in_numpy(config):
    method, batch = some_method(**config), random_transitions(8)
    wanted = values(method, batch)
    np.testing.assert_allclose(method.reward(batch), wanted["reward"], rtol=1e-4)
    term = method.policy_loss_term(batch, batch.policy.desired_goal, batch.policy.action)
    np.testing.assert_allclose(term.detach(), -np.log(wanted["own"]), rtol=1e-4)
    metrics = method.update(batch)
    np.testing.assert_allclose(metrics["dac_ratio_loss"], wanted["ratio_loss"], rtol=1e-4)
    assert ("dac_alpha_loss" in metrics) == method.config.adapt_alpha
    if method.config.adapt_alpha:
        np.testing.assert_allclose(metrics["dac_alpha_loss"], wanted["alpha_loss"], rtol=1e-4)


def trained_on(alpha: float, own_mean: float, stored_mean: float) -> tuple[torch.Tensor, torch.Tensor]:
    """R on a grid of first actions, after training on normal actions of these means; and the true ratio."""
    method, generator = fresh(DAC, alpha=alpha, hidden=32, learning_rate=3e-3), torch.Generator().manual_seed(0)
    state, goal, zeros = torch.zeros(256, STATE), torch.zeros(256, GOAL), torch.zeros(256)
    for _ in range(400):
        own, stored = torch.randn(2, 256, ACTION, generator=generator).mul(0.5)
        policy = PolicyView(goal, own + own_mean, zeros, zeros)
        method.update(Transitions(state, stored + stored_mean, state, 0, policy))
    action = torch.zeros(9, ACTION)
    action[:, 0] = torch.linspace(-0.8, 0.8, 9)
    log_pi, log_q = (Normal(mean, 0.5).log_prob(action).sum(1) for mean in (own_mean, stored_mean))
    true = alpha * log_pi.exp() / (alpha * log_pi.exp() + (1 - alpha) * log_q.exp())
    return method.logit(state[:9], goal[:9], action).sigmoid().detach(), true


@pytest.mark.parametrize(("alpha", "distance"), [(0.5, 0.0), (0.8, 0.0), (0.5, 0.6)])
def test_ratio_tends_to_the_truth(alpha, distance):
    """That is alpha where policy and buffer agree."""
    found, true = trained_on(alpha, distance / 2, -distance / 2)
    assert (true - alpha).abs().max() < 1e-6 if distance == 0 else (true.min() < 0.2 and true.max() > 0.8)
    torch.testing.assert_close(found, true, atol=0.1, rtol=0)


def test_adapted_alpha_keeps_its_range_and_leaves_the_ratio_alone():
    method, batch = some_method(adapt_alpha=True), random_transitions(8)
    log_alpha = method.log_alpha(batch.state)
    own, stored = torch.zeros(8, requires_grad=True), torch.zeros(8)
    loss = method.alpha_loss(log_alpha, own.detach(), stored, batch.policy)
    assert all(g is None for g in torch.autograd.grad(loss, list(method.ratio.parameters()), allow_unused=True))
    for bias, limit in ((-50.0, 0.5), (50.0, 0.99)):
        method.alpha_network[-1].bias.data.fill_(bias)
        torch.testing.assert_close(method.log_alpha(batch.state).exp(), torch.full((8,), limit))


def test_policy_loss_term_reaches_the_policy_through_its_action():
    method, batch = some_method(), random_transitions(8)
    action = batch.policy.action.clone().requires_grad_()
    method.policy_loss_term(batch, batch.policy.desired_goal, action).sum().backward()
    assert action.grad.abs().min() > 0


def test_log_density_of_given_actions_is_that_of_sampling_them():
    mean, log_std, noise = torch.randn(3, 5, ACTION, generator=torch.Generator().manual_seed(0)).mul(0.5)
    action, log_prob = squashed_gaussian(mean, log_std, noise)
    torch.testing.assert_close(squashed_log_prob(mean, log_std, action), log_prob, atol=1e-3, rtol=1e-4)
    assert squashed_log_prob(mean, log_std, torch.ones(5, ACTION)).isfinite().all()


def test_agent_shows_its_policy_at_the_weights_it_learns_from(monkeypatch):
    generator, rng, seen = torch.Generator().manual_seed(0), np.random.default_rng(0), []
    method = DAC(SMALL.observation_size, SMALL.action_size, DAC.Config(hidden=8), generator, SMALL.goal_size)
    agent = SAC(SMALL, SACConfig(hidden=8), generator, method)
    reward = method.reward
    monkeypatch.setattr(method, "reward", lambda transitions: seen.append(transitions) or reward(transitions))
    batch = random_batch(SMALL, 6, rng)
    inputs = agent.learner.encoder.encode(batch.observation, batch.achieved_goal.float(), batch.desired_goal.float())
    (mean,), (log_std,) = (tensor.detach() for tensor in agent.learner.actor(inputs))
    agent.update(batch)
    view = seen[0].policy
    assert torch.equal(view.desired_goal, batch.desired_goal.float())
    torch.testing.assert_close(view.stored_log_prob, squashed_log_prob(mean, log_std, batch.action))
    torch.testing.assert_close(view.log_prob, squashed_log_prob(mean, log_std, view.action), atol=1e-3, rtol=1e-4)
    assert not any(t.requires_grad for t in (view.action, view.log_prob, view.stored_log_prob))
