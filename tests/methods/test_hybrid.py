"""The hybrid mechanism: what it leaves alone, when it switches, what it learns, and continuation to the bit."""

import io
import math
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from curiosity import mutated
from layouts import SMALL
from test_sac import Counting, agent_of, random_batch, same_state
from test_sac_learning import two_state_batch

from curiobench.methods.agents.agent import LearningAgent
from curiobench.methods.agents.hybrid import EXPLOIT, EXPLORE, PROBE_ACTIONS, HybridAgent
from curiobench.methods.agents.pairs import PairInputs
from curiobench.methods.agents.sac import SAC
from curiobench.methods.agents.settings import HybridConfig, SACConfig
from curiobench.methods.guard import NonFiniteError
from curiobench.methods.reward import Batch


def hybrid_of(seed: int = 0, cls: type[HybridAgent] = HybridAgent, term: float | None = None, **config) -> HybridAgent:
    """A small agent whose curiosity is `Counting`; settings of the mechanism and of the agent by name."""
    names = HybridConfig.__dataclass_fields__
    hybrid = HybridConfig(**{name: config.pop(name) for name in list(config) if name in names})
    method = Counting(SMALL.observation_size, SMALL.action_size, Counting.Config(term), None)
    generator = torch.Generator().manual_seed(seed)
    return cls(SMALL, SACConfig(**{"hidden": 16, **config}), generator, method, hybrid)


def raw_of(batch: Batch) -> list[np.ndarray]:
    return [getattr(batch, name).numpy() for name in ("observation", "achieved_goal", "desired_goal")]


def of_policy(agent: LearningAgent, policy: int) -> list[torch.Tensor]:
    """Weights of pi_d, which is SAC's only one, or pi_c."""
    return [weights[policy] for weights in agent.learner.actor.net.parameters()]


def equal(first, second) -> bool:
    return all(torch.equal(a, b) for a, b in zip(first, second, strict=True))


def step(agent, batch: Batch) -> tuple[np.ndarray, dict[str, torch.Tensor]]:
    """What a run does with an agent: look, act, learn. Returns actions and metrics."""
    agent.observe(*raw_of(batch))
    return agent.act(*raw_of(batch)), agent.update(batch)


@pytest.mark.parametrize("tune_temperature", [False, True])
@pytest.mark.parametrize("tau", [0.0, 0.5])
def test_exploitation_learns_what_sac_learns_from_the_same_batches(tau, tune_temperature):
    """Curiosity reaches neither pi_d nor Q_ext. With tau = 0 pi_c is pi_d, and the agent acts as SAC.

    Up to rounding: products of two policies at once, and Adam's step of two temperatures, may round otherwise.
    """
    sac, hybrid = (make(tune_temperature=tune_temperature, tau=tau) for make in (agent_of, hybrid_of))
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
        torch.testing.assert_close(
            of_policy(hybrid, policy), [w[0] for w in sac.learner.actor.net.parameters()], **tolerance
        )
    torch.testing.assert_close([*hybrid.learner.critics.parameters()], [*sac.learner.critics.parameters()], **tolerance)
    np.testing.assert_allclose(hybrid.act(*raw_of(batch), True), sac.act(*raw_of(batch), True), **tolerance)
    assert equal(of_policy(hybrid, EXPLORE), of_policy(hybrid, EXPLOIT)) == (tau == 0)


class Fading(Counting):
    """Its bonus is worth a quarter in every epoch."""

    def bonus_factor(self, epoch: int) -> float:
        return 0.25


@pytest.mark.parametrize("hm", [False, True], ids=["sac", "hybrid"])
def test_a_methods_factor_is_one_of_tau_also_after_a_resume(hm):
    def agent(method: type[Counting], tau: float) -> SAC:
        curiosity = method(0, 0, Counting.Config(), None)
        settings = SMALL, SACConfig(hidden=16, tau=tau), torch.Generator().manual_seed(0), curiosity
        return HybridAgent(*settings) if hm else SAC(*settings)

    fading, plain, resumed = agent(Fading, 2.0), agent(Counting, 0.5), agent(Fading, 2.0)
    rng = np.random.default_rng(0)
    for _ in range(4):
        batch = random_batch(SMALL, 8, rng)
        (first, of_fading), (second, of_plain) = step(fading, batch), step(plain, batch)
        np.testing.assert_array_equal(first, second)
        assert of_fading == of_plain
    resumed.load_state_dict(fading.state_dict())
    np.testing.assert_array_equal(resumed.act(*raw_of(batch)), plain.act(*raw_of(batch)))


