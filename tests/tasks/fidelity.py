"""Measures how close the worlds are to the paper's, and the robots to each other.

`test_fidelity.py` holds the numbers to their bounds; `make fidelity` writes them into docs/fidelity.md.
Lengths in metres unless a name says millimetres.
"""

from collections.abc import Callable

import numpy as np

from curiobench.tasks import BatchedStacking, scripts
from curiobench.tasks.robots import GRIP_START

EMPTY_TABLE = np.array([[1.10, 0.45, 0.425], [1.10, 1.05, 0.425], [1.50, 1.05, 0.425]])
"""Blocks in the table's corners, out of the hand's way."""
GOALS = {"stack_two": "a on b", "stack_three": "a on b, b on c", "pyramid": "a on b and c"}
STEPS = 50


def hand_path(robot: str, action: list[float], steps: int) -> np.ndarray:
    """Grip positions `(steps + 1, 3)` under one constant action, nothing in the way."""
    worlds = BatchedStacking("stack3", 1, robot)
    seen = worlds.place(np.array([0]), EMPTY_TABLE[None])
    path = [seen.observation[0, :3]]
    for _ in range(steps):
        seen, _ = worlds.step(np.array([action]))
        path.append(seen.observation[0, :3])
    return np.array(path, np.float64)


def reach(robot: str) -> np.ndarray:
    """Distances `(4,)` covered in the first four steps at full action, the mean of up, left and right."""
    directions = np.array([[0, 0, 1], [0, 1, 0], [0, -1, 0]], float)
    paths = [hand_path(robot, [*direction, 0], 4) for direction in directions]
    return np.mean([np.diff(path, axis=0) @ d for path, d in zip(paths, directions, strict=True)], axis=0)


def sag(robot: str) -> float:
    """How far an idle hand sinks in 50 steps."""
    path = hand_path(robot, [0, 0, 0, 0], STEPS)
    return float(path[0, 2] - path[-1, 2])


def finger_times(robot: str) -> tuple[int, int]:
    """Steps at full action that the fingers need from 0.03 to closed (0.002), and from closed to 0.04 open."""
    worlds = BatchedStacking("stack3", 1, robot)
    worlds.place(np.array([0]), EMPTY_TABLE[None])
    worlds.qpos[:, worlds._bound.hand.finger_qpos] = 0.03
    return _steps_until(worlds, -1.0, lambda q: q < 0.002), _steps_until(worlds, 1.0, lambda q: q > 0.04)


def _steps_until(worlds: BatchedStacking, action: float, done: Callable[[float], bool]) -> int:
    for step in range(1, STEPS):
        seen, _ = worlds.step(np.array([[0, 0, 0, action]]))
        if done(seen.observation[0, 3]):
            return step
    raise AssertionError("the fingers do not get there")


def random_play(robot: str, biased: bool, episodes: int) -> dict[str, float]:
    """Shares of random episodes that change a predicate, and of their steps that show no valid goal."""
    worlds = BatchedStacking("stack3", episodes, robot, n_threads=2, seed=3)
    start = worlds.reset(biased=biased)
    rng = np.random.default_rng(0)
    changed, invalid = np.zeros(episodes, bool), 0
    for _ in range(STEPS):
        seen, _ = worlds.step(rng.uniform(-1, 1, (episodes, 4)))
        changed |= (seen.achieved_goal != start.achieved_goal).any(axis=1)
        invalid += (worlds.goal_space.indices(seen.achieved_goal) < 0).sum()
    ended_elsewhere = (seen.achieved_goal != start.achieved_goal).any(axis=1)
    return {
        "changed at the end": float(ended_elsewhere.mean()),
        "changed at some time": float(changed.mean()),
        "steps outside the valid goals": invalid / (episodes * STEPS),
        "block moved by 1 cm": float(_moved(start.observation, seen.observation).mean()),
    }


