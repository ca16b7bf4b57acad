"""PopArt: statistics by hand, outputs preserved, targets that drift, and what goes wrong in mistaken copies."""

import numpy as np
import pytest
import torch
from curiosity import mutated
from hypothesis import given, settings
from hypothesis import strategies as st

from curiobench.methods.agents.popart import PopArt
from curiobench.methods.agents.settings import HybridConfig

FIRST, SECOND = torch.tensor([1.0, 3.0]), torch.tensor([10.0, 10.0])


def layer(seed: int = 0, dtype: torch.dtype = torch.float32) -> tuple[torch.Tensor, torch.Tensor]:
    """Weight (1, 4) and bias (1, 1)."""
    generator = torch.Generator().manual_seed(seed)
    return tuple(torch.randn(1, n, generator=generator).to(dtype) for n in (4, 1))


def outputs(popart: PopArt, inputs: torch.Tensor) -> list[torch.Tensor]:
    """Denormalised output (B,) of every layer."""
    return [popart.denormalise((inputs @ weight.T + bias)[:, 0]) for weight, bias in popart.layers]


def test_two_batches_by_hand():
    popart = PopArt([], rate=0.5)
    popart.update(FIRST)  # the first batch counts in full
    assert (popart.mean, popart.scale) == (2.0, 1.0)
    popart.update(SECOND)  # the second 0.5 / (1 - 0.5²) = 2/3
    mean, square = (2 + 2 * 10) / 3, (5 + 2 * 100) / 3
    assert popart.mean.item() == pytest.approx(mean)
    assert popart.scale.item() == pytest.approx((square - mean**2) ** 0.5)
    torch.testing.assert_close(popart.normalise(popart.denormalise(FIRST)), FIRST.double())


def test_before_any_target_nothing_is_normalised():
    popart = PopArt([layer()])
    assert torch.equal(popart.normalise(FIRST), FIRST.double())
    assert torch.equal(popart.denormalise(FIRST), FIRST.double())


def change_of_outputs(cls: type[PopArt], dtype: torch.dtype, targets: list[torch.Tensor]) -> float:
    """Largest change of any layer's output in updates with these targets, relative to the values involved."""
    popart = cls([layer(1, dtype), layer(2, dtype)], rate=0.1)
    inputs = torch.randn(6, 4, generator=torch.Generator().manual_seed(3)).to(dtype)
    worst = 0.0
    for batch in targets:
        before, scale = outputs(popart, inputs), popart.scale
        popart.update(batch)
        size = popart.mean.abs() + popart.scale + scale
        changes = (((a - b).abs().max() / size).item() for a, b in zip(before, outputs(popart, inputs), strict=True))
        worst = max(worst, *changes)
    return worst


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    powers=st.lists(st.tuples(st.integers(-3, 3), st.integers(-3, 3)), min_size=1, max_size=6),
)
def test_rescaling_leaves_outputs_unchanged_to_float_precision(seed, powers):
    rng = np.random.default_rng(seed)
    targets = [torch.tensor(10.0**m * rng.normal() + 10.0**s * rng.normal(size=5)) for m, s in powers]
    assert change_of_outputs(PopArt, torch.float64, targets) < 1e-11
    assert change_of_outputs(PopArt, torch.float32, targets) < 1e-3  # where a large mean leaves, digits leave with it


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("        self._rescale(mean, scale)\n", ""),
        (".add_((old_mean - self.mean) / new_scale)", ""),
        ("            weight.mul_(old_scale / new_scale)\n", ""),
        ("mean, scale = self.mean.clone(), self.scale", "mean, scale = self.mean, self.scale"),
        ("for weight, bias in self.layers:", "for weight, bias in self.layers[:1]:"),
    ],
    ids=["last layer not rescaled", "bias not shifted", "weight not scaled", "old mean aliased", "one layer forgotten"],
)
def test_mistaken_rescaling_changes_outputs(old, new):
    assert change_of_outputs(PopArt, torch.float64, [FIRST, SECOND]) < 1e-12
    assert change_of_outputs(mutated(PopArt, old, new), torch.float64, [FIRST, SECOND]) > 0.1


