"""Nearest neighbours against plain numpy, and against a point that counts itself."""

import numpy as np
import pytest
import torch
from curiosity import mutated

from curiobench.methods.neighbours import neighbour_distances


def brute_force(points: np.ndarray, k: int) -> np.ndarray:
    """(N, k), one pair at a time."""
    rows = []
    for i, point in enumerate(points):
        distances = [float(np.linalg.norm(point - other)) for j, other in enumerate(points) if j != i]
        rows.append(sorted(distances)[:k])
    return np.array(rows)


def test_four_points_on_a_line_by_hand():
    points = torch.tensor([[0.0], [1.0], [3.0], [7.0]])
    assert neighbour_distances(points, 2).tolist() == [[1, 3], [1, 2], [2, 3], [4, 6]]


def test_a_duplicate_is_a_neighbour_and_the_point_itself_is_not():
    points = torch.tensor([[0.0, 0.0], [3.0, 4.0], [0.0, 0.0], [0.0, 0.0]])
    assert neighbour_distances(points, 3).tolist() == [[0, 0, 5], [5, 5, 5], [0, 0, 5], [0, 0, 5]]


def test_counting_the_point_itself_fails_the_hand_values():
    counting_itself = mutated(neighbour_distances, "torch.inf", "0.0")
    points = torch.tensor([[0.0], [1.0], [3.0], [7.0]])
    assert counting_itself(points, 2).tolist() == [[0, 1], [0, 1], [0, 2], [0, 4]]


@pytest.mark.parametrize(("n", "size", "k"), [(2, 1, 1), (30, 55, 3), (64, 7, 63)])
def test_agrees_with_brute_force(n, size, k):
    points = np.random.default_rng(n).normal(size=(n, size)).astype(np.float32)
    found = neighbour_distances(torch.from_numpy(points), k)
    np.testing.assert_allclose(found, brute_force(points.astype(np.float64), k), rtol=1e-5)


def test_exact_where_a_product_of_matrices_is_not():
    """Points 0.001 apart, far from the origin: the default way of torch.cdist loses them in rounding."""
    points = torch.full((32, 55), 5.0)
    points[:, 0] = 1e-3 * torch.arange(32)
    product = torch.cdist(points, points).topk(2, largest=False).values[:, 1]
    assert (product - 1e-3).abs().max() > 1e-4
    exact = neighbour_distances(points, 1)[:, 0]
    torch.testing.assert_close(exact, torch.full((32,), 1e-3), rtol=1e-4, atol=0)


@pytest.mark.parametrize(("n", "k"), [(3, 3), (3, 0), (1, 1)])
def test_too_few_points_are_refused(n, k):
    with pytest.raises(ValueError, match=rf"k is {k}; {n} points"):
        neighbour_distances(torch.zeros(n, 2), k)
