"""The list of tasks and their registration with Gymnasium. New tasks are added here. Does not import MuJoCo."""

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
"""Incremented when a change of physics, goals, rewards or starts changes results. Stored in config.json of each run."""


def task_spec(task: str) -> TaskSpec:
    """The spec of a task; raises ValueError if the task is unknown."""
    return _BY_NAME[check_name("task", task, tuple(_BY_NAME))]


def check_robot(task: str, robot: str) -> None:
    """Raises ValueError if the task or robot is unknown, or the task does not support the robot."""
    spec = task_spec(task)
    if check_name("robot", robot, ROBOTS) not in spec.robots:
        raise ValueError(f"{task} does not take the robot {robot!r}: its robots are {', '.join(spec.robots)}")


def check_name(kind: str, name: str, legal: tuple[str, ...]) -> str:
    """Returns `name` if it is in `legal`. Otherwise raises ValueError with the closest match and all legal names."""
    if name in legal:
        return name
    near = difflib.get_close_matches(str(name), legal, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise ValueError(f"unknown {kind} {name!r}: {hint}the {kind}s are {', '.join(legal)}")


def register() -> None:
    """Registers every task with Gymnasium. Called when `curiobench` is imported."""
    for spec in _SPECS:
        gymnasium.register(
            id=spec.gym_id,
            entry_point="curiobench.tasks.gym_env:SemanticStackEnv",
            vector_entry_point="curiobench.tasks.gym_vector:SemanticStackVectorEnv",
            kwargs={"task": spec.name},
            max_episode_steps=spec.horizon,
        )