def test_a_large_mean_costs_no_digits():
    popart = PopArt([], rate=0.01)
    for _ in range(3):
        popart.update(1e9 + torch.tensor([-1e-3, 1e-3], dtype=torch.float64))
    assert popart.scale.item() == pytest.approx(1e-3, rel=1e-3)


def test_equal_targets_and_a_single_one_stay_finite():
    popart = PopArt([layer()], min_scale=0.1)
    for targets in (torch.full((4,), 7.0), torch.tensor([7.0])):
        popart.update(targets)
    assert popart.scale == pytest.approx(0.1)
    torch.testing.assert_close(popart.normalise(torch.tensor([7.05])), torch.tensor([0.5]).double(), atol=1e-4, rtol=0)
    assert all(tensor.isfinite().all() for tensor in popart.layers[0])


def learned_under_drift(rate: float, steps: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    """A linear layer learns y = m(t) + s(t) · f(x) by gradient descent, m and s growing from 1 to 1000.

    Returns mean and spread of the normalised targets (steps, 2), and Q's error relative to their spread (steps,).
    """
    generator = torch.Generator().manual_seed(0)
    net = torch.nn.utils.skip_init(torch.nn.Linear, 4, 1)
    truth, bias = layer(5)
    net.weight.data.zero_(), net.bias.data.zero_()
    popart = PopArt([(net.weight, net.bias)], rate)
    optimiser, moments, errors = torch.optim.SGD(net.parameters(), lr=0.2), [], []
    for step in range(steps):
        scale = 1000 ** (step / steps)
        inputs = torch.randn(64, 4, generator=generator)
        targets = 5 * scale + scale * (inputs @ truth.T + bias)[:, 0].double()
        popart.update(targets)
        normalised = popart.normalise(targets).float()
        found = net(inputs)[:, 0]
        moments.append((normalised.mean().item(), normalised.std().item()))
        errors.append(((popart.denormalise(found.detach()) - targets).square().mean().sqrt() / targets.std()).item())
        optimiser.zero_grad()
        (found - normalised).square().mean().backward()
        optimiser.step()
    return np.array(moments), np.array(errors)


def test_under_a_thousandfold_drift_outputs_stay_centred_and_precise():
    """With a rate that can follow: a factor 1000 in 1500 steps is 0.5 % a step."""
    moments, errors = learned_under_drift(rate=0.1)
    assert (np.abs(moments[:, 0]) < 0.75).all()
    assert ((moments[:, 1] > 0.5) & (moments[:, 1] < 1.5)).all()
    assert errors[200:].max() < 0.1
    counted, _ = learned_under_drift(rate=1e-9)  # all targets alike, which is why statistics decay
    assert counted[-1, 0] > 3


def test_the_default_rate_lags_behind_a_fast_drift_and_outputs_are_precise_all_the_same():
    """Hessel et al.'s 3e-4 remembers thousands of updates: what docs/methods/hm.md says of the first epochs."""
    moments, errors = learned_under_drift(rate=HybridConfig().popart_rate)
    assert np.abs(moments[:, 0]).max() > 3
    assert errors[200:].max() < 0.1


def test_the_default_rate_keeps_a_slow_drift_centred():
    """Mean and spread grow by half in 20,000 updates, more than a whole run of the laptop preset on stack2."""
    popart, rng = PopArt([], HybridConfig().popart_rate), np.random.default_rng(0)
    for step in range(20_000):
        scale = 1.5 ** (step / 20_000)
        targets = torch.from_numpy(scale * rng.normal(5, 1, 16))
        popart.update(targets)
        if step % 1000 == 999:
            assert abs(popart.normalise(targets).mean().item()) < 1


def test_state_round_trip_and_wrong_settings():
    first, second = PopArt([], rate=0.5), PopArt([], rate=0.5)
    first.update(FIRST)
    second.load_state_dict(first.state_dict())
    for popart in (first, second):
        popart.update(SECOND)
    assert first.state_dict() == second.state_dict()
    for wrong in ({"rate": 0.0}, {"rate": 1.5}, {"min_scale": 0.0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            PopArt([], **wrong)
