"""What `curiobench list` prints."""

import numpy as np

from curiobench import terminal
from curiobench.methods.specs import ALIASES, BUILT_IN, HYBRID, available_specs, installed_methods, split
from curiobench.presets import PRESET_LINES
from curiobench.tasks.registration import TASKS, task_spec

ROBOT_LINES = {
    "gripper": "a free-floating hand with the Fetch arm's fingers, several times faster",
    "fetch": "the paper's arm (needs the extra `fetch`)",
}
"""One line on each robot."""


def listing() -> str:
    """Tasks, robots, methods and presets, with one line on each."""
    sections = {
        "tasks": {task: _task_line(task) for task in TASKS},
        "robots": ROBOT_LINES,
        "methods": {spec: _method_line(spec) for spec in available_specs() if not spec.endswith(HYBRID)}
        | {f"NAME{HYBRID}": "a method that rewards, under the hybrid policy mechanism (Han et al. 2023)"},
        "presets": PRESET_LINES,
    }
    columns = terminal.width()
    return "\n\n".join(f"{title}:\n{terminal.described(lines, columns)}" for title, lines in sections.items())


def _task_line(task: str) -> str:
    spec = task_spec(task)
    if spec.about or spec.is_slow_to_enumerate:
        return spec.about or f"{spec.n_blocks} blocks"
    layers, counts = np.unique(spec.goal_space.layers, return_counts=True)
    parts = ", ".join(f"{count} of height {layer}" for layer, count in zip(layers, counts, strict=True))
    return f"{spec.n_blocks} blocks, {counts.sum()} goals: {parts}"


def _method_line(spec: str) -> str:
    """The method's idea and paper; the class of a method that an installed package provides, which is not imported."""
    if spec == "sac":
        return "no intrinsic reward: goal-conditioned SAC with hindsight relabelling (Haarnoja et al. 2018)"
    if spec in ALIASES:
        return f"{split(ALIASES[spec])[0]} under the hybrid policy mechanism (Han et al. 2023)"
    if spec in BUILT_IN:
        return BUILT_IN[spec].line
    return f"not built in: {' or '.join(installed_methods()[spec])}"
