"""Intrinsic reward and Q_int along scripted episodes, and a controllability score.

The paper's Figures 5 and 6 on any checkpoints; docs/probes.md explains the quantities. Agents do not change.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from curiobench.methods.agents.hybrid import HybridAgent
from curiobench.methods.agents.q_int import MEMBERS
from curiobench.methods.guard import MethodError
from curiobench.methods.reward import Batch
from curiobench.methods.specs import display_name
from curiobench.probe.episodes import Played, transitions
from curiobench.probe.steps import falling, lifting
from curiobench.saved_agent import SavedRun, load_saved

LARGEST_BATCH = 512
"""Largest batch in which a transition is scored; the run's batch size if that is smaller."""
RESAMPLES = 10_000
"""Bootstrap resamples of the starts."""


@dataclass(frozen=True)
class ProbedRun(SavedRun):
    """A run with an intrinsic reward, at its newest checkpoint."""

    label: str
    """The method's spec, with the folder's name where several runs share it."""
    as_of_epoch: int | None = None
    """Epoch that the method is given, of the paper's 500; None for the checkpoint's. Decides MI's lambda."""


@dataclass(frozen=True)
class Reading:
    """Rewards and values of N episodes of T steps of one kind; all (N, T)."""

    raw: np.ndarray
    """r_int."""
    normalised: np.ndarray
    """Its z-score by the mean and standard deviation of every r_int that the run has learned from, clipped to ±5."""
    q_int: dict[str, np.ndarray]
    """Q_int of state and action, "popart" and "zscore"; empty without the hybrid mechanism."""


@dataclass(frozen=True)
class ControllabilityScore:
    """Mean normalised reward of controlled lifting less that of falling, in standard deviations of the reward."""

    lifting: float
    """Mean over lifting steps."""
    falling: float
    """Mean over falling steps."""
    controllability: float
    """Mean difference over the starts that have both kinds of steps."""
    low: float
    """Lower end of its 95 % bootstrap interval over starts."""
    high: float
    """Upper end."""
    starts: int
    """How many starts have both kinds of steps."""


def open_runs(
    paths: Sequence[Path], trusted: Collection[str] = (), as_of_epoch: int | None = None
) -> tuple[list[ProbedRun], list[str]]:
    """Load runs to compare.

    Args:
        paths: run folders.
        trusted: methods that are not built in and may be imported.
        as_of_epoch: epoch that the methods are given, at least 0; that of each checkpoint if None.

    Returns:
        Runs with an intrinsic reward, and notes for the user, a line each.

    Raises ValueError if a folder is not a run folder, has no checkpoint, or is named twice, if tasks or robots differ,
    or if nothing is left.
    """
    if as_of_epoch is not None and as_of_epoch < 0:
        raise ValueError(f"as_of_epoch is {as_of_epoch}; it must be at least 0")
    if not paths:
        raise ValueError("name at least one run folder")
    if len({path.resolve() for path in paths}) < len(paths):
        raise ValueError("a run folder is named twice")
    saved = [load_saved(path, trusted) for path in paths]
    first = saved[0].config
    for run in saved:
        if (run.config.task, run.config.robot) != (first.task, first.robot):
            here, there = (f"{c.task} with the {c.robot}" for c in (run.config, first))
            raise ValueError(f"{run.path} has {here}, {paths[0]} has {there}; runs need the same task and robot")
    curious = [run for run in saved if run.agent.learner.curiosity is not None]
    notes = [f"left out {run.path}: {run.config.method} has no intrinsic reward" for run in saved if run not in curious]
    if not curious:
        raise ValueError("; ".join(notes))
    specs = [display_name(run.config.method) for run in curious]
    names = [run.path.resolve().name for run in curious]
    labels = [spec if specs.count(spec) == 1 else f"{spec} {name}" for spec, name in zip(specs, names, strict=True)]
    if as_of_epoch is not None:
        notes.append(f"methods are asked as of epoch {as_of_epoch}, at which none of these weights was")
    return [
        ProbedRun(**vars(run), label=label, as_of_epoch=as_of_epoch) for run, label in zip(curious, labels, strict=True)
    ], notes


def own_transitions(run: ProbedRun, seed: int) -> Batch:
    """Transitions and particles of a run's own replay, drawn as its last batches were; one transition fewer.

    Raises ValueError where the replay is gone or damaged.
    """
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2,)))
    method = run.agent.learner.curiosity.method
    drawn = run.load_replay().sample(others(run), generator, method.n_particles, method.uses_episode)
    return Batch.from_numpy(drawn)


