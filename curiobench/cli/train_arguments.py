"""Arguments of `curiobench train`: every field of `RunConfig` is a flag, and a preset gives their defaults."""

from collections.abc import Sequence
from dataclasses import dataclass, make_dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import tyro

from curiobench.cli.parsing import parse_arguments
from curiobench.config import RunConfig
from curiobench.methods.specs import canonical
from curiobench.presets import preset
from curiobench.run_folder import read_config


@dataclass(frozen=True)
class TrainArguments:
    """Train one run and leave everything about it in a folder.

    Every number of the run is decided by the options below; config.json in the folder keeps them. The run may be
    stopped or killed at any time: with --resume it continues from its last checkpoint and ends as if nothing had
    happened.
    """

    out: Path
    """Run folder."""
    config: Annotated[RunConfig, tyro.conf.arg(name="")]
    resume: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Continue the run in this folder with its own config, or start one if the folder has none. A larger --epochs
    lengthens the run."""


def parse_train(arguments: Sequence[str]) -> TrainArguments:
    """Arguments of a training run.

    Defaults are those of the preset that `--preset` names, for the task that `--task` names, or of the folder's own
    config where `--resume` finds one. `--method` decides which settings `--method.…` there are.

    Raises:
        ValueError: an unknown preset or task, an illegal value, or arguments that are not understood; one line.
        SystemExit: on `--help`, after showing it.
    """
    out = _last_value(arguments, "--out")
    if "--resume" in arguments and out and (Path(out) / "config.json").exists():
        defaults = read_config(Path(out), {_last_value(arguments, "--method")})
    else:
        name, task = _last_value(arguments, "--preset"), _last_value(arguments, "--task")
        defaults = preset(name or RunConfig.preset, task or RunConfig.task)
    method = canonical(_last_value(arguments, "--method") or defaults.method)
    if method != defaults.method:
        defaults = replace(defaults, method=method, method_config=None)
    if defaults.method_config is None:
        return parse_arguments(TrainArguments, "train", arguments, TrainArguments(out=tyro.MISSING, config=defaults))
    kind = _with_settings(type(defaults.method_config))
    parsed = parse_arguments(
        kind, "train", arguments, kind(out=tyro.MISSING, config=defaults, settings=defaults.method_config)
    )
    return replace(parsed, config=replace(parsed.config, method_config=parsed.settings))


def flags_of(name: str, value: str | int | float | bool | None) -> list[str]:
    """An option as the command line has it; a flag that is false has `no-` before its last part."""
    if isinstance(value, bool):
        path, dot, last = name.rpartition(".")
        return [f"--{path}{dot}{'' if value else 'no-'}{last}"]
    text = str(value)
    return [f"--{name}={text}"] if text.startswith("-") else [f"--{name}", text]


def _with_settings(settings: type) -> type[TrainArguments]:
    """`TrainArguments` with the fields of a curiosity method's `Config` as flags, `--method.k` for its field `k`."""
    flags = Annotated[settings, tyro.conf.arg(name="method", help="The curiosity method.")]
    kind = make_dataclass("TrainArguments", [("settings", flags, None)], bases=(TrainArguments,), frozen=True)
    kind.__doc__ = TrainArguments.__doc__
    return kind


def _last_value(arguments: Sequence[str], flag: str) -> str | None:
    """What follows a flag, as `--flag value` or `--flag=value`, where it stands last."""
    found = None
    for argument, following in pairwise([*arguments, None]):
        if argument == flag:
            found = following
        elif argument.startswith(f"{flag}="):
            found = argument.removeprefix(f"{flag}=")
    return found
