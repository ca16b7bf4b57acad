"""Nearest neighbours of states among particles, a sample of all states."""

import torch
from torch import Tensor


def neighbour_distances(points: Tensor, particles: Tensor | None, k: int) -> Tensor:
    """Euclidean distances from each point to the k nearest particles.

    A point may be among the particles, if both are drawn from one replay: its nearest neighbour then is itself. With
    512 particles of a million states that happens to one point in 2,000, and then one of its k distances is 0.

    Args:
        points: (N, D). In no need of gradients.
        particles: (P, D), P >= k.
        k: how many neighbours, at least 1.

    Returns:
        (N, k) distances in ascending order. Those below a thousandth of a point's norm are lost in rounding.

    Raises:
        ValueError: there are no particles, or fewer than k, or k is below 1.
    """
    if particles is None or not 1 <= k <= len(particles):
        n = 0 if particles is None else len(particles)
        raise ValueError(f"k is {k}; it must lie between 1 and the number of particles, which is {n}")
    return torch.cdist(points.detach(), particles.detach()).topk(k, dim=1, largest=False).values
