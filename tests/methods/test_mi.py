"""MI: values in plain numpy over several batches, its growing conservativeness, and the noisy television."""

import math

import numpy as np
import pytest
import torch
from curiosity import fresh, mutated, plain, random_transitions, shaken, transitions_of
from test_sac import same_state

from curiobench.methods.icm import ICM
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


def rewards_of_three_batches(cls: type[MI], k: int = 3, m: float = 0.01) -> tuple[list, list]:
    """As the method gives them, learning in between; and as numpy does, from its weights and all past parts.

    A small m makes r_C vary by more than the least spread, so that its standard deviation counts.
    """
    method, given, wanted, past = fresh(cls, k=k, m=m, xi=0.5, beta=0.9), [], [], []
    shaken(method, method.density)
    for seed, epoch in ((0, 1), (1, 2), (2, 7)):
        batch = random_transitions(8, seed, epoch)
        parts = curiosity(batch, k, m), conservativeness(method, batch, m)
        sigma = [np.concatenate(p).std() for p in zip(*past, strict=True)] if past else (1.0, 1.0)
        wanted.append(parts[0] + min(1 - 0.5**epoch, 0.9) * sigma[0] / max(sigma[1], 0.1) * parts[1])
        given.append(method.reward(batch).numpy())
        method.update(batch)
        past.append(parts)
    return given, wanted


@pytest.mark.parametrize(("k", "m"), [(3, 0.01), (3, 1.0), (1, 1.0), (2, 0.5)])
def test_rewards_in_numpy(k, m):
    given, wanted = rewards_of_three_batches(MI, k, m)
    np.testing.assert_allclose(given, wanted, rtol=1e-4)


MISTAKES = {
    "neighbours in the batch": ("transitions.particles, self", "transitions.next_state, self"),
    "the k-th neighbour only": ("self.config.k).mean(1)", "self.config.k)[:, -1]"),
    "standard deviations swapped": ("of_curiosity, of_conservativeness = ", "of_conservativeness, of_curiosity = "),
    "statistics of this batch too": (
        "return curiosity + ",
        "self.moments.update(torch.stack([curiosity, conservativeness], dim=1)); return curiosity + ",
    ),
    "penalty, not bonus": ("return curiosity + ", "return curiosity - "),
    "half-normalised density": ("0.5 * math.log(2 * math.pi) * mean.shape[1]", "0.5 * math.log(2 * math.pi)"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_fail_the_values(mistake):
    given, wanted = rewards_of_three_batches(mutated(MI, *MISTAKES[mistake]))
    assert not np.allclose(given, wanted, rtol=0.01)


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


def test_a_density_that_is_still_flat_makes_no_transition_priceless():
    """r_C of 40 dimensions is 0 to float precision at first, and so is its spread: nothing to divide by."""

    def largest_weight(cls: type[MI]) -> float:
        method = fresh(cls, sizes=(40, 2))
        noise = np.random.default_rng(0).normal(size=(3, 64, 40))
        batch = transitions_of(noise[0], noise[1, :, :2], noise[2], epoch=CAP_EPOCH)
        return max(method.update(batch)["mi_weight"].item() for _ in range(3))

    assert largest_weight(MI) < 5
    assert largest_weight(mutated(MI, "of_conservativeness.clamp(min=LEAST_SPREAD)", "of_conservativeness")) > 1000


def test_evaluating_rewards_changes_no_statistics_and_the_mistaken_copy_does():
    def changes(cls: type[MI]) -> bool:
        method = fresh(cls)
        method.update(random_transitions(8))
        before = method.state_dict()
        method.reward(random_transitions(8, seed=1))
        return not same_state(before, method.state_dict())

    assert not changes(MI)
    new = "self.moments.update(torch.ones(1, 2)); conservativeness = self.conservativeness(self.log"
    assert changes(mutated(MI, "conservativeness = self.conservativeness(self.log", new))


def test_searching_neighbours_once_a_batch_changes_nothing():
    """With and without a call of `reward` before it, `update` ends in the same state."""
    batches = [random_transitions(8, seed) for seed in range(3)]
    rewarded, silent = fresh(MI), fresh(MI)
    for batch in batches:
        rewarded.reward(batch)
        rewarded.update(batch)
        silent.update(batch)
    assert same_state(rewarded.state_dict(), silent.state_dict())


def test_sharp_densities_of_many_dimensions_stay_finite_and_the_plain_logarithm_does_not():
    zeros = np.zeros((8, 200))

    def finite(cls: type[MI]) -> bool:
        method = fresh(cls, sizes=(200, 2))
        with torch.no_grad():
            method.density[-1].weight.zero_()
            method.density[-1].bias[200:] = -20.0
        return bool(method.reward(transitions_of(zeros, zeros[:, :2], zeros, CAP_EPOCH)).isfinite().all())

    assert finite(MI)
    assert not finite(mutated(MI, "F.softplus(log_density - log_m)", "(log_density - log_m).exp().log1p()"))


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


def television(rng: np.random.Generator, size: int = 64):
    """States (room, picture, lever). In room -1 the next picture is noise; in room 1 the action sets the lever.

    Both spread as widely, so both are as rare; only the lever is controlled.
    """
    room, action = rng.choice([-1.0, 1.0], size), rng.uniform(-1, 1, (size, 2))
    picture = np.where(room < 0, rng.uniform(-2, 2, size), 0)
    lever = np.where(room > 0, 2 * action[:, 0], 0)
    zeros = np.zeros(size)
    return transitions_of(
        np.stack([room, zeros, zeros], 1), action, np.stack([room, picture, lever], 1), epoch=CAP_EPOCH
    )


def preference_for_the_lever(method) -> float:
    """Mean reward in the lever's room less that in the television's, in standard deviations, after some training."""
    rng = np.random.default_rng(0)
    for _ in range(800):
        method.update(television(rng))
    batch = television(rng, 512)
    rewards, lever = method.reward(batch), batch.state[:, 0] > 0
    return float((rewards[lever].mean() - rewards[~lever].mean()) / rewards.std())


def test_mi_prefers_what_it_controls_and_a_prediction_error_the_noisy_television():
    assert preference_for_the_lever(fresh(MI, hidden=32)) > 0.5
    assert preference_for_the_lever(fresh(ICM, hidden=32)) < -0.5


def test_curiosity_decides_in_states_never_seen():
    rng, method = np.random.default_rng(0), fresh(MI, hidden=32)
    for _ in range(800):
        method.update(television(rng))
    seen = television(rng, 60)
    far = torch.tensor([[4.0, -4.0, 4.0], [-4.0, 4.0, 4.0], [4.0, 4.0, -4.0], [4.0, 4.0, 4.0]])
    state, action = torch.cat([seen.state, 0.8 * far]), torch.cat([seen.action, torch.zeros(4, 2)])
    batch = transitions_of(state, action, torch.cat([seen.next_state, far]), CAP_EPOCH)
    of_curiosity = method.curiosity(batch)
    of_conservativeness = method.reward(batch) - of_curiosity
    assert (of_conservativeness[60:] < 0.1 * of_curiosity[60:]).all()
    assert of_conservativeness[:60].mean() > 0.5 * of_curiosity[:60].mean()


@pytest.mark.parametrize("wrong", [{"xi": 1.0}, {"beta": 1.1}, {"m": 0.0}, {"k": 0}, {"min_log_std": 3.0}])
def test_settings_out_of_range_are_refused(wrong):
    (name,) = wrong
    with pytest.raises(ValueError, match=f"{name} is"):
        MI.Config(**wrong)
