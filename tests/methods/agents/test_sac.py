"""SAC: losses by hand, what a curiosity method adds, and when which network learns."""

import copy
import math
from dataclasses import fields, replace

import numpy as np
import pytest
import torch
from agents import Counting, counting, hybrid_of, random_batch, raw_of, sac_of
from layouts import SMALL

from curiobench.check.subject import same as same_state
from curiobench.methods.agents.hybrid import EXPLOIT, EXPLORE
from curiobench.methods.agents.losses import bootstrapped_target, critic_loss, policy_loss, temperature_loss
from curiobench.methods.agents.settings import SACConfig
from curiobench.methods.guard import NonFiniteError
from curiobench.methods.registry import make_agent
from curiobench.methods.reward import Batch, Transitions


def test_losses_by_hand():
    values = torch.tensor([[1.0, 4.0], [3.0, 2.0]])
    log_prob, alpha = torch.tensor([-1.0, 2.0]), torch.tensor(0.5)
    reward = torch.tensor([1.0, 0.0])
    target = bootstrapped_target(reward, values, 0.5, log_prob, alpha)
    assert target.tolist() == [1 + 0.5 * (1 + 0.5), 0.5 * (2 - 1)]
    assert bootstrapped_target(reward, values, 0.5, log_prob, None).tolist() == [1 + 0.5 * 1, 0.5 * 2]
    loss, _ = critic_loss(values, torch.tensor([1.0, 2.0]))
    assert loss.item() == 0.5 * (0 + 4) / 2 + 0.5 * (4 + 0) / 2
    loss, metrics = policy_loss(values, log_prob, alpha)
    assert loss.item() == ((-0.5 - 1) + (1 - 2)) / 2
    assert metrics["entropy"].item() == -0.5
    loss, metrics = policy_loss(values, log_prob, alpha, term=torch.tensor([2.0, 4.0]))
    assert loss.item() == ((0.5 - 1) + (3 - 2)) / 2
    assert metrics["entropy"].item() == -0.5  # without the method's term
    loss, _ = temperature_loss(torch.tensor(2.0), log_prob, target_entropy=-4.0)
    assert loss.item() == -2.0 * (0.5 - 4.0)


def test_target_networks_keep_no_history():
    agent, rng = sac_of(target_every=1), np.random.default_rng(6)
    for _ in range(3):
        agent.update(random_batch(SMALL, 8, rng))
    assert all(weight.grad_fn is None for weight in agent.learner.targets)


def test_state_of_another_kind_of_agent_is_refused():
    state = sac_of().state_dict()
    with pytest.raises(ValueError, match="same curiosity method"):
        sac_of(method=counting()).load_state_dict(state)


def test_tuned_temperature_falls_while_entropy_is_above_target():
    agent, rng = sac_of(tune_temperature=True, temperature=0.5), np.random.default_rng(0)
    agent.learner.target_entropy = -10.0
    metrics = [agent.update(random_batch(SMALL, 8, rng)) for _ in range(5)]
    assert metrics[0]["entropy"] > -10
    assert metrics[-1]["temperature"] < metrics[0]["temperature"]
    fixed = sac_of(temperature=0.5)
    fixed.update(random_batch(SMALL, 8, rng))
    assert fixed.update(random_batch(SMALL, 8, rng))["temperature"].item() == pytest.approx(0.5)


def test_learning_rate_falls_to_a_tenth_and_stays():
    agent, batch = sac_of(learning_rate=0.01, decay_updates=4), random_batch(SMALL, 8, np.random.default_rng(0))
    rates = []
    for _ in range(6):
        agent.update(batch)
        rates.append(agent.learner.optimiser.param_groups[0]["lr"])
    assert rates == pytest.approx([0.01, 0.00775, 0.0055, 0.00325, 0.001, 0.001])


def test_target_critics_move_every_second_update():
    agent, rng = sac_of(polyak=0.25), np.random.default_rng(0)
    before = [p.clone() for p in agent.learner.target_critics.parameters()]
    agent.update(random_batch(SMALL, 8, rng))
    assert all(torch.equal(a, b) for a, b in zip(before, agent.learner.target_critics.parameters(), strict=True))
    agent.update(random_batch(SMALL, 8, rng))
    critics = agent.learner.critics.parameters()
    for old, new, source in zip(before, agent.learner.target_critics.parameters(), critics, strict=True):
        torch.testing.assert_close(new, 0.75 * old + 0.25 * source)


