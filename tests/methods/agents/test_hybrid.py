"""The hybrid mechanism: what it leaves alone, when it switches, and what it learns."""

import math
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from agents import Counting, counting, hybrid_of, random_batch, raw_of, sac_of, step, two_state_batch
from layouts import SMALL

from curiobench.check.subject import same as same_state
from curiobench.methods.agents.agent import LearningAgent
from curiobench.methods.agents.hybrid import EXPLOIT, EXPLORE, PROBE_ACTIONS
from curiobench.methods.agents.pairs import PairInputs
from curiobench.methods.agents.settings import QIntNormalisation
from curiobench.methods.guard import NonFiniteError


def of_policy(agent: LearningAgent, policy: int) -> list[torch.Tensor]:
    """Weights of pi_d, which is SAC's only one, or pi_c."""
    return [weights[policy] for weights in agent.learner.actor.net.parameters()]


@pytest.mark.parametrize("tune_temperature", [False, True])
@pytest.mark.parametrize("tau", [0.0, 0.5])
def test_exploitation_learns_what_sac_learns_from_the_same_batches(tau, tune_temperature):
    """Curiosity reaches neither pi_d nor Q_ext. With tau = 0 pi_c is pi_d, and the agent acts as SAC.

    Up to rounding: products of two policies at once, and Adam's step of two temperatures, may round otherwise.
    """
    sac, hybrid = (make(tune_temperature=tune_temperature, tau=tau) for make in (sac_of, hybrid_of))
    tolerance = {"rtol": 1e-5, "atol": 1e-6}
    sac.learner.generator.set_state(hybrid.learner.generator.get_state())  # building Q_int drew from it
    rng = np.random.default_rng(0)
    for _ in range(6):
        batch = random_batch(SMALL, 8, rng)
        (expected, of_sac), (actions, metrics) = step(sac, batch), step(hybrid, batch)
        torch.testing.assert_close({name: metrics[name] for name in of_sac}, of_sac, **tolerance)
        if tau == 0:
            np.testing.assert_allclose(actions, expected, **tolerance)
    for policy in (EXPLOIT, EXPLORE) if tau == 0 else (EXPLOIT,):
        torch.testing.assert_close(of_policy(hybrid, policy), of_policy(sac, EXPLOIT), **tolerance)
    torch.testing.assert_close([*hybrid.learner.critics.parameters()], [*sac.learner.critics.parameters()], **tolerance)
    np.testing.assert_allclose(hybrid.act(*raw_of(batch), True), sac.act(*raw_of(batch), True), **tolerance)
    assert same_state(of_policy(hybrid, EXPLORE), of_policy(hybrid, EXPLOIT)) == (tau == 0)


class Fading(Counting):
    """Its bonus is worth a quarter in every epoch."""

    def bonus_factor(self, epoch: int) -> float:
        return 0.25


@pytest.mark.parametrize("make", [sac_of, hybrid_of])
def test_a_methods_factor_multiplies_tau_also_after_a_resume(make):
    fading, resumed = (make(method=counting(cls=Fading), tau=2.0) for _ in range(2))
    plain, rng = make(method=counting(), tau=0.5), np.random.default_rng(0)
    for _ in range(4):
        batch = random_batch(SMALL, 8, rng)
        (first, of_fading), (second, of_plain) = step(fading, batch), step(plain, batch)
        np.testing.assert_array_equal(first, second)
        assert of_fading == of_plain
    resumed.load_state_dict(fading.state_dict())
    np.testing.assert_array_equal(resumed.act(*raw_of(batch)), plain.act(*raw_of(batch)))


def chosen(explores_by: QIntNormalisation) -> list[float]:
    """+1 where pi_c acts and -1 where pi_d does; in the first three worlds Q_c - Q_d is -0.1, 0 and 0.1.

    Q_ext is constant in an action, the second critic 9 above the first; Q_int is 0 as a z-score.
    """
    q_d, q_c = torch.tensor([1.0, 1.0, 1.0, 2.0, 0.0]), torch.tensor([0.5, 0.5, 0.5, 1.0, 1.0])
    q_int = torch.tensor([0.8, 1.0, 1.2, 9, -3])
    agent = hybrid_of(tau=0.5, q_int_normalisation=explores_by)
    actions = torch.tensor([-1.0, 1.0]).view(2, 1, 1).expand(2, 5, SMALL.action_size)

    def critics(inputs: PairInputs, asked: torch.Tensor) -> torch.Tensor:
        value = torch.where(asked[..., 0] < 0, q_d, q_c)
        return torch.stack([value, value + 9])

    def intrinsic_values(state: torch.Tensor, asked: torch.Tensor) -> torch.Tensor:
        assert (asked == 1).all()  # pi_c's
        return torch.stack([q_int, torch.zeros(5)]).unsqueeze(1)

    agent.learner.actor = SimpleNamespace(sample=lambda inputs, noise: (actions, torch.zeros(2, 5)))
    agent.learner.critics, agent.intrinsic_values = critics, intrinsic_values
    return agent.act(*raw_of(random_batch(SMALL, 5, np.random.default_rng(0))))[:, 0].tolist()


