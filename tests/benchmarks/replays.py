"""Replays of random episodes, as large as those of a real run, and batches from them."""

from dataclasses import replace

import numpy as np
from layouts import layout_of

from curiobench.config import RunConfig
from curiobench.methods.agents.pairs import PairLayout
from curiobench.methods.reward import Batch
from curiobench.presets import PRESETS, preset
from curiobench.replay import EpisodeReplay, Episodes, ReplayConfig

STEPS = 50


def filled_replay(
    layout: PairLayout, config: ReplayConfig = PRESETS["paper"].replay, episodes: int = 400
) -> EpisodeReplay:
    """Random episodes whose goal changes once, somewhere; as many goals as three blocks have."""
    rng = np.random.default_rng(0)
    goals = np.unique(rng.integers(0, 2, (60, layout.goal_size), dtype=np.uint8), axis=0)[:35]

    config = replace(config, capacity=episodes)
    on_bits = np.arange(layout.goal_size) >= len(layout.pairs)
    replay = EpisodeReplay(config, goals, STEPS, layout.observation_size, layout.action_size, on_bits)
    ends = goals[rng.integers(0, len(goals), (2, episodes))]
    changed = np.arange(STEPS + 1)[None, :, None] >= rng.integers(1, STEPS, (episodes, 1, 1))
    observation = rng.normal(size=(episodes, STEPS + 1, layout.observation_size))
    action = rng.uniform(-1, 1, (episodes, STEPS, layout.action_size))
    replay.add(Episodes(observation, np.where(changed, ends[1][:, None], ends[0][:, None]), action, ends[1]))
    return replay


def laptop_batch(n_blocks: int) -> tuple[RunConfig, Batch]:
    """The preset laptop for a task, and a batch of its size with all that methods ask for."""
    config = preset("laptop", f"stack{n_blocks}")
    replay = filled_replay(layout_of(n_blocks), config.replay)
    return config, Batch.from_numpy(replay.sample(config.batch_size, np.random.default_rng(1), 512, episodes=True))