@pytest.mark.parametrize("spec", ["sac", "dac", "dac+hm"])
def test_the_policy_moves_every_other_update_only(spec):
    """Also where a method sees the policy (DAC). An update that moves it is that of an agent that always does."""
    config = SACConfig(hidden=16, actor_every=2, tune_temperature=True)
    agent, always = (
        make_agent(spec, SMALL, settings, torch.Generator().manual_seed(0))
        for settings in (config, replace(config, actor_every=1))
    )
    batches = [random_batch(SMALL, 8, np.random.default_rng(k)) for k in range(3)]
    agent.update(batches[0])
    always.update(batches[0])
    assert same_state(agent.state_dict(), always.state_dict())
    learner = agent.learner
    actor, log_alpha, critics = copy.deepcopy(
        [learner.actor.state_dict(), learner.log_alpha.detach(), learner.critics.state_dict()]
    )
    metrics = agent.update(batches[1])
    assert same_state(learner.actor.state_dict(), actor)
    assert torch.equal(learner.log_alpha, log_alpha)
    assert not same_state(learner.critics.state_dict(), critics)
    assert "critic_loss" in metrics
    assert not {"policy_loss", "entropy", "temperature_loss"} & metrics.keys()
    agent.update(batches[2])
    assert not same_state(learner.actor.state_dict(), actor)


def test_intrinsic_reward_is_normalised_by_the_past_and_taken_before_the_method_learns():
    """r_int is added as a z-score by the batches before this one."""
    method = counting()
    agent, rng = sac_of(method=method, tau=0.5), np.random.default_rng(0)
    first, second = random_batch(SMALL, 8, rng), random_batch(SMALL, 8, rng)
    agent.update(first, epoch=3)
    past = agent.learner.curiosity.moments.state_dict()
    metrics = agent.update(second, epoch=4)
    assert [(updates, seen.epoch) for updates, seen in method.seen] == [(0, 3), (1, 4)]
    raw = (second.next_observation.clamp(-5, 5) - second.observation.clamp(-5, 5)).abs().mean(1)
    z = (raw - past["mean"]) / (past["m2"] / past["count"]).sqrt()
    torch.testing.assert_close(agent.learner.batch.reward, (second.reward + 0.5 * z.clamp(-5, 5)).float())
    assert metrics["counted"] == 2
    assert metrics["intrinsic_raw"].item() == pytest.approx(raw.mean().item())


class Shrinking(Counting):
    """Novelty that wears off, as RND's does."""

    def reward(self, transitions: Transitions) -> torch.Tensor:
        return super().reward(transitions) * 0.97**self.updates


@pytest.mark.parametrize(("window", "alive"), [(10, True), (None, False)])
def test_a_shrinking_reward_keeps_its_weight_only_where_its_statistics_forget(window, alive):
    rng = np.random.default_rng(0)
    agent = sac_of(method=counting(cls=Shrinking), reward_window=window)
    spread = [agent.update(random_batch(SMALL, 64, rng))["bonus_spread"].item() for _ in range(200)]
    assert (min(spread[150:]) > 0.1 * agent.learner.config.tau) == alive


def test_relabelling_does_not_change_what_a_method_sees():
    batch = random_batch(SMALL, 8, np.random.default_rng(0))
    relabelled = Batch(**{**vars(batch), "desired_goal": 1 - batch.desired_goal, "reward": 1 - batch.reward})
    seen = []
    for one in (batch, relabelled):
        method = counting()
        sac_of(method=method).update(one)
        seen.append(method.seen[0][1])
    assert all(same_state(getattr(seen[0], f.name), getattr(seen[1], f.name)) for f in fields(Transitions))


@pytest.mark.parametrize(("make", "moved"), [(sac_of, EXPLOIT), (hybrid_of, EXPLORE)])
def test_a_methods_term_in_the_policy_loss_moves_the_policy_that_collects(make, moved):
    """With `+hm` that is pi_c; pi_d stays as it is."""

    def mean_actions(term: float | None) -> list[float]:
        agent, rng = make(method=counting(term), tau=0.0, temperature=1.0), np.random.default_rng(0)
        for _ in range(60):
            agent.update(random_batch(SMALL, 8, rng))
        inputs = agent.learner.encode(*raw_of(random_batch(SMALL, 64, rng)))
        return [mean.tanh().mean().item() for mean in agent.learner.actor(inputs)[0]]

    with_term, without = mean_actions(10.0), mean_actions(None)
    assert with_term.pop(moved) < without.pop(moved) - 0.3
    assert with_term == without


def test_a_loss_that_is_not_finite_is_named_and_changes_no_weight():
    agent, rng = sac_of(), np.random.default_rng(0)
    agent.update(random_batch(SMALL, 8, rng))
    before, batch = agent.state_dict(), random_batch(SMALL, 8, rng)
    batch.reward[3] = math.nan
    with pytest.raises(NonFiniteError, match=r"update 1: loss not finite: critics \(nan\)"):
        agent.update(batch)
    assert all(same_state(agent.state_dict()[name], before[name]) for name in ("actor", "critics"))