def test_switch_follows_equation_15():
    assert chosen("popart") == [-1, 1, 1, 1, -1]
    assert chosen("zscore") == [-1, -1, -1, -1, 1]


def test_share_of_exploitation_counts_steps_since_the_last_update_that_followed_some():
    agent, batch = hybrid_of(tau=0.5), random_batch(SMALL, 8, np.random.default_rng(0))
    assert "share_exploitation" not in agent.update(batch)

    def act(q_int: float, times: int) -> None:
        agent.intrinsic_values.net.out_bias.data.fill_(q_int)
        for _ in range(times):
            agent.act(*raw_of(batch))

    act(1e3, 1)  # explores
    act(-1e3, 3)  # exploits
    agent.act(*raw_of(batch), deterministic=True)  # is not counted
    for _ in range(2):  # an epoch's mean over updates is then its mean over cycles
        assert agent.update(batch)["share_exploitation"] == 0.75
    act(-1e3, 1)
    assert agent.update(batch)["share_exploitation"] == 1


def test_spreads_over_actions_are_measured_in_states_of_the_first_batch_after_each_collection():
    agent, rng = hybrid_of(tau=0.3), np.random.default_rng(0)
    first, second = random_batch(SMALL, 8, rng), random_batch(SMALL, 8, rng)
    for batch in (first, second):
        agent.act(*raw_of(batch))
        found = agent.update(batch)
    inputs = agent.learner.encoder.encode(*map(torch.as_tensor, raw_of(first)))
    shape = (PROBE_ACTIONS, 8, SMALL.action_size)
    actions = torch.rand(shape, generator=torch.Generator().manual_seed(0)) * 2 - 1
    with torch.no_grad():
        q_ext = [agent.learner.critics(inputs, a[None]).amin(0)[0].numpy() for a in actions]
        q_int = [agent.intrinsic_values(inputs.state, a[None])[0, 0].numpy() for a in actions]
    assert found["q_ext_action_spread"] == pytest.approx(np.std(q_ext, axis=0).mean(), rel=1e-4)
    assert found["q_int_action_spread"] == pytest.approx(0.3 * np.std(q_int, axis=0).mean(), rel=1e-4)
    assert agent.update(second)["q_ext_action_spread"] == found["q_ext_action_spread"]  # nothing was collected since


@pytest.mark.parametrize("adaptive", [False, True])
def test_adaptive_tau_steers_the_spread_of_q_int_to_its_share_of_that_of_q_ext(adaptive):
    """On constructed values of known spreads, also after a resume; a fixed tau stays."""
    options = {"tau": 0.2, "adaptive_tau": adaptive, "spread_ratio": 0.25, "tau_rate": 0.5}
    agents = [hybrid_of(**options), hybrid_of(**options)]
    rng = np.random.default_rng(0)
    for cycle in range(12):
        agent = agents[cycle > 5]
        if cycle == 6:
            agent.load_state_dict(agents[0].state_dict())
        batch = random_batch(SMALL, 8, rng)
        agent.act(*raw_of(batch))
        agent._measured = {}
        with pytest.MonkeyPatch.context() as patch:  # Q_ext spreads by 3, Q_int by 0.1 over the tried actions
            for holder, name, size in ((agent.learner, "critics", 3.0), (agent, "intrinsic_values", 0.1)):
                patch.setattr(holder, name, lambda _, tried, size=size: alternating(tried, size))
            agent._probe = torch.zeros(1, 8, SMALL.observation_size + 2 * SMALL.goal_size)
            agent._measure(batch)
    found = agent._measured
    assert found["q_ext_action_spread"] == pytest.approx(3)
    assert found["tau"] == pytest.approx(0.25 * 3 / 0.1 if adaptive else 0.2, rel=0.01)
    assert found["q_int_action_spread"] == pytest.approx(0.1 * found["tau"])


def alternating(tried: torch.Tensor, size: float) -> torch.Tensor:
    """Two equal values of actions (K, B, A): plus and minus `size` in turns."""
    signs = torch.ones(tried.shape[:2])
    signs[::2] = -1
    return (size * signs).expand(2, -1, -1)


def test_evaluation_is_pi_d_alone_and_draws_and_counts_nothing():
    agent, raw = hybrid_of(), raw_of(random_batch(SMALL, 6, np.random.default_rng(0)))
    before = agent.state_dict()
    action = agent.act(*raw, deterministic=True)
    assert same_state(agent.state_dict(), before)
    assert (action.shape, action.dtype) == ((6, 2), np.float32)
    with torch.no_grad():
        for weights in of_policy(agent, EXPLORE):
            weights.add_(1.0)
        agent.intrinsic_values.net.out_bias.add_(100.0)
    np.testing.assert_array_equal(agent.act(*raw, deterministic=True), action)
    assert not np.array_equal(agent.act(*raw), action)


