"""Which tasks exist, and their registration with Gymnasium. The one place to register a task. Imports no MuJoCo."""

import difflib

import gymnasium

from curiobench.tasks.spec import ROBOTS, TaskSpec

_SPECS = (
    TaskSpec("stack2", n_blocks=2, gym_id="curiobench/SemanticStack2-v0"),
    TaskSpec("stack3", n_blocks=3, gym_id="curiobench/SemanticStack3-v0"),
    TaskSpec("stack4", n_blocks=4, gym_id="curiobench/SemanticStack4-v0"),
    TaskSpec("stack5", n_blocks=5, gym_id="curiobench/SemanticStack5-v0", about="5 blocks, some 14,000 goals"),
)
_BY_NAME = {spec.name: spec for spec in _SPECS}
TASKS = tuple(_BY_NAME)
"""Names of the tasks."""
TASK_VERSION = 1
"""Raised whenever worlds, goals, rewards or starts change such that results do; config.json of every run names it."""


def task_spec(task: str) -> TaskSpec:
    """The spec of a task; raises ValueError for an unknown one."""
    return _BY_NAME[check_name("task", task, tuple(_BY_NAME))]


def check_robot(task: str, robot: str) -> None:
    """Raises ValueError for an unknown task or robot, or a robot that the task may not be run with."""
    spec = task_spec(task)
    check_name("robot", robot, ROBOTS)
    spec.check_robot(robot)


def check_name(kind: str, name: str, legal: tuple[str, ...]) -> str:
    """Returns `name` if it is one of `legal`; raises a ValueError that lists them, the nearest first, otherwise."""
    if name in legal:
        return name
    near = difflib.get_close_matches(str(name), legal, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise ValueError(f"unknown {kind} {name!r}: {hint}the {kind}s are {', '.join(legal)}")


def register() -> None:
    """Registers every task with Gymnasium; importing `curiobench` does it."""
    for spec in _SPECS:
        gymnasium.register(
            id=spec.gym_id,
            entry_point="curiobench.tasks.gym_env:SemanticStackEnv",
            vector_entry_point="curiobench.tasks.gym_vector:SemanticStackVectorEnv",
            kwargs={"task": spec.name},
            max_episode_steps=spec.horizon,
        )
