"""Running moments against numpy."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from curiobench.methods.moments import RunningMoments


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


def test_before_any_sample_only_clips():
    values = torch.tensor([-7.0, 0.5, 7.0])
    assert RunningMoments().normalise(values).tolist() == [-5.0, 0.5, 5.0]


def test_constant_input_is_not_blown_up():
    found = RunningMoments(min_std=0.01)
    found.update(torch.full((50,), 0.3))
    torch.testing.assert_close(found.normalise(torch.tensor([0.301])), torch.tensor([0.1]), atol=1e-4, rtol=0)


@settings(max_examples=40)
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


def test_wrong_shapes():
    found = RunningMoments((2,))
    with pytest.raises(ValueError, match="expected"):
        found.update(torch.zeros(4, 3))
    with pytest.raises(ValueError, match="saved mean"):
        RunningMoments((3,)).load_state_dict(found.state_dict())
