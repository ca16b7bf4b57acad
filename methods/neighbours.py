"""Nearest neighbours within a set of points: exact, and never the point itself."""

from functools import lru_cache

import torch
from torch import Tensor
from torch.nn import functional as F


def neighbour_distances(points: Tensor, k: int) -> Tensor:
    """Euclidean distances from each point to its k nearest others.

    Distances come from differences, not from a product of matrices: `torch.cdist` takes that way above 25 points, and
    then a point's distance to itself is some 5e-4, and that to a duplicate anything below. A point is left out by its
    place, not as "the nearest one": where duplicates exist, the nearest may be another.

    Args:
        points: (N, D), N > k. In no need of gradients.
        k: how many neighbours, at least 1.

    Returns:
        (N, k) distances in ascending order; a duplicate elsewhere in `points` is a neighbour at distance 0.

    Raises:
        ValueError: k is below 1, or there are too few points.
    """
    n = len(points)
    if not 1 <= k < n:
        raise ValueError(f"k is {k}; {n} points have between 1 and {n - 1} neighbours each")
    each_pair_once = F.pdist(points.detach())
    with_self = torch.cat([each_pair_once, each_pair_once.new_full((1,), torch.inf)])
    distances = with_self.index_select(0, _pair_numbers(n, points.device)).view(n, n)
    return distances.topk(k, dim=1, largest=False).values


@lru_cache(maxsize=2)
def _pair_numbers(n: int, device: torch.device) -> Tensor:
    """Where `pdist` puts the distance of points i and j, for all i and j in row-major order (N²,); the end for i = j.

    Kept between calls, for a batch has the same size each time. Four bytes a number: 1 MB for 512 points.
    """
    first, second = torch.triu_indices(n, n, offset=1, device=device)
    numbers = torch.full((n, n), len(first), dtype=torch.int32, device=device)
    numbers[first, second] = numbers[second, first] = torch.arange(len(first), dtype=torch.int32, device=device)
    return numbers.flatten()
