"""Runs from Python, as the command line makes them.

import curiobench

run = curiobench.train(task="stack2", method="mihm", preset="smoke", out="runs/demo")
run.evaluations                                # pandas frame, a row per evaluation and goal
action, _ = run.agent().predict(observation)   # of the Gymnasium environment
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from curiobench.cli.train_arguments import flags_of, parse_train
from curiobench.config import RunConfig
from curiobench.methods.agents.agent import LearningAgent
from curiobench.run_folder import read_config
from curiobench.saved_agent import load_agent as load_config_and_agent
from curiobench.training import train as train_run

OBSERVATION_KEYS = ("observation", "achieved_goal", "desired_goal")
"""Of an observation of the environments."""


class Agent:
    """A trained agent."""

    def __init__(self, agent: LearningAgent) -> None:
        self._agent = agent

    def predict(
        self,
        observation: Mapping[str, np.ndarray],
        state: None = None,
        episode_start: None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, None]:
        """Actions, in the manner of stable-baselines3.

        Args:
            observation: of `curiobench/SemanticStack…`: "observation" (D,), "achieved_goal" and "desired_goal"
                (bits,), or many of them, (N, D) and (N, bits).
            state: not used.
            episode_start: not used.
            deterministic: the policy's mode, as in evaluations; else a sample.

        Returns:
            Actions (A,) or (N, A) in [-1, 1], and None.

        Raises:
            ValueError: a part is missing, not finite, or of another size than the agent's task has.
        """
        if missing := [name for name in OBSERVATION_KEYS if name not in observation]:
            raise ValueError(f"the observation lacks {missing[0]!r}; it needs {', '.join(OBSERVATION_KEYS)}")
        layout = self._agent.learner.layout
        sizes = layout.observation_size, layout.goal_size, layout.goal_size
        parts = [np.asarray(observation[name], np.float32) for name in OBSERVATION_KEYS]
        for name, part, size in zip(OBSERVATION_KEYS, parts, sizes, strict=True):
            if part.ndim not in (1, 2) or part.shape[-1] != size:
                raise ValueError(f"{name} has shape {part.shape}; expected ({size},) or (N, {size})")
            if not np.isfinite(part).all():
                raise ValueError(f"{name} has a number that is not finite")
        if len({part.shape[:-1] for part in parts}) > 1:
            raise ValueError(
                f"the parts of the observation have shapes {[part.shape for part in parts]}; one N is expected"
            )
        actions = self._agent.act(*map(np.atleast_2d, parts), deterministic)
        return (actions if parts[0].ndim == 2 else actions[0]), None


@dataclass(frozen=True)
class Run:
    """A run folder, finished or not."""

    path: Path
    """The folder."""
    method: str | None = None
    """The run's method if it is not built in; naming it allows importing it."""

    @property
    def config(self) -> RunConfig:
        """All options of the run."""
        return read_config(self.path, {self.method})

    @property
    def progress(self) -> pd.DataFrame:
        """A row per epoch; docs/training.md explains the columns. Empty before the first epoch has ended."""
        return self._rows("progress.csv")

    @property
    def evaluations(self) -> pd.DataFrame:
        """A row per evaluation and goal. Empty before the first evaluation."""
        return self._rows("evaluations.csv")

    @property
    def result(self) -> dict[str, Any] | None:
        """A summary of the last evaluation and the cost of the run; None if it is not finished."""
        path = self.path / "result.json"
        return json.loads(path.read_bytes()) if path.exists() else None

    def agent(self) -> Agent:
        """The agent of the newest checkpoint. Raises ValueError where there is none."""
        return load_agent(self.path, self.method)

    def _rows(self, name: str) -> pd.DataFrame:
        path = self.path / name
        return pd.read_csv(path, dtype={"bits": str}) if path.exists() else pd.DataFrame()


def train(
    task: str = "stack3",
    method: str = "sac",
    preset: str = "laptop",
    seed: int = 0,
    *,
    out: str | Path,
    resume: bool = False,
    options: Mapping[str, Any] | None = None,
) -> Run:
    """Train a run, as `curiobench train` does.

    Args:
        task: a task's name; `curiobench list` shows them all.
        method: method spec.
        preset: gives the defaults of all options.
        seed: of all randomness in training.
        out: the run folder.
        resume: continue what is there under the same options, or begin.
        options: any other options, by the names that `curiobench train --help` shows: {"epochs": 2, "sac.gamma": 0.9}.

    Raises:
        ValueError: an option is wrong, or the run cannot be begun.
        curiobench.errors.RunFailed: it failed; `error.log` in the folder has the details.
        curiobench.errors.Interrupted: on Ctrl-C, after a checkpoint.
    """
    axes = {"task": task, "method": method, "preset": preset, "seed": seed, "out": str(out)}
    flags = [flag for name, value in (axes | dict(options or {})).items() for flag in flags_of(name, value)]
    if "--help" in flags:  # would print the help and exit
        raise ValueError("help is not an option of a run")
    parsed = parse_train([*flags, *(["--resume"] if resume else [])])
    train_run(parsed.config, parsed.out, parsed.resume, ("curiobench", "train", *flags))
    return load_run(parsed.out, parsed.config.method)


def load_run(path: str | Path, method: str | None = None) -> Run:
    """A run folder. If the run's method is not built in, `method` must name it, which allows importing it.

    Raises ValueError if the folder is not a run folder, or its method is not built in and not named.
    """
    run = Run(Path(path), method)
    run.config  # noqa: B018 - raises if it is not a run
    return run


def load_agent(path: str | Path, method: str | None = None) -> Agent:
    """The agent of a run's newest checkpoint, or of a published set; arguments and errors as `load_run`.

    "v2/stack3/mihm" is the agent that set v2 has of this task and method; instead of v2 there may be the path of a
    set. Raises ValueError, too, where there is no such agent, it is one of another method than `method`, or its files
    are damaged.
    """
    return Agent(load_config_and_agent(Path(path), method)[1])
