"""Nearest particles against plain numpy."""

import numpy as np
import pytest
import torch

from curiobench.methods.neighbours import neighbour_distances


@pytest.mark.parametrize(("n", "p", "size", "k"), [(1, 1, 1, 1), (30, 64, 55, 3), (64, 30, 7, 30)])
def test_agrees_with_brute_force(n, p, size, k):
    rng = np.random.default_rng(n)
    points, particles = (rng.normal(size=(rows, size)) for rows in (n, p))
    found = neighbour_distances(*(torch.tensor(array, dtype=torch.float32) for array in (points, particles)), k)
    by_hand = [np.sort(np.linalg.norm(particles - point, axis=1))[:k] for point in points]
    np.testing.assert_allclose(found, by_hand, rtol=1e-4)


@pytest.mark.parametrize(("particles", "k"), [(3, 4), (3, 0), (None, 1)])
def test_too_few_particles_are_refused(particles, k):
    given = None if particles is None else torch.zeros(particles, 2)
    with pytest.raises(ValueError, match=rf"k is {k}; .* which is {particles or 0}"):
        neighbour_distances(torch.zeros(5, 2), given, k)
