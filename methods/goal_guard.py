"""Checks of what curricula and relabellings return, so that a fault stops the run where it occurs.

A violation raises MethodError, which names the method and its file.
"""

import json
import math
from typing import Any

import numpy as np

from curiobench.methods.curriculum import Curriculum, Situation
from curiobench.methods.guard import blamed, fault, flaw_of_names, outline
from curiobench.methods.relabelling import Draw, Relabelling, Replay


def goals_drawn(
    curriculum: Curriculum, situation: Situation, generator: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """The goals that a curriculum draws. Raises MethodError unless `draw` returns N indices of goals and N bools."""
    with blamed(curriculum, "draw"):
        goals, tested = curriculum.draw(situation, generator)
    n, n_goals = len(situation.start), len(situation.reached)
    if found := _flaw_of_positions(goals, n, n_goals):
        raise fault(curriculum, None, f"draw() returned goals that are {found}")
    if not isinstance(tested, np.ndarray) or tested.shape != (n,) or tested.dtype != bool:
        raise fault(
            curriculum, None, f"draw() returned tests that are {outline(tested)}; expected bool of shape {(n,)}"
        )
    return goals, tested


def goal_weights(curriculum: Curriculum) -> np.ndarray | None:
    """Weights `(G,)` for the replay, or None. Raises MethodError unless they are at least 0, and not all are 0."""
    with blamed(curriculum, "replay_weights"):
        weights = curriculum.replay_weights()
    if weights is None:
        return None
    shape = (len(curriculum.goals.bits),)
    if not isinstance(weights, np.ndarray) or weights.shape != shape or weights.dtype.kind != "f":
        raise fault(curriculum, None, f"replay_weights() returned {outline(weights)}; expected floats of shape {shape}")
    if not (np.isfinite(weights).all() and weights.min() >= 0 and weights.sum() > 0):
        found = f"{weights.min()} to {weights.max()}"
        raise fault(curriculum, None, f"replay_weights() returned {found}; expected at least 0, and not all of them 0")
    return weights


def curriculum_metrics(curriculum: Curriculum) -> dict[str, float]:
    """Columns of progress.csv. Raises MethodError unless they are finite numbers, and no other column has the name."""
    with blamed(curriculum, "metrics"):
        metrics = dict(curriculum.metrics())
    if found := flaw_of_names(metrics):
        raise fault(curriculum, None, f"metrics() returned {found}")
    for name, value in metrics.items():
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise fault(curriculum, None, f"metrics() returned {name} = {value!r:.80}; expected a finite number")
    return metrics


def curriculum_state(curriculum: Curriculum) -> dict[str, Any]:
    """State of the curriculum. Raises MethodError unless it is JSON-serialisable."""
    with blamed(curriculum, "state_dict"):
        state = curriculum.state_dict()
        json.dumps(state)
    return state


def transitions_drawn(relabelling: Relabelling, replay: Replay, size: int, generator: np.random.Generator) -> Draw:
    """What a relabelling draws. Raises MethodError unless it is `size` slots, steps and goals."""
    with blamed(relabelling, "draw"):
        slot, step, desired = relabelling.draw(replay, size, generator)
    for what, positions, limit in (("slots", slot, len(replay)), ("steps", step, replay.steps)):
        if found := _flaw_of_positions(positions, size, limit):
            raise fault(relabelling, None, f"draw() returned {what} that are {found}")
    shape = size, replay.arrays["desired_goal"].shape[-1]
    if not isinstance(desired, np.ndarray) or desired.shape != shape or desired.dtype != np.uint8:
        raise fault(relabelling, None, f"draw() returned {outline(desired)} as goals; expected uint8 of shape {shape}")
    return slot.astype(np.int64), step.astype(np.int64), desired  # small integer types would overflow


def _flaw_of_positions(positions: object, size: int, limit: int) -> str | None:
    """What is wrong with `size` integers in [0, limit); None if nothing is."""
    if not isinstance(positions, np.ndarray) or positions.shape != (size,) or positions.dtype.kind not in "iu":
        return f"{outline(positions)}; expected integers of shape {(size,)}"
    if positions.size and not (positions.min() >= 0 and positions.max() < limit):
        return f"{positions.min()} to {positions.max()}; expected 0 to {limit - 1}"
    return None
