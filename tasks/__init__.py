"""Semantic-stacking tasks: blocks on a table, a hand, and goals such as "a on b".

`load` gives a dm_control environment, `BatchedStacking` steps many worlds at once, and `gymnasium.make` and
`gymnasium.make_vec` know both as "curiobench/SemanticStack3-v0" (2 to 5 blocks) once `curiobench` is imported.
"""

from curiobench.tasks import opengl
from curiobench.tasks.registration import ROBOTS, TASK_VERSION, TASKS, n_blocks_of

opengl.choose()  # here, because MuJoCo and dm_control choose their renderer when they are imported

__all__ = ["ROBOTS", "TASKS", "TASK_VERSION", "BatchedStacking", "load", "n_blocks_of"]


def __getattr__(name: str):
    # imported on first use: MuJoCo takes half a second to load, and `curiobench --help` needs none of it
    if name == "load":
        from curiobench.tasks.stacking import load

        return load
    if name == "BatchedStacking":
        from curiobench.tasks.batch import BatchedStacking

        return BatchedStacking
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
