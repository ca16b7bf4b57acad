"""Running moments against numpy, and against the mistakes found in public implementations."""

import inspect
import textwrap

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from curiobench.methods import moments
from curiobench.methods.moments import RunningMoments

FIRST = torch.tensor([[1.0, 10.0], [3.0, 10.0]])
SECOND = torch.tensor([[5.0, 40.0]])


def mutated(old: str, new: str) -> type[RunningMoments]:
    """`RunningMoments` with one expression of its source replaced."""
    source = textwrap.dedent(inspect.getsource(RunningMoments))
    assert source.count(old) == 1
    namespace = dict(vars(moments))
    exec(source.replace(old, new), namespace)
    return namespace["RunningMoments"]


def filled(cls: type[RunningMoments]) -> RunningMoments:
    """Moments of FIRST, then SECOND: means 3 and 20, variances 8/3 and 200."""
    found = cls((2,))
    found.update(FIRST)
    found.update(SECOND)
    return found


def agrees_with_hand_values(found: RunningMoments) -> bool:
    return np.allclose(found.mean, [3.0, 20.0]) and np.allclose(found.std, [(8 / 3) ** 0.5, 200**0.5])


def test_two_batches_by_hand():
    assert agrees_with_hand_values(filled(RunningMoments))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("self.mean += delta * (len(batch) / total)", "self.mean += delta + len(batch) / total"),
        (" + delta.square() * (self.count * len(batch) / total)", ""),
        ("self.m2 += ", "self.m2 = "),
    ],
    ids=["mean + delta + n_b/n", "spread between batches forgotten", "spread of the past forgotten"],
)
def test_mistaken_updates_fail_the_hand_values(old, new):
    assert not agrees_with_hand_values(filled(mutated(old, new)))


def test_a_window_weighs_samples_by_the_updates_since():
    rng = np.random.default_rng(0)
    batches = [rng.normal(10.0 - k, 1.0 + k, (5 + k, 2)) for k in range(6)]
    found = RunningMoments((2,), window=3)
    for batch in batches:
        found.update(torch.from_numpy(batch))
    samples = np.concatenate(batches)
    weights = np.concatenate([np.full(len(batch), (2 / 3) ** (5 - k)) for k, batch in enumerate(batches)])
    mean = np.average(samples, axis=0, weights=weights)
    spread = np.average((samples - mean) ** 2, axis=0, weights=weights) ** 0.5
    assert np.allclose(found.mean, mean)
    assert np.allclose(found.std, spread)


def test_single_sample_is_finite_and_a_sample_variance_is_not():
    def normalised(cls: type[RunningMoments]) -> torch.Tensor:
        found = cls((2,))
        found.update(SECOND)
        return found.normalise(SECOND + 1.0)

    assert torch.isfinite(normalised(RunningMoments)).all()
    unbiased = mutated("self.m2 / self.count.clamp(min=1.0)", "self.m2 / (self.count - 1.0)")
    assert normalised(unbiased).isnan().any()


def test_normalising_never_updates_and_the_mistaken_copy_does():
    def changes(cls: type[RunningMoments]) -> bool:
        found = filled(cls)
        before = found.state_dict()
        found.normalise(SECOND * 100)
        return any(not torch.equal(before[k], v) for k, v in found.state_dict().items())

    assert not changes(RunningMoments)
    assert changes(mutated("centred = (samples", "self.update(samples); centred = (samples"))


def test_before_any_sample_only_clips():
    values = torch.tensor([-7.0, 0.5, 7.0])
    assert RunningMoments().normalise(values).tolist() == [-5.0, 0.5, 5.0]


def test_constant_input_is_not_blown_up():
    found = RunningMoments(min_std=0.01)
    found.update(torch.full((50,), 0.3))
    torch.testing.assert_close(found.normalise(torch.tensor([0.301])), torch.tensor([0.1]), atol=1e-4, rtol=0)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    sizes=st.lists(st.integers(0, 9), min_size=1, max_size=6),
    offset=st.sampled_from([0.0, 1.0, -1e6]),
)
def test_any_split_into_batches_gives_numpys_moments(seed, sizes, offset):
    rows = offset + np.random.default_rng(seed).normal(size=(sum(sizes), 3))
    found = RunningMoments((3,), min_std=1e-12)
    for batch in np.split(rows, np.cumsum(sizes)[:-1]):
        found.update(torch.from_numpy(batch))
    if len(rows):
        np.testing.assert_allclose(found.mean, rows.mean(0), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(found.std, np.maximum(rows.std(0), 1e-12), rtol=1e-6, atol=1e-9)


def test_state_round_trip_and_wrong_shapes():
    found, other = filled(RunningMoments), RunningMoments((2,))
    other.load_state_dict(found.state_dict())
    other.update(FIRST)
    found.update(FIRST)
    assert all(torch.equal(a, b) for a, b in zip(found.state_dict().values(), other.state_dict().values(), strict=True))
    with pytest.raises(ValueError, match="expected"):
        found.update(torch.zeros(4, 3))
    with pytest.raises(ValueError, match="saved mean"):
        RunningMoments((3,)).load_state_dict(found.state_dict())
