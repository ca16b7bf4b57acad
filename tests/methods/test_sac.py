"""SAC: losses by hand, the seam for curiosity methods, and continuation to the bit."""

import copy
import io
import math
from dataclasses import dataclass, fields, replace

import numpy as np
import pytest
import torch
from curiosity import mutated
from layouts import SMALL, layout_of

from curiobench.methods.agents.losses import bootstrapped_target, critic_loss, policy_loss, temperature_loss
from curiobench.methods.agents.pairs import PairLayout
from curiobench.methods.agents.sac import SAC
from curiobench.methods.agents.settings import SACConfig
from curiobench.methods.curiosity import Curiosity
from curiobench.methods.guard import NonFiniteError
from curiobench.methods.registry import make_agent
from curiobench.methods.reward import Batch, IntrinsicReward, Transitions


class Counting(IntrinsicReward):
    """Rewards the size of the change of state; counts its updates; optionally adds a term to the policy's loss."""

    @dataclass(frozen=True)
    class Config:
        term: float | None = None
        """Added to log pi."""

    def __init__(self, state_size, action_size, config, generator):
        self.config, self.updates, self.seen = config, 0, []

    def reward(self, transitions: Transitions) -> torch.Tensor:
        self.seen.append((self.updates, transitions))
        return (transitions.next_state - transitions.state).abs().mean(1)

    def update(self, transitions: Transitions) -> dict[str, torch.Tensor]:
        self.updates += 1
        return {"counted": torch.tensor(float(self.updates))}

    def policy_loss_term(self, transitions, desired_goal, action):
        return None if self.config.term is None else self.config.term * action.sum(1)

    def state_dict(self):
        return {"updates": self.updates}

    def load_state_dict(self, state):
        self.updates = state["updates"]


def random_batch(layout: PairLayout, size: int, rng: np.random.Generator) -> Batch:
    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    def bits() -> np.ndarray:
        return rng.integers(0, 2, (size, layout.goal_size)).astype(np.uint8)

    return Batch.from_numpy(
        {
            "observation": normal(size, layout.observation_size),
            "action": np.tanh(normal(size, layout.action_size)),
            "next_observation": normal(size, layout.observation_size),
            "achieved_goal": bits(),
            "next_achieved_goal": bits(),
            "desired_goal": bits(),
            "reward": rng.integers(0, 2, size).astype(np.float32),
            **_more(layout, size),
        }
    )


def test_a_batch_without_its_actions_is_refused():
    with pytest.raises(TypeError, match="action"):
        Batch.from_numpy({f.name: None if f.name == "action" else np.zeros(1, np.float32) for f in fields(Batch)})


def test_an_agent_without_a_curiosity_method_says_so():
    with pytest.raises(ValueError, match="no curiosity method"):
        agent_of().transitions(random_batch(SMALL, 4, np.random.default_rng(0)), epoch=0)


def _more(layout: PairLayout, size: int, steps: int = 5) -> dict[str, np.ndarray]:
    """What some methods ask for: particles, and whole episodes; the same each time."""
    rng = np.random.default_rng(0)
    return {
        "step": rng.integers(0, steps, size),
        "episode": np.arange(size),
        "particles": rng.normal(size=(512, layout.observation_size)).astype(np.float32),
        "episode_observation": rng.normal(size=(size, steps + 1, layout.observation_size)).astype(np.float32),
        "episode_achieved_goal": rng.integers(0, 2, (size, steps + 1, layout.goal_size)).astype(np.uint8),
    }


def agent_of(seed: int = 0, layout: PairLayout = SMALL, method: IntrinsicReward | None = None, **config) -> SAC:
    return SAC(layout, SACConfig(**{"hidden": 16, **config}), torch.Generator().manual_seed(seed), method)


