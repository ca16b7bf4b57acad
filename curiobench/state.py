"""The state of training: worlds, agent, replay, random streams and counters, saved and restored together."""

import os
import platform
import resource
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from curiobench.build import build_agent, build_curriculum, build_replay
from curiobench.config import RunConfig
from curiobench.evaluation import Evaluation, last_evaluation, learned_by_layer
from curiobench.files import now
from curiobench.methods.curriculum import Situation
from curiobench.methods.goal_guard import curriculum_metrics, curriculum_state, goal_weights, goals_drawn
from curiobench.methods.guard import NonFiniteError, blamed
from curiobench.methods.reward import Batch
from curiobench.replay import Episodes
from curiobench.rollout import collect, successes
from curiobench.tasks import BatchedStacking

STREAMS = ("worlds", "goals", "replay", "agent")
"""Random streams of a run, spawned from its seed by position. Only append: another order changes every run."""

PHASES = ("collecting", "sampling", "updating", "evaluating", "checkpointing")
"""What the wall-clock time of a run is spent on."""
WALL_CLOCK = ("seconds", *(f"seconds_{part}" for part in PHASES))
"""Columns of progress.csv that may differ between two runs of one config; they come last."""


@dataclass
class Counters:
    """Progress of training, and sums for the next row of progress.csv. Plain values only."""

    epoch: int = 0
    """Epochs completed."""
    cycle: int = 0
    """Cycles completed in the current epoch."""
    steps: int = 0
    """Steps collected, in all worlds together."""
    updates: int = 0
    """Gradient updates made."""
    sums: dict[str, float] = field(default_factory=dict)
    """Sums over the current epoch of what `collect` counts, by name."""
    metrics: dict[str, float] = field(default_factory=dict)
    """Sums over the current epoch's cycles of the mean of each metric of the agent, by name."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Wall-clock seconds since training began, by phase."""

    peak_memory_mb: float = 0.0
    """Largest memory of any of the run's processes so far."""

    def note_memory(self) -> float:
        """Update `peak_memory_mb` by this process, and return it."""
        self.peak_memory_mb = max(self.peak_memory_mb, _peak_memory_mb())
        return self.peak_memory_mb

    @contextmanager
    def timed(self, part: str) -> Iterator[None]:
        """Add the time that a block of code takes to the phase `part`."""
        started = time.perf_counter()
        yield
        self.seconds[part] = self.seconds.get(part, 0.0) + time.perf_counter() - started


def _peak_memory_mb() -> float:
    """Largest resident memory of this process so far, in MB."""
    status = Path("/proc/self/status")
    lines = status.read_text(encoding="utf-8").splitlines() if status.exists() else []
    for line in lines:
        if line.startswith("VmHWM:"):  # the resource module would also count the process that started this one
            return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1024**2 if sys.platform == "darwin" else 1024)


