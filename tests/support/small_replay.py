"""A replay so small that its batches can be checked by hand."""

from pathlib import Path

import numpy as np

from curiobench.replay import EpisodeReplay, Episodes, ReplayConfig

STEPS, SIZE, ACTIONS = 4, 3, 2
GOALS = np.array([[0, 0], [1, 0], [1, 1]], np.uint8)
ON_BITS = np.array([False, True])


def replay_of(capacity: int = 8, folder: Path | None = None, **config) -> EpisodeReplay:
    config = ReplayConfig(**{"capacity": capacity, **config})
    return EpisodeReplay(config, GOALS, STEPS, SIZE, ACTIONS, ON_BITS, folder)


def episodes_of(numbers: list[int], finals: list[tuple[int, int]]) -> Episodes:
    """Episodes whose observations are 100 · episode + step, so that each is known. Goal 00 until the end."""
    n, steps = len(numbers), np.arange(STEPS + 1)
    achieved = np.zeros((n, STEPS + 1, 2), np.uint8)
    achieved[:, -1] = finals
    place = 100 * np.array(numbers)[:, None] + steps
    observation = np.repeat(place[:, :, None], SIZE, axis=2)
    return Episodes(observation, achieved, np.repeat(place[:, :-1, None] / 1e4, ACTIONS, axis=2), achieved[:, 0])


def filled(episodes: int, capacity: int = 8, **config) -> EpisodeReplay:
    replay = replay_of(capacity, **config)
    for k in range(episodes):
        replay.add(episodes_of([k], [tuple(GOALS[k % 3])]))
    return replay