def same_state(first, second) -> bool:
    """Nested states equal to the bit."""
    if isinstance(first, dict):
        return first.keys() == second.keys() and all(same_state(first[k], second[k]) for k in first)
    if isinstance(first, torch.Tensor):
        return torch.equal(first, second)
    return first == second


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
    assert metrics["entropy"].item() == -0.5  # a method's term is no part of it
    loss, _ = temperature_loss(torch.tensor(2.0), log_prob, target_entropy=-4.0)
    assert loss.item() == -2.0 * (0.5 - 4.0)


def test_target_networks_keep_no_history():
    agent, rng = agent_of(target_every=1), np.random.default_rng(6)
    for _ in range(3):
        agent.update(random_batch(SMALL, 8, rng))
    assert all(weight.grad_fn is None for weight in agent.learner.targets)


@pytest.mark.parametrize("pairs", ["symmetric", "oriented"])
@pytest.mark.parametrize("identities", [False, True])
def test_training_twice_gives_the_same_bits(pairs, identities):
    def trained() -> dict:
        rng = np.random.default_rng(4)
        agent = agent_of(layout=layout_of(3), pairs=pairs, identities=identities, tune_temperature=True)
        for _ in range(5):
            batch = random_batch(agent.learner.layout, 8, rng)
            agent.observe(*(getattr(batch, n).numpy() for n in ("observation", "achieved_goal", "desired_goal")))
            agent.act(*(getattr(batch, n).numpy() for n in ("observation", "achieved_goal", "desired_goal")))
            agent.update(batch)
        return agent.state_dict()

    assert same_state(trained(), trained())


@pytest.mark.parametrize("intrinsic", [None, Counting.Config()])
def test_saved_agent_continues_to_the_bit(intrinsic):
    def make(seed: int) -> SAC:
        method = intrinsic and Counting(SMALL.observation_size, SMALL.action_size, intrinsic, None)
        return agent_of(seed, method=method, tune_temperature=True)

    rng, first, second = np.random.default_rng(5), make(0), make(1)
    batches = [random_batch(SMALL, 8, rng) for _ in range(7)]
    first.observe(*(getattr(batches[0], n).numpy() for n in ("observation", "achieved_goal", "desired_goal")))
    for batch in batches[:3]:
        first.update(batch)
    file = io.BytesIO()
    torch.save(first.state_dict(), file)
    file.seek(0)
    second.load_state_dict(torch.load(file, weights_only=True))
    for batch in batches[3:]:
        assert same_state(first.update(batch, epoch=1), second.update(batch, epoch=1))
    assert same_state(first.state_dict(), second.state_dict())
    raw = batches[0].observation.numpy(), batches[0].achieved_goal.numpy(), batches[0].desired_goal.numpy()
    assert (first.act(*raw) == second.act(*raw)).all()


def test_state_of_another_kind_of_agent_is_refused():
    state = agent_of().state_dict()
    with pytest.raises(ValueError, match="same curiosity method"):
        agent_of(method=Counting(0, 0, Counting.Config(), None)).load_state_dict(state)
    with pytest.raises(RuntimeError, match="size mismatch"):
        agent_of(hidden=8).load_state_dict(state)


def test_deterministic_action_is_the_mode_and_draws_nothing():
    agent, raw = agent_of(), random_batch(SMALL, 6, np.random.default_rng(0))
    raw = raw.observation.numpy(), raw.achieved_goal.numpy(), raw.desired_goal.numpy()
    before = agent.learner.generator.get_state()
    action = agent.act(*raw, deterministic=True)
    assert torch.equal(agent.learner.generator.get_state(), before)
    assert action.shape == (6, 2)
    assert action.dtype == np.float32
    assert not np.array_equal(agent.act(*raw), agent.act(*raw))


def test_update_reads_a_batch_only_through_its_fixed_buffers():
    """What a CUDA graph needs: the step, called again without a batch, does what `update` does with it."""
    rng, agent, twin = np.random.default_rng(6), agent_of(), agent_of()
    first, second = random_batch(SMALL, 8, rng), random_batch(SMALL, 8, rng)
    agent.update(first)
    twin.update(first)
    address = agent.learner.batch.rows.data_ptr()
    metrics = agent.update(second)
    twin.learner.batch.load(second)
    assert same_state(twin.learner.steps[True](), metrics)
    assert agent.learner.batch.rows.data_ptr() == address
    for name in ("actor", "critics"):
        assert same_state(agent.state_dict()[name], twin.state_dict()[name])