def test_no_loss_reaches_the_weights_of_another():
    agent, caught = hybrid_of(tune_temperature=True, tau=0.5), {}
    agent.update(random_batch(SMALL, 8, np.random.default_rng(0)))  # so that pi_c and pi_d differ
    agent.learner.descend = lambda found, acts: caught.update({name: loss for name, (loss, _) in found.items()}) or {}
    agent.update(random_batch(SMALL, 8, np.random.default_rng(1)))
    policies, alphas = [*agent.learner.actor.parameters()], [agent.learner.log_alpha]
    groups = {"critics": [*agent.learner.critics.parameters()], "q_int": [*agent.intrinsic_values.net.parameters()]}
    for policy, name in ((EXPLOIT, ""), (EXPLORE, "explorer_")):
        groups |= {f"{name}policy": (policies, policy), f"{name}temperature": (alphas, policy)}
    assert caught.keys() == groups.keys()
    for loss_name, loss in caught.items():
        for name, weights in groups.items():
            weights, member = weights if isinstance(weights, tuple) else (weights, slice(None))
            found = torch.autograd.grad(loss, weights, retain_graph=True, allow_unused=True)
            reached = any(gradient is not None and gradient[member].any() for gradient in found)
            assert reached == (name == loss_name), (loss_name, name)


class Offset(Counting):
    """Rewards where a transition leads: r_int is 3.5 into B, 2.5 into A."""

    def reward(self, transitions):
        return 3.0 + 0.5 * transitions.next_state[:, 0].sign()


def test_q_int_recovers_the_exact_value_of_a_two_state_world():
    gamma, batch = 0.5, two_state_batch(64)
    settings = {"learning_rate": 3e-3, "polyak": 0.5, "layer_norm": False, "popart_rate": 0.05}
    agent = hybrid_of(method=counting(cls=Offset), gamma=gamma, **settings)
    for count in range(600):
        rate = 3e-3 * min(1, 2 - count / 300)  # to nothing, so that the values settle
        agent.learner.optimiser.param_groups[0]["lr"] = rate
        agent.update(batch)
    found = agent.q_int(batch.observation.numpy(), batch.action.numpy())
    level, half = 3 / (1 - gamma), 0.5 / (1 + gamma)  # of 3, 3, 3, … and of 0.5, -0.5, 0.5, …
    for name, at_a, at_b in (("raw", level + half, level - half), ("popart", 1, -1), ("zscore", 2 * half, -2 * half)):
        assert found[name][::2].mean() == pytest.approx(at_a, abs=0.15)
        assert found[name][1::2].mean() == pytest.approx(at_b, abs=0.15)
        assert found[name][::2].mean() - found[name][1::2].mean() == pytest.approx(at_a - at_b, rel=0.1)


def test_targets_of_q_int_by_hand_and_rescaling_of_both_networks():
    values = hybrid_of(gamma=0.5).intrinsic_values
    generator = torch.Generator().manual_seed(1)
    state, action = torch.randn(4, SMALL.observation_size, generator=generator), torch.zeros(4, SMALL.action_size)
    values.popart.mean.fill_(100.0), values.popart.variance.fill_(4.0)
    popart, zscore = (float(out) for out in values._outputs(values.target_net, state, action.unsqueeze(0))[:, 0, 2])
    targets = values.targets(state, action, torch.full((4,), 7.0), torch.full((4,), -1.0))
    assert targets[:, 2].tolist() == pytest.approx([7 + 0.5 * (100 + 2 * popart), -1 + 0.5 * zscore])

    def outputs() -> torch.Tensor:
        """Q_int and Q^n_r_int of both networks (4, B)."""
        found = [values._outputs(net, state, action.unsqueeze(0))[:, 0] for net in (values.net, values.target_net)]
        return torch.cat([torch.stack([values.popart.denormalise(both[0]), both[1].double()]) for both in found])

    before = outputs()
    adapted = values.adapt(targets)
    torch.testing.assert_close(outputs(), before, rtol=1e-5, atol=1e-4)
    torch.testing.assert_close(adapted[0], values.popart.normalise(targets[0]).float())


def test_a_target_that_is_not_finite_stops_before_it_reaches_any_weight():
    agent, batch = hybrid_of(), random_batch(SMALL, 8, np.random.default_rng(0))
    agent.update(batch)
    before = agent.state_dict()
    agent.intrinsic_values.targets = lambda *_: torch.full((2, 8), math.nan)
    with pytest.raises(NonFiniteError, match=r"update 1: loss not finite: target of q_int \(nan\)"):
        agent.update(batch)
    after = agent.state_dict()
    assert all(same_state(after[name], before[name]) for name in ("actor", "critics", "intrinsic_values", "optimiser"))


def test_page_gives_the_logged_names():
    page = (Path(__file__).parents[3] / "docs" / "methods" / "hm.md").read_text()
    batch = random_batch(SMALL, 8, np.random.default_rng(0))
    of_sac = sac_of(method=counting(), tune_temperature=True).update(batch).keys()
    own = step(hybrid_of(tune_temperature=True), batch)[1].keys() - of_sac
    assert set(re.findall(r"^\| `(\w+)` \| [^|]+ \|$", page, re.MULTILINE)) == own
