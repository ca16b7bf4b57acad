"""The agent and the replay of a run's newest checkpoint, read-only, and published agents."""

from collections.abc import Container
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from curiobench import checkpoint
from curiobench.analysis.folders import find_agent
from curiobench.build import build_agent, build_replay
from curiobench.config import RunConfig
from curiobench.methods.agents.agent import LearningAgent
from curiobench.methods.process import tune_process
from curiobench.methods.specs import canonical, display_name
from curiobench.published_agent import load_published
from curiobench.replay import EpisodeReplay
from curiobench.run_folder import CHECKPOINT, REPLAY, read_config


@dataclass(frozen=True)
class SavedRun:
    """What the newest checkpoint of a run holds."""

    path: Path
    """Run folder."""
    config: RunConfig
    """Of the run."""
    agent: LearningAgent
    """On the CPU."""
    epoch: int
    """Epochs that the agent has completed."""
    replay_name: str
    """Of the replay's manifest."""

    def load_replay(self) -> EpisodeReplay:
        """The replay that the agent last learned from.

        Raises ValueError where it is damaged, or gone, as it is once a run is finished, unless it was to be kept.
        """
        folder = self.path / REPLAY
        if not folder.is_dir():
            raise ValueError(
                f"{self.path} has no replay any more; runs trained with --machine.keep-replay keep theirs when finished"
            )
        replay = build_replay(self.config)
        with checkpoint.errors_named(folder.parent):
            replay.load(folder, self.replay_name)
        return replay


def load_agent(path: Path, method: str | None = None) -> tuple[RunConfig, LearningAgent]:
    """The config and the agent of a run folder, see `load_saved`, or of a published set: v2/stack3/mihm.

    `method` may name the agent's method; one that is not built in has to be named before its code is imported. Raises
    ValueError as `load_saved` and `load_published`, where a published set has no such agent, and where the agent is of
    another method.
    """
    folder = find_agent(path)
    if folder is not None:
        config, agent = load_published(folder, {method})
    else:
        saved = load_saved(path, {method})
        config, agent = saved.config, saved.agent
    if method is not None and canonical(method) != config.method:
        raise ValueError(f"{path} has an agent of {display_name(config.method)}, not of {method}")
    return config, agent


def load_saved(path: Path, trusted: Container[str] = ()) -> SavedRun:
    """What a run folder holds, whether the run is finished or not.

    Raises ValueError if the folder is not a run folder, has no checkpoint yet, its checkpoint is damaged, or its method
    is not built in and not `trusted`.
    """
    config = read_config(path, trusted)
    tune_process(config.torch_threads)
    folder = path / CHECKPOINT
    saved = checkpoint.load(folder, config.fingerprint())
    if saved is None:
        raise ValueError(f"{path} has no checkpoint yet")
    on_cpu = replace(config, device="cpu")
    agent = build_agent(on_cpu, np.random.SeedSequence(config.seed))
    state, values = saved
    with checkpoint.errors_named(folder):
        # a GPU's generator has another state than a CPU's; it is not used here
        agent.load_state_dict(state | {"generator": agent.state_dict()["generator"]})
        return SavedRun(path, config, agent, values["counters"]["epoch"], values["replay"])