def test_tuned_temperature_falls_while_entropy_is_above_target():
    agent, rng = agent_of(tune_temperature=True, temperature=0.5), np.random.default_rng(0)
    agent.learner.target_entropy = -10.0
    metrics = [agent.update(random_batch(SMALL, 8, rng)) for _ in range(5)]
    assert metrics[0]["entropy"] > -10
    assert metrics[-1]["temperature"] < metrics[0]["temperature"]
    fixed = agent_of(temperature=0.5)
    fixed.update(random_batch(SMALL, 8, rng))
    assert fixed.update(random_batch(SMALL, 8, rng))["temperature"].item() == pytest.approx(0.5)


def test_learning_rate_falls_to_a_tenth_and_stays():
    agent, batch = agent_of(learning_rate=0.01, decay_updates=4), random_batch(SMALL, 8, np.random.default_rng(0))
    rates = []
    for _ in range(6):
        agent.update(batch)
        rates.append(agent.learner.optimiser.param_groups[0]["lr"])
    assert rates == pytest.approx([0.01, 0.00775, 0.0055, 0.00325, 0.001, 0.001])


def test_target_critics_move_every_second_update():
    agent, rng = agent_of(polyak=0.25), np.random.default_rng(0)
    before = [p.clone() for p in agent.learner.target_critics.parameters()]
    agent.update(random_batch(SMALL, 8, rng))
    assert all(torch.equal(a, b) for a, b in zip(before, agent.learner.target_critics.parameters(), strict=True))
    agent.update(random_batch(SMALL, 8, rng))
    critics = agent.learner.critics.parameters()
    for old, new, source in zip(before, agent.learner.target_critics.parameters(), critics, strict=True):
        torch.testing.assert_close(new, 0.75 * old + 0.25 * source)


@pytest.mark.parametrize("spec", ["sac", "rnd", "dac", "rnd+hm", "dac+hm"])
def test_the_policy_moves_every_other_update_only(spec):
    """Also where a method looks at the policy (DAC); updates that move it are those of an agent that always does."""
    config = SACConfig(hidden=16, actor_every=2, tune_temperature=True)
    agent = make_agent(spec, SMALL, config, torch.Generator().manual_seed(0))
    always = make_agent(spec, SMALL, replace(config, actor_every=1), torch.Generator().manual_seed(0))
    batches = [random_batch(SMALL, 8, np.random.default_rng(k)) for k in range(3)]
    agent.update(batches[0])
    always.update(batches[0])
    assert same_state(agent.state_dict(), always.state_dict())
    learner = agent.learner
    before = copy.deepcopy([learner.actor.state_dict(), learner.log_alpha.detach(), learner.critics.state_dict()])
    metrics = agent.update(batches[1])
    assert same_state(agent.learner.actor.state_dict(), before[0])
    assert torch.equal(agent.learner.log_alpha, before[1])
    assert not same_state(agent.learner.critics.state_dict(), before[2])
    assert "critic_loss" in metrics
    assert not {"policy_loss", "entropy", "temperature_loss"} & metrics.keys()
    agent.update(batches[2])
    assert not same_state(agent.learner.actor.state_dict(), before[0])


def check_intrinsic_reward(cls: type[Curiosity]) -> None:
    """r_int is added as a z-score by its past, as it was before the method learned from the batch, and as it is."""
    method = Counting(0, 0, Counting.Config(), None)
    agent = agent_of(method=method, tau=0.5)
    agent.learner.curiosity = agent.learner.curiosity = cls(method, SMALL, tau=0.5)
    rng = np.random.default_rng(0)
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


def test_intrinsic_reward_is_added_normalised_by_the_past_and_taken_before_the_method_learns():
    check_intrinsic_reward(Curiosity)


