"""Near-field features: distances at centimetre scale, and which bits of the goal are wrong.

Stacking takes a precision of millimetres to centimetres, on a table half a metre wide. Normalised positions change
little over such distances, and a network is slow to learn such differences. These features, and the scales at which
they saturate, were found by experiment (docs/presets.md).
"""

import torch
from torch import Tensor

TANH_SCALES = (0.04, 0.015)
"""Scales (metres) of the tanh of a displacement: about a block's size, and the fingers' clearance around a block."""
EXP_SCALES = (0.03, 0.1)
"""Scales (metres) over which the exponential of a distance decays."""
LINEAR_SCALE = 0.1
"""Unit (metres) of the untransformed displacement of two blocks."""
ROLE_WEIGHTS = (4.0, 2.0)
"""In the score that swaps a pair: the goal's "on" outweighs the state's, which outweighs the distance from the hand."""
SCALES = (TANH_SCALES, EXP_SCALES, LINEAR_SCALE)


def block_features(offset: Tensor) -> Tensor:
    """Features (..., 8) of each block relative to the hand, from its position minus the hand's (..., 3) in metres."""
    distance = torch.linalg.vector_norm(offset, dim=-1, keepdim=True)
    return torch.cat([*_tanhs(offset), *_exps(distance)], dim=-1)


def pair_features(offset: Tensor) -> Tensor:
    """Features (..., 11) of two blocks, from the first's position minus the second's (..., 3) in metres.

    The distance is the horizontal one: that of a block above the other is 0.
    """
    distance = torch.linalg.vector_norm(offset[..., :2], dim=-1, keepdim=True)
    return torch.cat([offset / LINEAR_SCALE, *_tanhs(offset), *_exps(distance)], dim=-1)


def goal_differences(achieved: Tensor, desired: Tensor) -> tuple[Tensor, Tensor]:
    """Which bits are wanted and missing, and which are present and unwanted, (..., k) each, of goals (..., k)."""
    difference = desired - achieved
    return difference.clamp(min=0), (-difference).clamp(min=0)


def turned_by_role(desired_on: Tensor, achieved_on: Tensor, nearer: Tensor) -> Tensor:
    """Whether a pair (i, j) is encoded as (j, i) (...): the upper block first, else the one nearer to the hand.

    Args:
        desired_on: (..., 2) the goal's on(i, j) and on(j, i).
        achieved_on: (..., 2) the state's.
        nearer: (...) metres by which i is nearer to the hand than j.
    """
    weighed = ROLE_WEIGHTS[0] * desired_on + ROLE_WEIGHTS[1] * achieved_on
    return weighed[..., 0] - weighed[..., 1] + nearer.sign() < 0


def _tanhs(offset: Tensor) -> list[Tensor]:
    return [(offset * (1 / scale)).tanh_() for scale in TANH_SCALES]


def _exps(distance: Tensor) -> list[Tensor]:
    return [(distance * (-1 / scale)).exp_() for scale in EXP_SCALES]
