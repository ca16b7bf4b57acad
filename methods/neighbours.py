"""Nearest neighbours of states among particles, a sample of all states."""

import torch
from torch import Tensor


def neighbour_distances(points: Tensor, particles: Tensor | None, k: int) -> Tensor:
    """Euclidean distances from each point to the k nearest particles.

    If points and particles are drawn from the same replay, a point may be one of the particles. Its nearest neighbour
    is then itself, and one of its k distances is 0. With 512 particles from a million states, this happens to one point
    in 2,000.

    Args:
        points: (N, D). They get no gradients.
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
