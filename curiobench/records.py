"""What a run writes down: a row of progress.csv, and result.json. docs/training.md says what each number means."""

import os
import platform
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from curiobench.evaluation import Evaluation
from curiobench.learned_goals import last_evaluation, learned_by_layer
from curiobench.state import TrainingState

PARTS = ("collecting", "sampling", "updating", "evaluating", "checkpointing")
"""What the wall-clock time of a run goes into."""
WALL_CLOCK = ("seconds", *(f"seconds_{part}" for part in PARTS))
"""Columns of progress.csv that two runs of one config may differ in; they come last."""


def progress_row(state: TrainingState, evaluation: Evaluation | None) -> dict[str, Any]:
    """A row of progress.csv about the epoch that ends now; None where there is nothing to tell."""
    counters, sums = state.counters, state.counters.sums
    row = {
        "epoch": counters.epoch + 1,
        "steps": counters.steps,
        "updates": counters.updates,
        "episodes": sums["episodes"],
        "diverged": sums["diverged"],
        "training_success": _share(sums["success"], sums["episodes"]),
        "training_success_unsatisfied": _share(sums["success_unsatisfied"], sums["unsatisfied"]),
        "goals_reached": int(state.reached.sum()),
        "goals_learned": None if evaluation is None else int(evaluation.learned.sum()),
        "success": None if evaluation is None else float(evaluation.success_rates.mean()),
    }
    row |= {name: total / state.config.cycles for name, total in counters.metrics.items()}
    seconds = [counters.seconds.get(part, 0.0) for part in PARTS]
    return row | dict(zip(WALL_CLOCK, [sum(seconds), *seconds], strict=True))


def result(state: TrainingState, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What result.json holds: the last evaluation in short, from the rows of evaluations.csv, and what the run cost."""
    last = last_evaluation(rows)
    layers = learned_by_layer(last)
    return {
        "epochs": state.counters.epoch,
        "steps": state.counters.steps,
        "updates": state.counters.updates,
        "goals": len(last),
        "goals_learned": sum(learned for learned, _ in layers.values()),
        "learned_by_layer": {str(layer): {"learned": n, "goals": total} for layer, (n, total) in layers.items()},
        "success": sum(float(row["success"]) for row in last) / len(last),
        "seconds": sum(state.counters.seconds.values()),
        "peak_memory_mb": round(state.counters.note_memory()),
        "machine": machine(),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def machine() -> str:
    """Processor model and number of cores."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores"


def _share(part: float, whole: float) -> float | None:
    return part / whole if whole else None
