"""`TaskSpec`, the definition of a task. This module does not import MuJoCo."""

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
"""Default number of actions per episode."""

DrawStarts = Callable[[np.random.Generator, np.ndarray, int, "BiasedStarts"], tuple[np.ndarray, np.ndarray]]
"""Draws the start positions of blocks. Arguments and results are those of `starts.sample_starts`."""


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
    """A task. Its functions must be module-level functions, not lambdas, so that environments can be pickled."""

    name: str
    """Unique name in options, config.json and tables."""
    n_blocks: int
    """2 to 5."""
    gym_id: str
    """Id of the Gymnasium environments, such as "curiobench/SemanticStack3-v0"."""
    about: str = ""
    """One line for `curiobench list`; by default the numbers of blocks and goals."""
    robots: tuple[str, ...] = ROBOTS
    """Robots that the task supports."""
    horizon: int = EPISODE_STEPS
    """Actions per episode, unless Gymnasium gets `max_episode_steps`. An episode never ends earlier."""
    keeps: Keeps | None = None
    """Selects the task's goals among those that can be built; all by default."""
    arena: Callable[[], "composer.Arena"] = paper_arena
    """Creates the scene to which robot and blocks are added. Its table must be as high as the paper's."""
    starts: DrawStarts = paper_starts
    """Draws the start positions of blocks."""

    @property
    def goal_space(self) -> GoalSpace:
        """Predicates and goals, with their names and layers; enumerated once and cached."""
        return goal_space(self.n_blocks, self.keeps)

    @property
    def is_slow_to_enumerate(self) -> bool:
        """Whether enumerating the goals takes ten seconds. Listings and readers of results then skip it."""
        return self.n_blocks > 4
