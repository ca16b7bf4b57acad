"""What `curiobench list` prints."""

import numpy as np

from curiobench.methods.registry import available_specs, parse_spec
from curiobench.methods.specs import HYBRID
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
    return "\n\n".join(
        "\n".join([f"{title}:", *(f"  {name:<{max(map(len, lines)) + 2}}{line}" for name, line in lines.items())])
        for title, lines in sections.items()
    )


def _task_line(task: str) -> str:
    spec = task_spec(task)
    if spec.about:
        return spec.about
    layers, counts = np.unique(spec.goal_space.layers, return_counts=True)
    parts = ", ".join(f"{count} of height {layer}" for layer, count in zip(layers, counts, strict=True))
    return f"{spec.n_blocks} blocks, {counts.sum()} goals: {parts}"


def _method_line(spec: str) -> str:
    """The method's idea and paper; what is wrong with it, where a method of an installed package cannot be loaded."""
    try:
        parsed = parse_spec(spec)
    except ValueError as error:
        return f"cannot be loaded: {error}"
    if parsed.method is None:
        return "no intrinsic reward: goal-conditioned SAC with hindsight relabelling (Haarnoja et al. 2018)"
    if parsed.hybrid:
        return f"{parsed.text.removesuffix(HYBRID)} under the hybrid policy mechanism (Han et al. 2023)"
    return parsed.method.idea + (f" ({parsed.method.paper})" if parsed.method.paper else "")