class Shrinking(Counting):
    """Novelty that wears off, as RND's does."""

    def reward(self, transitions: Transitions) -> torch.Tensor:
        return super().reward(transitions) * 0.97**self.updates


@pytest.mark.parametrize(("window", "alive"), [(10, True), (None, False)])
def test_a_reward_that_shrinks_stays_alive_where_its_statistics_forget(window, alive):
    rng = np.random.default_rng(0)
    agent = agent_of(method=Shrinking(0, 0, Counting.Config(), None), reward_window=window)
    spread = [agent.update(random_batch(SMALL, 64, rng))["bonus_spread"].item() for _ in range(200)]
    assert (min(spread[150:]) > 0.1 * agent.learner.config.tau) == alive


@pytest.mark.parametrize(
    ("old", "new"),
    [
        # a filter over what is stepped or sampled together, instead of over time
        ("self.moments.normalise(raw)", "(raw - raw.mean()) / raw.std(correction=0)"),
        # the sum that some filters keep to find their scale, returned in place of the reward
        (
            "raw = self.reward(transitions)",
            "raw = self.sum_ = self.reward(transitions) + 0.95 * getattr(self, 'sum_', 0)",
        ),
        # normalised by statistics that already hold the batch
        (
            "normalised = self.moments.normalise(raw)",
            "self.moments.update(raw); normalised = self.moments.normalise(raw)",
        ),
    ],
)
def test_mistaken_reward_filters_are_found(old: str, new: str):
    with pytest.raises(AssertionError):
        check_intrinsic_reward(mutated(Curiosity, old, new))


def test_relabelling_does_not_change_what_a_method_sees():
    batch = random_batch(SMALL, 8, np.random.default_rng(0))
    relabelled = Batch(**{**vars(batch), "desired_goal": 1 - batch.desired_goal, "reward": 1 - batch.reward})
    seen = []
    for one in (batch, relabelled):
        method = Counting(0, 0, Counting.Config(), None)
        agent_of(method=method).update(one)
        seen.append(method.seen[0][1])
    assert all(same_state(getattr(seen[0], f.name), getattr(seen[1], f.name)) for f in fields(Transitions))


def test_policy_loss_term_moves_the_policy():
    def mean_action(term: float | None) -> float:
        rng = np.random.default_rng(0)
        agent = agent_of(method=Counting(0, 0, Counting.Config(term), None), tau=0.0, temperature=1.0)
        for _ in range(60):
            agent.update(random_batch(SMALL, 8, rng))
        raw = random_batch(SMALL, 64, rng)
        raw = raw.observation.numpy(), raw.achieved_goal.numpy(), raw.desired_goal.numpy()
        return float(agent.act(*raw, deterministic=True).mean())

    assert mean_action(10.0) < mean_action(None) - 0.3


def test_non_finite_loss_names_update_and_term_and_leaves_the_agent():
    agent, rng = agent_of(), np.random.default_rng(0)
    agent.update(random_batch(SMALL, 8, rng))
    weights = [p.clone() for p in (*agent.learner.actor.parameters(), *agent.learner.critics.parameters())]
    batch = random_batch(SMALL, 8, rng)
    batch.reward[3] = math.nan
    with pytest.raises(NonFiniteError, match=r"update 1: loss not finite: critics \(nan\)"):
        agent.update(batch)
    after = (*agent.learner.actor.parameters(), *agent.learner.critics.parameters())
    assert all(torch.equal(a, b) for a, b in zip(weights, after, strict=True))


@pytest.mark.parametrize(
    "wrong",
    [{"gamma": 1.0}, {"polyak": 0.0}, {"tau": -1.0}, {"hidden": 0}, {"temperature": 0.0}, {"detail_scale": 0.0}],
)
def test_settings_out_of_range_are_refused(wrong):
    (name,) = wrong
    with pytest.raises(ValueError, match=name):
        SACConfig(**wrong)
