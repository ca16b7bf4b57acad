"""The agent of a run's newest checkpoint, for those who only want to watch it."""

from collections.abc import Container
from dataclasses import replace
from pathlib import Path

import numpy as np

from curiobench import checkpoint
from curiobench.config import RunConfig
from curiobench.methods.process import tune_process
from curiobench.methods.sac import SAC
from curiobench.run_folder import read_config
from curiobench.tasks.goals import goal_space
from curiobench.tasks.registration import n_blocks_of
from curiobench.training_state import build_agent


def load_agent(path: Path, trusted: Container[str] = ()) -> tuple[RunConfig, SAC]:
    """The config and the agent of a run folder, whether the run is finished or not; the agent on the CPU.

    Raises ValueError where the folder is not a run's, has no checkpoint yet, its checkpoint is damaged, or its method
    comes from outside and is not `trusted`.
    """
    return load_agent_and_epoch(path, trusted)[:2]


def load_agent_and_epoch(path: Path, trusted: Container[str] = ()) -> tuple[RunConfig, SAC, int]:
    """As `load_agent`, with the epochs that the checkpoint's agent has completed."""
    config = read_config(path, trusted)
    tune_process(config.torch_threads)
    folder = path / "checkpoint"
    saved = checkpoint.load(folder, config.fingerprint())
    if saved is None:
        raise ValueError(f"{path} has no checkpoint yet")
    on_cpu = replace(config, device="cpu")
    agent = build_agent(on_cpu, goal_space(n_blocks_of(config.task)), np.random.SeedSequence(config.seed))
    with checkpoint.errors_named(folder):
        # a GPU's generator has another state than a CPU's; watching draws no random numbers
        agent.load_state_dict(saved[0] | {"generator": agent.state_dict()["generator"]})
    return config, agent, saved[1]["counters"]["epoch"]