def with_stubs(cls: type[HybridAgent], q_d: list[float], q_c: list[float], q_int: list[float]) -> HybridAgent:
    """An agent in whose worlds pi_d acts -1 and pi_c +1, Q_ext is q_d or q_c by that, and Q_int q_int or, z-scored, 0.

    The second critic is 9 above the first.
    """
    agent, n = hybrid_of(cls=cls, tau=0.5), len(q_d)
    actions = torch.tensor([-1.0, 1.0]).view(2, 1, 1).expand(2, n, SMALL.action_size)

    def critics(inputs: PairInputs, asked: torch.Tensor) -> torch.Tensor:
        value = torch.where(asked[..., 0] < 0, torch.tensor(q_d), torch.tensor(q_c))
        return torch.stack([value, value + 9])

    def intrinsic_values(state: torch.Tensor, asked: torch.Tensor) -> torch.Tensor:
        assert (asked == 1).all()  # pi_c's
        return torch.tensor([[q_int], [[0.0] * n]])

    agent.learner.actor = SimpleNamespace(sample=lambda inputs, noise: (actions, torch.zeros(2, n)))
    agent.learner.critics, agent.intrinsic_values = critics, intrinsic_values
    return agent


def chosen(cls: type[HybridAgent] = HybridAgent, explores_by: int = 0) -> list[float]:
    """+1 where pi_c acts, on constructed values; in the first three worlds Q_c - Q_d is -0.1, 0 and 0.1."""
    agent = with_stubs(cls, q_d=[1.0, 1.0, 1.0, 2.0, 0.0], q_c=[0.5, 0.5, 0.5, 1.0, 1.0], q_int=[0.8, 1.0, 1.2, 9, -3])
    agent._explores_by = explores_by
    raw = random_batch(SMALL, 5, np.random.default_rng(0))
    return agent.act(*raw_of(raw))[:, 0].tolist()


def test_switch_follows_equation_15():
    assert chosen() == [-1, 1, 1, 1, -1]
    assert chosen(explores_by=1) == [-1, -1, -1, -1, 1]  # z-scored Q_int, which is 0 here


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("value_c < value_d", "value_c <= value_d"),
        ("value_c < value_d", "value_c > value_d"),
        ("value_d, value_c = self", "value_c, value_d = self"),
        ("values[EXPLORE] += ", "values[EXPLOIT] += "),
        ("inputs, actions).min(0)", "inputs, actions.flip(0)).min(0)"),
    ],
    ids=["ties exploit", "turned round", "names swapped", "curiosity in Q_d", "actions swapped"],
)
def test_mistaken_switches_fail(old, new):
    assert chosen(mutated(HybridAgent, old, new)) != chosen()


def test_share_of_exploitation_counts_steps_since_they_were_last_learned_from():
    agent, rng = hybrid_of(), np.random.default_rng(0)
    assert "share_exploitation" not in agent.update(random_batch(SMALL, 8, rng))
    agent._exploited, agent._acted = 3, 4
    for _ in range(2):  # an epoch's mean over updates is then its mean over cycles
        assert agent.update(random_batch(SMALL, 8, rng))["share_exploitation"] == 0.75
    batch = random_batch(SMALL, 8, rng)
    for _ in range(3):
        agent.act(*raw_of(batch))
        agent.act(*raw_of(batch), deterministic=True)
    assert agent._acted == 24
    assert agent.update(batch)["share_exploitation"] == pytest.approx(agent._measured["share_exploitation"])


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


def test_a_methods_term_in_the_policys_loss_goes_to_pi_c():
    def trained(term: float | None) -> tuple[HybridAgent, float]:
        agent, rng = hybrid_of(term=term, temperature=1.0), np.random.default_rng(0)
        for _ in range(60):
            agent.update(random_batch(SMALL, 8, rng))
        inputs = agent.learner.encode(*raw_of(random_batch(SMALL, 64, rng)))
        return agent, agent.learner.actor(inputs)[0][EXPLORE].tanh().mean().item()

    (with_term, moved), (without, still) = trained(10.0), trained(None)
    assert moved < still - 0.3
    assert equal(of_policy(with_term, EXPLOIT), of_policy(without, EXPLOIT))


