"""PopArt: statistics by hand, outputs preserved, and targets that drift slowly."""

import numpy as np
import pytest
import torch
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


def change_of_outputs(dtype: torch.dtype, targets: list[torch.Tensor]) -> float:
    """Largest change of any layer's output in updates with these targets, relative to the values involved."""
    popart = PopArt([layer(1, dtype), layer(2, dtype)], rate=0.1)
    inputs = torch.randn(6, 4, generator=torch.Generator().manual_seed(3)).to(dtype)
    worst = 0.0
    for batch in targets:
        before, scale = outputs(popart, inputs), popart.scale
        popart.update(batch)
        size = popart.mean.abs() + popart.scale + scale
        changes = (((a - b).abs().max() / size).item() for a, b in zip(before, outputs(popart, inputs), strict=True))
        worst = max(worst, *changes)
    return worst


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    powers=st.lists(st.tuples(st.integers(-3, 3), st.integers(-3, 3)), min_size=1, max_size=6),
)
def test_rescaling_leaves_outputs_unchanged_to_float_precision(seed, powers):
    rng = np.random.default_rng(seed)
    targets = [torch.tensor(10.0**m * rng.normal() + 10.0**s * rng.normal(size=5)) for m, s in powers]
    assert change_of_outputs(torch.float64, targets) < 1e-11
    assert change_of_outputs(torch.float32, targets) < 1e-3  # a large mean that leaves takes digits with it


def test_a_large_mean_costs_no_digits():
    popart = PopArt([], rate=0.01)
    for _ in range(3):
        popart.update(1e9 + torch.tensor([-1e-3, 1e-3], dtype=torch.float64))
    assert popart.scale.item() == pytest.approx(1e-3, rel=1e-3)


def test_equal_targets_and_a_single_one_stay_finite():
    popart = PopArt([layer()])
    popart.min_scale = 0.1
    for targets in (torch.full((4,), 7.0), torch.tensor([7.0])):
        popart.update(targets)
    assert popart.scale == pytest.approx(0.1)
    torch.testing.assert_close(popart.normalise(torch.tensor([7.05])), torch.tensor([0.5]).double(), atol=1e-4, rtol=0)
    assert all(tensor.isfinite().all() for tensor in popart.layers[0])


def test_the_default_rate_keeps_a_slow_drift_centred():
    """Mean and spread grow by half in 20,000 updates, more than a whole run of the laptop preset on stack2."""
    popart, rng = PopArt([], HybridConfig().popart_rate), np.random.default_rng(0)
    for step in range(20_000):
        scale = 1.5 ** (step / 20_000)
        targets = torch.from_numpy(scale * rng.normal(5, 1, 16))
        popart.update(targets)
        if step % 1000 == 999:
            assert abs(popart.normalise(targets).mean().item()) < 1
