"""`RunConfig`, which decides every number of a run, and its JSON form.

The docstrings of the fields are the command line's help. Every field can be set there.
"""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from typing import Any, Literal

import tyro

from curiobench.curriculum import CurriculumName
from curiobench.methods.agents.settings import HybridConfig, SACConfig
from curiobench.methods.checks import check_at_least, check_option
from curiobench.options import ADDED_LATER, build_dataclass, flatten, with_track
from curiobench.replay import ReplayConfig
from curiobench.tasks.registration import check_name, check_robot

CONFIG_VERSION = 1
"""Incremented when a field is removed or changes its meaning, or when a new field's default differs from old runs."""

PAPER_EPOCHS = 500
"""Epochs of the paper's runs, in which it gives its schedules."""

LARGEST_SEED = (1 << 31) - 1
"""Tables hold seeds and epochs as 32-bit numbers."""

TRACKER_NAMES = ("tensorboard", "wandb", "mlflow")
"""Names of the trackers; `curiobench.trackers` has them."""

PRESET_NAMES = ("paper", "laptop", "smoke")
"""Names of the presets; `curiobench.presets` has their configs."""

StartsName = Literal["biased", "plain"]
"""Where training episodes start."""


@dataclass(frozen=True)
class MachineConfig:
    """Options of this machine. They change no number, so a resumed run may have others."""

    threads: int = 1
    """Threads that step the worlds."""
    checkpoint_every: int = 1
    """Epochs between checkpoints. A killed run repeats the work after its last checkpoint."""
    replay_on_disk: bool = False
    """Keep the replay in memory-mapped files in the run folder instead of in memory."""
    keep_replay: bool = False
    """Keep the checkpoint's replay when the run is finished, so that it can be lengthened, or probed among its own
    transitions."""
    track: str | None = None
    """Trackers that get the rows of progress.csv, comma-separated: tensorboard, wandb, mlflow (each needs the extra of
    its name)."""

    def __post_init__(self) -> None:
        check_at_least(self, 1, "threads", "checkpoint_every")
        for name in self.trackers:
            check_name("tracker", name, TRACKER_NAMES)

    @property
    def trackers(self) -> tuple[str, ...]:
        """Names in `track`."""
        return tuple(dict.fromkeys(name.strip() for name in (self.track or "").split(",") if name.strip()))