class TrainingState:
    """State of a run between two rollouts or updates.

    Attributes:
        agent: learns and acts.
        replay: the episodes it learns from.
        curriculum: draws the goals that episodes pursue.
        counters: progress and sums.
        reached: `(G,)` bool, valid goals that an episode of this run has ended in.
    """

    def __init__(self, config: RunConfig, mapped_replay: Path) -> None:
        """
        Args:
            config: of the run.
            mapped_replay: folder for the memory-mapped replay, if the config asks for one.
        """
        self.config, self.counters = config, Counters()
        streams = dict(zip(STREAMS, np.random.SeedSequence(config.seed).spawn(len(STREAMS)), strict=True))
        self._generators = {name: np.random.default_rng(streams[name]) for name in ("goals", "replay")}
        self._worlds = BatchedStacking(
            config.task, config.worlds, config.robot, config.machine.threads, streams["worlds"]
        )
        self._goal_space = self._worlds.goal_space
        self.reached = np.zeros(len(self._goal_space), bool)
        self.agent = build_agent(config, streams["agent"])
        self.replay = build_replay(config, mapped_replay if config.machine.replay_on_disk else None)
        self.curriculum = build_curriculum(config)
        self.replay.goal_weights = goal_weights(self.curriculum)

    def collect(self) -> None:
        """Collect an episode in every world, and update the replay, the normalisers and the reached goals."""
        size, valid = self.config.worlds, self._goal_space.goals
        biased = self.config.starts == "biased" and self.counters.epoch >= self.config.biased_from_epoch
        with self.counters.timed("collecting"):
            start = self._worlds.reset(biased=biased, goals=np.broadcast_to(valid[0], (size, valid.shape[1])))
            situation = Situation(self.reached.copy(), start.achieved_goal)
            goals, tested = goals_drawn(self.curriculum, situation, self._generators["goals"])
            episodes, intact = collect(self._worlds, self.agent, valid[goals], tested)
            self.replay.add(episodes)
            desired = np.broadcast_to(episodes.desired_goal[:, None], episodes.achieved_goal.shape)
            self.agent.observe(episodes.observation, episodes.achieved_goal, desired, episodes.action)
        ends = self._goal_space.indices(episodes.achieved_goal[:, -1])
        with blamed(self.curriculum, "observe"):
            self.curriculum.observe(goals[intact], ends, tested[intact])
        self.replay.goal_weights = goal_weights(self.curriculum)
        self.reached[ends[ends >= 0]] = True
        self.counters.steps += size * self._worlds.horizon
        self._count(episodes)

    def _count(self, episodes: Episodes) -> None:
        success, satisfied = successes(episodes)
        for name, number in (
            ("episodes", self.config.worlds),
            ("diverged", self.config.worlds - len(success)),
            ("success", success.sum()),
            ("unsatisfied", (~satisfied).sum()),
            ("success_unsatisfied", success[~satisfied].sum()),
        ):
            self.counters.sums[name] = self.counters.sums.get(name, 0) + int(number)

    def learn(self) -> None:
        """The gradient updates of a cycle. Raises NonFiniteError where a loss or a metric is NaN or infinite."""
        epoch = self.config.paper_epoch(self.counters.epoch, self.counters.cycle)
        totals: dict[str, torch.Tensor] = {}
        counts: Counter[str] = Counter()
        for _ in range(self.config.updates):
            with self.counters.timed("sampling"):
                batch = Batch.from_numpy(self._sample())
            with self.counters.timed("updating"):
                metrics = self.agent.update(batch, epoch)
                # sum tensors: reading each value would make a GPU wait
                totals |= {name: value + totals.get(name, 0) for name, value in metrics.items()}
                counts.update(metrics.keys())
        for name, total in totals.items():
            if not torch.isfinite(total):
                raise NonFiniteError(f"updates {self.counters.updates} and following: {name} is {float(total)}")
            self.counters.metrics[name] = self.counters.metrics.get(name, 0.0) + float(total) / counts[name]
        self.counters.updates += self.config.updates

    def _sample(self) -> dict[str, np.ndarray | None]:
        """A batch, with particles and episodes if the curiosity method uses them."""
        curiosity = self.agent.learner.curiosity
        wanted = () if curiosity is None else (curiosity.method.n_particles, curiosity.method.uses_episode)
        return self.replay.sample(self.config.batch_size, self._generators["replay"], *wanted)

    def end_epoch(self) -> None:
        """Count the epoch and reset its sums."""
        with blamed(self.curriculum, "end_epoch"):
            self.curriculum.end_epoch()
        self.replay.goal_weights = goal_weights(self.curriculum)
        self.counters.epoch += 1
        self.counters.cycle = 0
        self.counters.sums.clear()
        self.counters.metrics.clear()

    def save(self, folder: Path) -> dict[str, Any]:
        """Save all state but the agent's: write the replay's new episodes to `folder`, and return the rest for JSON.

        Positions in the worlds are not saved, because a checkpoint is taken between episodes and `collect` resets.
        """
        return {
            "replay": self.replay.save(folder),
            "counters": asdict(self.counters),
            "reached": self.reached.tolist(),
            "curriculum": curriculum_state(self.curriculum),
            "worlds": {"rng": self._worlds.rng.bit_generator.state, "divergences": self._worlds.divergences},
            "generators": {name: g.bit_generator.state for name, g in self._generators.items()},
        }

    def load(self, folder: Path, agent: dict[str, Any], values: dict[str, Any]) -> None:
        """Restore the agent's `state_dict` and what `save` returned.

        Raises KeyError, TypeError, ValueError, RuntimeError or OSError where they are damaged or of another run.
        """
        self.counters = Counters(**values["counters"])
        self.reached[:] = values["reached"]
        with blamed(self.curriculum, "load_state_dict"):
            self.curriculum.load_state_dict(values["curriculum"])
        self.replay.goal_weights = goal_weights(self.curriculum)
        self._worlds.rng.bit_generator.state = values["worlds"]["rng"]
        self._worlds.divergences = values["worlds"]["divergences"]
        for name, generator in self._generators.items():
            generator.bit_generator.state = values["generators"][name]
        self.agent.load_state_dict(agent)
        self.replay.load(folder, values["replay"])


def progress_row(state: TrainingState, evaluation: Evaluation | None) -> dict[str, Any]:
    """The row of progress.csv for the epoch that ends now. Values that were not measured are None."""
    counters, sums = state.counters, state.counters.sums
    row = {
        "epoch": counters.epoch + 1,
        "steps": counters.steps,
        "updates": counters.updates,
        "episodes": sums["episodes"],
        "diverged": sums["diverged"],
        "training_success": _share(sums["success"], sums["episodes"]),
        "training_success_unsatisfied": _share(sums["success_unsatisfied"], sums["unsatisfied"]),
        "goals_reached": int(state.reached.sum()),
        "goals_learned": None if evaluation is None else int(evaluation.learned.sum()),
        "success": None if evaluation is None else float(evaluation.success_rates.mean()),
    }
    row |= {name: total / state.config.cycles for name, total in counters.metrics.items()}
    row |= curriculum_metrics(state.curriculum)
    seconds = [counters.seconds.get(part, 0.0) for part in PHASES]
    return row | dict(zip(WALL_CLOCK, [sum(seconds), *seconds], strict=True))


def result(state: TrainingState, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The content of result.json: the last evaluation, from the rows of evaluations.csv, and the cost of the run."""
    last = last_evaluation(rows)
    layers = learned_by_layer(last)
    return {
        "epochs": state.counters.epoch,
        "steps": state.counters.steps,
        "updates": state.counters.updates,
        "goals": len(last),
        "goals_learned": sum(learned for learned, _ in layers.values()),
        "learned_by_layer": {str(layer): {"learned": n, "goals": total} for layer, (n, total) in layers.items()},
        "success": sum(float(row["success"]) for row in last) / len(last),
        "seconds": sum(state.counters.seconds.values()),
        "peak_memory_mb": round(state.counters.note_memory()),
        "machine": machine(),
        "finished": now(),
    }


def machine() -> str:
    """Processor model and number of cores."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores"


def _share(part: float, total: float) -> float | None:
    return part / total if total else None
