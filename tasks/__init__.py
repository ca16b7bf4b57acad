"""Semantic-stacking tasks: blocks on a table, a hand, and goals such as "a on b".

`load` returns a dm_control environment. `BatchedStacking` steps many worlds at once. Importing `curiobench` registers
the tasks with Gymnasium, so that `gymnasium.make` and `gymnasium.make_vec` accept ids such as
"curiobench/SemanticStack3-v0". `task_spec` returns the definition of a task.
"""

from typing import Any

from curiobench.tasks import opengl
from curiobench.tasks.registration import TASK_VERSION, TASKS, task_spec
from curiobench.tasks.spec import ROBOTS, TaskSpec

opengl.choose()  # here, because MuJoCo and dm_control choose their renderer when they are imported

__all__ = ["ROBOTS", "TASKS", "TASK_VERSION", "BatchedStacking", "TaskSpec", "load", "task_spec"]


def __getattr__(name: str) -> Any:
    # imported on first use, because MuJoCo takes half a second to load and `curiobench --help` does not need it
    if name == "load":
        from curiobench.tasks.stacking import load

        return load
    if name == "BatchedStacking":
        from curiobench.tasks.batch import BatchedStacking

        return BatchedStacking
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