def _moved(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    blocks = [np.s_[:, 10 + 15 * i : 13 + 15 * i] for i in range(3)]
    return np.any([np.linalg.norm(end[b] - start[b], axis=1) > 0.01 for b in blocks], axis=0)


def held_after_closing(robot: str, episodes: int = 400) -> tuple[int, float]:
    """How many of `episodes` biased starts have a held block, and the share of those held after 5 closing steps."""
    worlds = BatchedStacking("stack3", episodes, robot, n_threads=2, seed=4)
    worlds.reset(biased=True)
    distance = np.linalg.norm(worlds.block_positions - GRIP_START, axis=-1)
    held, block = distance.min(axis=1) < 1e-3, distance.argmin(axis=1)
    for _ in range(5):
        seen, _ = worlds.step(np.tile([0, 0, 0, -1.0], (episodes, 1)))
    gap = np.linalg.norm(worlds.block_positions[np.arange(episodes), block] - seen.observation[:, :3], axis=1)
    return int(held.sum()), float((gap[held] < 0.01).mean())


def script_success(name: str, robot: str, episodes: int = 100) -> float:
    """Share of plain starts in which a script succeeds within 50 steps and what it built stays up to the end.

    `stack_two` is judged by the two blocks alone, `push_together` by "close", `push_off_table` by the fall.
    """
    worlds = BatchedStacking("stack3", episodes, robot, n_threads=2, seed=5)
    seen = worlds.reset()
    script = getattr(scripts, name)()
    holds = []
    for _ in range(STEPS):
        seen, _ = worlds.step(script.act(seen.observation))
        holds.append(_script_goal(name, worlds, seen.achieved_goal))
    holds = np.array(holds)
    since_first = np.maximum.accumulate(holds, axis=0)
    return float((holds == since_first).all(axis=0)[holds.any(axis=0)].sum() / episodes)


def _script_goal(name: str, worlds: BatchedStacking, achieved: np.ndarray) -> np.ndarray:
    ab = worlds.goal_space.pairs[0]
    if name == "stack_two":
        return achieved[:, ab.on_ij] > 0
    if name == "push_together":
        return achieved[:, ab.close] > 0
    if name == "push_off_table":
        return worlds.block_positions[:, 0, 2] < 0.3
    return (achieved == worlds.goal_space.parse(GOALS[name])).all(axis=1)


def open_loop(actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Plays actions `(T, N, 4)` on both robots from the same plain starts.

    Returns:
      Distances between the hands `(T, N)`, whether the predicates agree `(T, N)`, and the arm's path `(T, N, 3)`.
    """
    paths, achieved = {}, {}
    for robot in ("fetch", "gripper"):
        worlds = BatchedStacking("stack3", actions.shape[1], robot, n_threads=2, seed=3)
        worlds.reset()
        seen = [worlds.step(action)[0] for action in actions]
        paths[robot] = np.array([s.observation[:, :3] for s in seen])
        achieved[robot] = np.array([s.achieved_goal for s in seen])
    distance = np.linalg.norm(paths["fetch"] - paths["gripper"], axis=-1)
    return distance, (achieved["fetch"] == achieved["gripper"]).all(axis=-1), paths["fetch"]


def random_actions(episodes: int, steps: int = STEPS) -> np.ndarray:
    """Uniform actions `(steps, episodes, 4)`."""
    return np.random.default_rng(0).uniform(-1, 1, (steps, episodes, 4))


def scripted_actions(name: str, episodes: int) -> np.ndarray:
    """The actions `(50, episodes, 4)` with which a script works on the arm, from the starts of `open_loop`."""
    worlds = BatchedStacking("stack3", episodes, "fetch", n_threads=2, seed=3)
    seen = worlds.reset()
    script = getattr(scripts, name)()
    actions = []
    for _ in range(STEPS):
        actions.append(script.act(seen.observation))
        seen, _ = worlds.step(actions[-1])
    return np.array(actions)


def in_free_space(path: np.ndarray) -> np.ndarray:
    """`(N,)` bool: the arm's hand `(T, N, 3)` touched nothing and kept within the arm's easy reach."""
    x, _, z = np.moveaxis(path, -1, 0)
    return ((x > 1.22) & (x < 1.45) & (z > 0.475) & (z < 0.62)).all(axis=0)
