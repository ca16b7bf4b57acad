"""Builds the parts of a run from its config: agent, curriculum and replay."""

from pathlib import Path
from typing import TypeVar

import numpy as np
import torch

from curiobench.config import RunConfig
from curiobench.curriculum import CURRICULA
from curiobench.methods.agents.agent import LearningAgent
from curiobench.methods.agents.pairs import PairLayout
from curiobench.methods.curriculum import Curriculum, GoalMethod, Goals
from curiobench.methods.plugins import building
from curiobench.methods.registry import make_agent, parse_spec
from curiobench.replay import EpisodeReplay
from curiobench.tasks.goals import GoalSpace
from curiobench.tasks.observation import BLOCK_SIZE, BODY_SIZE
from curiobench.tasks.registration import task_spec
from curiobench.tasks.spec import ACTION_SIZE

Goal = TypeVar("Goal", bound=GoalMethod)


def pair_layout(goal_space: GoalSpace) -> PairLayout:
    """Columns of blocks and predicate bits of a task, for the networks."""
    pairs = tuple((p.i, p.j, p.close, p.on_ij, p.on_ji) for p in goal_space.pairs)
    return PairLayout(goal_space.n_blocks, pairs, BODY_SIZE, BLOCK_SIZE, ACTION_SIZE)


def build_agent(config: RunConfig, seed: np.random.SeedSequence) -> LearningAgent:
    """The agent of a config, on its device; raises ValueError where this machine does not have that device."""
    name, _, number = config.device.partition(":")
    if name == "cuda" and int(number or 0) >= (found := torch.cuda.device_count()):
        raise ValueError(f"device {config.device!r} is not available: torch finds {found} CUDA devices here")
    generator = torch.Generator(config.device).manual_seed(int(seed.generate_state(1, np.uint64)[0] >> 1))
    layout = pair_layout(task_spec(config.task).goal_space)
    return make_agent(config.method, layout, config.sac, generator, config.hybrid, config.method_config)


def goals_of(goal_space: GoalSpace) -> Goals:
    """A task's goals, as curricula and relabellings get them."""
    pairs = np.array([(p.close, p.on_ij, p.on_ji) for p in goal_space.pairs])
    return Goals(goal_space.goals.astype(np.uint8), goal_space.layers, pairs)


def build_curriculum(config: RunConfig) -> Curriculum:
    """The method's own curriculum, or that of the config."""
    return _built(parse_spec(config.method).curriculum or CURRICULA[config.curriculum], config)


def build_replay(config: RunConfig, folder: Path | None = None) -> EpisodeReplay:
    """The empty replay of a config, memory-mapped in a folder if one is given."""
    own, spec = parse_spec(config.method).relabelling, task_spec(config.task)
    return EpisodeReplay(
        config.replay,
        valid_goals=spec.goal_space.goals,
        steps=spec.horizon,
        observation_size=pair_layout(spec.goal_space).observation_size,
        action_size=ACTION_SIZE,
        on_bits=spec.goal_space.on_bits,
        folder=folder,
        relabelling=own and _built(own, config),
    )


def _built(method: type[Goal], config: RunConfig) -> Goal:
    """A curriculum or a relabelling; raises ValueError, with its file, where building it raises."""
    with building(method, config.method):
        return method(goals_of(task_spec(config.task).goal_space), config.method_config)