class Offset(Counting):
    """Rewards where a transition leads: r_int is 3.5 into B, 2.5 into A."""

    def reward(self, transitions):
        return 3.0 + 0.5 * transitions.next_state[:, 0].sign()


def test_q_int_recovers_the_exact_value_of_a_two_state_world():
    gamma, batch = 0.5, two_state_batch(64)
    agent = hybrid_of(gamma=gamma, learning_rate=3e-3, polyak=0.5, layer_norm=False, popart_rate=0.05)
    agent.learner.curiosity.method = Offset(0, 0, Counting.Config(), None)
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
    values.popart.layers.pop()  # mistaken: the target network keeps its unit
    values.adapt(targets + 100)
    assert (outputs() - before)[:2].abs().max() < 1e-3 < 1 < (outputs() - before)[2].abs().max()


@pytest.mark.parametrize("normalisation", ["popart", "zscore"])
def test_saved_agent_continues_to_the_bit(normalisation):
    def make(seed: int) -> HybridAgent:
        return hybrid_of(seed, tune_temperature=True, q_int_normalisation=normalisation)

    rng, first, second = np.random.default_rng(5), make(0), make(1)
    batches = [random_batch(SMALL, 8, rng) for _ in range(7)]
    for batch in batches[:3]:
        step(first, batch)
    first.act(*raw_of(batches[3]))  # a count that no update has seen yet
    file = io.BytesIO()
    torch.save(first.state_dict(), file)
    file.seek(0)
    second.load_state_dict(torch.load(file, weights_only=True))
    for batch in batches[3:]:
        (action, metrics), (expected, of_first) = step(second, batch), step(first, batch)
        assert same_state(metrics, of_first)
        np.testing.assert_array_equal(action, expected)
    assert same_state(first.state_dict(), second.state_dict())


def test_state_of_a_plain_agent_is_refused():
    with pytest.raises((KeyError, RuntimeError)):
        hybrid_of().load_state_dict(agent_of(method=Counting(0, 0, Counting.Config(), None)).state_dict())


def test_a_target_that_is_not_finite_stops_before_it_reaches_any_weight():
    agent, batch = hybrid_of(), random_batch(SMALL, 8, np.random.default_rng(0))
    agent.update(batch)
    before = agent.state_dict()
    agent.intrinsic_values.targets = lambda *_: torch.full((2, 8), math.nan)
    with pytest.raises(NonFiniteError, match=r"update 1: loss not finite: target of q_int \(nan\)"):
        agent.update(batch)
    after = agent.state_dict()
    assert all(same_state(after[name], before[name]) for name in ("actor", "critics", "intrinsic_values", "optimiser"))


@pytest.mark.parametrize(
    "wrong", [{"q_int_normalisation": "none"}, {"popart_rate": 0.0}, {"spread_ratio": 0.0}, {"tau_rate": 2.0}]
)
def test_settings_out_of_range_are_refused(wrong):
    (name,) = wrong
    with pytest.raises(ValueError, match=name):
        HybridConfig(**wrong)


def test_page_gives_the_defaults_and_the_logged_names():
    """The tables of docs/methods/hm.md cannot fall behind the code."""
    page = (Path(__file__).parents[2] / "docs" / "methods" / "hm.md").read_text()
    settings = dict(re.findall(r"^\| `(\w+)` \| ([^|]+) \| [^|]+ \|$", page, re.MULTILINE))
    assert settings == {name: str(field.default) for name, field in HybridConfig.__dataclass_fields__.items()}
    agent, batch = hybrid_of(tune_temperature=True), random_batch(SMALL, 8, np.random.default_rng(0))
    own = (
        step(agent, batch)[1].keys()
        - agent_of(method=agent.learner.curiosity.method, tune_temperature=True).update(batch).keys()
    )
    assert set(re.findall(r"^\| `(\w+)` \| [^|]+ \|$", page, re.MULTILINE)) == own
