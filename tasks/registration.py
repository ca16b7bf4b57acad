"""Names of the tasks and robots, and their registration with Gymnasium. Imports no MuJoCo."""

import difflib

import gymnasium

TASKS = ("stack2", "stack3", "stack4", "stack5")
ROBOTS = ("gripper", "fetch")
TASK_VERSION = 1
"""Raised whenever worlds, goals, rewards or starts change such that results do; config.json of every run names it."""
EPISODE_STEPS = 50
"""Actions per episode, unless Gymnasium is told another number; an episode never ends earlier."""


def n_blocks_of(task: str) -> int:
    """Number of blocks of a task; raises ValueError for an unknown one."""
    return int(check_name("task", task, TASKS).removeprefix("stack"))


def check_name(kind: str, name: str, legal: tuple[str, ...]) -> str:
    """Returns `name` if it is one of `legal`; raises a ValueError that lists them, the nearest first, otherwise."""
    if name in legal:
        return name
    near = difflib.get_close_matches(str(name), legal, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise ValueError(f"unknown {kind} {name!r}: {hint}the {kind}s are {', '.join(legal)}")


def register() -> None:
    """Registers "curiobench/SemanticStackN-v0" with Gymnasium; importing `curiobench` does it."""
    for task in TASKS:
        gymnasium.register(
            id=f"curiobench/SemanticStack{n_blocks_of(task)}-v0",
            entry_point="curiobench.tasks.gym_env:SemanticStackEnv",
            vector_entry_point="curiobench.tasks.gym_vector:SemanticStackVectorEnv",
            kwargs={"task": task},
            max_episode_steps=EPISODE_STEPS,
        )
