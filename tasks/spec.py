"""`TaskSpec`: all that makes one task differ from another. Imports no MuJoCo."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from curiobench.tasks.goals import GoalSpace, Keeps, goal_space

if TYPE_CHECKING:
    from dm_control import composer

    from curiobench.tasks.starts import BiasedStarts

ROBOTS = ("gripper", "fetch")
ACTION_SIZE = 4
"""Numbers in an action: hand displacement (x, y, z) and finger displacement."""
EPISODE_STEPS = 50
"""Actions per episode of a task that does not say otherwise."""

DrawStarts = Callable[[np.random.Generator, np.ndarray, int, "BiasedStarts"], tuple[np.ndarray, np.ndarray]]
"""Draws where blocks are when episodes start; arguments and results are those of `starts.sample_starts`."""


def paper_arena() -> "composer.Arena":
    """The paper's table."""
    from curiobench.tasks.scene import TableArena  # here, because MuJoCo takes half a second to load

    return TableArena()


def paper_starts(
    rng: np.random.Generator, biased: np.ndarray, n_blocks: int, probabilities: "BiasedStarts"
) -> tuple[np.ndarray, np.ndarray]:
    """The paper's starts; see `starts.sample_starts`."""
    from curiobench.tasks.starts import sample_starts

    return sample_starts(rng, biased, n_blocks, probabilities)


@dataclass(frozen=True)
class TaskSpec:
    """A task. Its functions are those of a module, not lambdas, so that environments can be pickled."""

    name: str
    """In options, config.json and tables; registered once."""
    n_blocks: int
    """2 to 5."""
    gym_id: str
    """Of the Gymnasium environments, such as "curiobench/SemanticStack3-v0"."""
    about: str = ""
    """One line for `curiobench list`; the numbers of blocks and goals unless given."""
    robots: tuple[str, ...] = ROBOTS
    """Robots that the task may be run with."""
    horizon: int = EPISODE_STEPS
    """Actions per episode, unless Gymnasium is told another number; an episode never ends earlier."""
    keeps: Keeps | None = None
    """Chooses the task's goals among all that can be built; all unless given."""
    arena: Callable[[], "composer.Arena"] = paper_arena
    """Makes the scene that robot and blocks are put into; its table is as high as the paper's."""
    starts: DrawStarts = paper_starts
    """Draws where blocks are when episodes start."""

    @property
    def goal_space(self) -> GoalSpace:
        """Predicates and goals, with their names and layers; enumerated once."""
        return goal_space(self.n_blocks, self.keeps)

    @property
    def is_slow_to_enumerate(self) -> bool:
        """Whether enumerating the goals takes ten seconds, which listings and readers of results do without."""
        return self.n_blocks > 4

    def check_robot(self, robot: str) -> None:
        """Raises ValueError unless the task may be run with a robot of this name."""
        if robot not in self.robots:
            raise ValueError(f"{self.name} does not take the robot {robot!r}: its robots are {', '.join(self.robots)}")