@dataclass(frozen=True)
class RunConfig:
    """All options of a run."""

    task: str = "stack3"
    """Task; `curiobench list` shows them all."""
    method: str = "sac"
    """Method spec; `curiobench list` shows them all."""
    seed: int = 0
    """Seed of all random streams of training. Evaluation has its own, the same for every run."""
    robot: str = "gripper"
    """Robot: gripper (a free-floating hand, several times faster) or fetch (the paper's arm)."""
    preset: str = "laptop"
    """Preset that gives the defaults of all options below: paper, laptop or smoke."""

    epochs: int = 500
    """Epochs of training."""
    cycles: int = 50
    """Cycles per epoch. A cycle collects worlds × rollouts episodes, then makes its gradient updates."""
    worlds: int = 16
    """Worlds that are stepped together."""
    rollouts: int = 2
    """Episodes per cycle in each world, one after the other."""
    updates: int = 30
    """Gradient updates per cycle."""
    batch_size: int = 4096
    """Transitions per gradient update."""
    starts: StartsName = "biased"
    """Starts of training episodes: biased (some have stacks or a held block) or plain (all blocks apart on the table,
    which makes exploration hard). Test episodes always have plain starts."""
    biased_from_epoch: int = 80
    """First epoch, counted from 0, of biased starts."""
    curriculum: CurriculumName = "reached"
    """Which goals training episodes pursue: uniform over those reached so far (reached) or over all (valid), or half of
    them near the start (near). A method such as decstr has its own."""

    schedule_epochs: int = PAPER_EPOCHS
    """Method schedules (MI's lambda, RE3's decay) are defined over 500 epochs; this many of your epochs count as those
    500."""

    evaluate_every: int = 5
    """Epochs between evaluations. There is always one before training and one after the last epoch."""
    episodes_per_goal: int = 25
    """Test episodes of every goal in an evaluation."""

    device: str = "cpu"
    """Device of the networks: cpu, cuda or cuda:N. Results on different devices differ by rounding."""
    torch_threads: int = 1
    """Threads of one torch operation; more than one is seldom faster for networks this small, and may change results by
    rounding."""

    replay: ReplayConfig = field(default_factory=ReplayConfig)
    """Replay of episodes with hindsight relabelling."""
    sac: SACConfig = field(default_factory=SACConfig)
    """The agent."""
    hybrid: HybridConfig = field(default_factory=HybridConfig)
    """The hybrid policy mechanism; only methods with +hm have it."""
    method_config: tyro.conf.Suppress[Any] = None
    """Settings of the curiosity method, an instance of its `Config`; None gives the defaults. `sac` has none."""
    machine: MachineConfig = field(default_factory=MachineConfig)
    """How this machine does the work; changes no number."""

    def __post_init__(self) -> None:
        check_robot(self.task, self.robot)
        check_name("preset", self.preset, PRESET_NAMES)
        check_option(self, "starts", StartsName)
        check_option(self, "curriculum", CurriculumName)
        self._check_method()
        check_at_least(self, 1, "epochs", "cycles", "worlds", "rollouts", "updates", "batch_size")
        check_at_least(self, 1, "evaluate_every", "episodes_per_goal", "torch_threads", "schedule_epochs")
        check_at_least(self, 0, "seed", "biased_from_epoch")
        for name, value in (("seed", self.seed), ("epochs", self.epochs)):
            if value > LARGEST_SEED:
                raise ValueError(f"{name} is {value}; it must be at most {LARGEST_SEED}")
        if self.sac.actor_every > self.updates:
            raise ValueError(f"sac.actor_every is {self.sac.actor_every}, but a cycle has {self.updates} updates")
        if self.worlds > self.replay.capacity:
            raise ValueError(f"worlds is {self.worlds}, but replay.capacity is {self.replay.capacity} episodes")
        if not re.fullmatch(r"cpu|cuda(:\d{1,3})?", self.device):
            raise ValueError(f"device is {self.device!r}; it must be cpu, cuda or cuda:N")

    def _check_method(self) -> None:
        """Make the spec canonical, and check that the settings are the method's."""
        if self.method == "sac" and self.method_config is None:
            return  # spares the presets, and with them `--help`, the second that torch takes to load
        from curiobench.methods.registry import parse_spec

        spec = parse_spec(self.method)
        object.__setattr__(self, "method", spec.text)
        if spec.method is not None and self.method_config is None:
            object.__setattr__(self, "method_config", spec.method.Config())
        kind = type(None) if spec.method is None else spec.method.Config
        if not isinstance(self.method_config, kind):
            raise ValueError(f"method_config is {self.method_config!r}; {spec.text} takes a {kind.__name__}")

    def paper_epoch(self, epoch: int, cycle: int = 0) -> int:
        """Where a run stands after so many epochs and cycles, in epochs of the paper's run, rounded down."""
        return (epoch * self.cycles + cycle) * PAPER_EPOCHS // (self.schedule_epochs * self.cycles)

    def to_json(self) -> dict[str, Any]:
        """Plain values, nested; `from_json` turns them back into an equal config."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Any, version: Any = CONFIG_VERSION) -> "RunConfig":
        """Restore a config.

        Args:
            values: what `to_json` gave.
            version: the `CONFIG_VERSION` it was written under.

        Raises:
            ValueError: another version, an unknown or missing field, or an illegal value; one line, names the field.
        """
        if version != CONFIG_VERSION:
            raise ValueError(f"the config has version {version!r}; this curiobench reads version {CONFIG_VERSION} only")
        values = dict(values) if isinstance(values, dict) else values
        settings = values.pop("method_config", None) if isinstance(values, dict) else None
        config = build_dataclass(cls, with_track(values))
        if settings is None:
            return config
        from curiobench.methods.registry import parse_spec

        found = parse_spec(config.method).method
        if found is None:
            raise ValueError(f"unknown config field method_config: {config.method} has no settings")
        return replace(config, method_config=build_dataclass(found.Config, settings, "method_config."))

    def decisive(self) -> dict[str, Any]:
        """The part of `to_json` that decides the numbers: all but the machine's."""
        return {name: value for name, value in self.to_json().items() if name != "machine"}

    def fingerprint(self) -> str:
        """Hexadecimal digest of everything that decides the numbers of an epoch: all but how many epochs there are.

        Fields that were added later, or whose group was, are left out where they have their default: a checkpoint
        outlives a new field.
        """
        defaults = flatten(_defaults())
        deciding = {
            name: value
            for name, value in flatten(self.decisive()).items()
            if name != "epochs"
            and (value != defaults.get(name) or {name, name.partition(".")[0]}.isdisjoint(ADDED_LATER))
        }
        return hashlib.sha256(json.dumps(deciding, sort_keys=True).encode()).hexdigest()


@cache
def _defaults() -> Mapping[str, Any]:
    """Plain options of the default config, made once: a table asks for them several times a run. Not to be changed."""
    return RunConfig().to_json()


def with_later_fields(options: Mapping[str, Any]) -> dict[str, Any]:
    """Plain options of a run, with the fields that it lacks because it is older than they are."""
    defaults, filled = _defaults(), dict(options)
    for name in ADDED_LATER:
        group, _, field_name = name.rpartition(".")
        if not group:
            filled.setdefault(name, defaults[name])
        elif isinstance(filled.get(group), dict):
            filled[group] = {field_name: defaults[group][field_name]} | filled[group]
    return filled


def differences(old: RunConfig, new: RunConfig) -> list[str]:
    """Fields that affect numbers and differ, as "epochs is 50 there, 60 was requested"; empty if there are none.

    Settings of two different methods have nothing in common and are not compared.
    """
    before, after = (flatten(config.decisive()) for config in (old, new))
    alike = type(old.method_config) is type(new.method_config)
    return [
        f"{name} is {value!r} there, {after[name]!r} was requested"
        for name, value in before.items()
        if (alike or not name.startswith("method_config")) and value != after[name]
    ]