def others(run: ProbedRun) -> int:
    """How many reference transitions a probed one is scored among."""
    return min(run.config.batch_size, LARGEST_BATCH) - 1


@torch.no_grad()
def read(run: ProbedRun, played: Played, reference: Batch) -> Reading:
    """Intrinsic rewards and Q_int of scripted episodes.

    Args:
        run: has the agent.
        played: N episodes.
        reference: at least `others(run)` transitions and, unless it holds particles, as many as the method wants.

    Raises:
        ValueError: the method raised, or its reward is faulty; names the method and its file.
    """
    probed = transitions(played.episodes)
    shape = played.episodes.action.shape[:2]
    try:
        raw = score_one_by_one(run, Batch.from_numpy(probed), reference)
    except MethodError as error:
        raise ValueError(f"{run.path}: {error}") from None
    normalised = run.agent.learner.curiosity.moments.normalise(raw)
    q_int = {}
    if isinstance(run.agent, HybridAgent):
        values = run.agent.q_int(probed["observation"], probed["action"])
        q_int = {name: values[name].reshape(shape) for name in MEMBERS}
    return Reading(raw.numpy().reshape(shape), normalised.numpy().reshape(shape), q_int)


def score_one_by_one(run: ProbedRun, probed: Batch, reference: Batch) -> torch.Tensor:
    """r_int (B,), raw, of probed transitions, each scored in a batch of its own with the same reference transitions.

    A method that is not built in may compare a transition with others of its batch. Scored together, the steps of an
    episode would be compared with each other, and a reward would depend on how long the block rests afterwards.
    """
    n, size, method = len(probed.reward), others(run), run.agent.learner.curiosity.method
    episodes = () if method.uses_episode else ("episode_observation", "episode_achieved_goal")
    wanted = vars(probed).keys() - {"particles", *episodes}
    parts = {name: [part, getattr(reference, name)] for name, part in vars(probed).items() if name in wanted}
    together = Batch(
        **{name: torch.cat(both)[: n + size] for name, both in parts.items() if all(part is not None for part in both)}
    )
    if method.n_particles:
        states = reference.next_observation[-method.n_particles :]
        together = replace(together, particles=states if reference.particles is None else reference.particles)
    epoch = run.config.paper_epoch(run.epoch) if run.as_of_epoch is None else run.as_of_epoch
    scored = run.agent.transitions(together, epoch)
    rest = torch.arange(n, n + size)
    batches = (scored.rows(torch.cat([torch.tensor([i]), rest])) for i in range(n))
    return torch.stack([run.agent.learner.curiosity.reward(batch)[0] for batch in batches])


def controllability(readings: Sequence[Reading], played: Sequence[Played], seed: int) -> ControllabilityScore:
    """The score of a run, from its readings of both kinds of episodes, which have the same N starts.

    A start's score is the mean over its lifting steps less the mean over its falling steps, in whichever episode they
    happen. Raises ValueError where no start has both.
    """
    normalised = np.concatenate([reading.normalised for reading in readings], axis=1)
    lifts, falls = (np.concatenate([find(p.track) for p in played], axis=1) for find in (lifting, falling))
    return score(normalised, lifts, falls, seed)


def score(normalised: np.ndarray, lifts: np.ndarray, falls: np.ndarray, seed: int) -> ControllabilityScore:
    """The score from normalised rewards, and which steps are lifting and falling, all (N, S).

    The bootstrap resamples starts, so its interval only reflects the choice of starts.
    """
    both = lifts.any(axis=1) & falls.any(axis=1)
    if not both.any():
        raise ValueError("no start has both a lifting and a falling step; take more starts")
    of_lifts, of_falls = (
        np.average(normalised[both], axis=1, weights=steps[both].astype(float)) for steps in (lifts, falls)
    )
    differences = of_lifts - of_falls
    drawn = np.random.default_rng(seed).integers(len(differences), size=(RESAMPLES, len(differences)))
    low, high = np.percentile(differences[drawn].mean(axis=1), (2.5, 97.5))
    means = (float(x) for x in (of_lifts.mean(), of_falls.mean(), differences.mean(), low, high))
    return ControllabilityScore(*means, len(differences))
