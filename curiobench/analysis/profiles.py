"""Performance profiles: which share of goals and seeds ends with at least a certain success (Agarwal et al. 2021)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from curiobench.analysis.lines import Axis, Panel, draw_lines
from curiobench.analysis.samples import Sample, TaskSamples
from curiobench.analysis.statistics import performance_profile

if TYPE_CHECKING:
    from matplotlib.figure import Figure

THRESHOLDS = np.linspace(0, 1, 101)
"""τ, success from 0 to 1."""


def draw_profile(task: TaskSamples, samples: Sequence[Sample]) -> list["Figure"]:
    """Share of goals and seeds whose final success is above τ, over τ; a seed's goals are resampled together."""
    return draw_lines(samples, [Panel("", _profile)], Axis("final success τ", "share above τ", whole=False))


def _profile(sample: Sample) -> tuple[np.ndarray, np.ndarray]:
    """τ (T,) and the profile of each seed (S, T)."""
    return THRESHOLDS, np.stack([performance_profile(seed[None], THRESHOLDS) for seed in sample.goal_success])
