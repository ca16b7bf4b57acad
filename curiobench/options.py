"""Options of a run as plain values, as JSON holds them: flattened, compared, and built into dataclasses.

Configs of older runs lack the fields that were added since. Each such field's default is what those runs were.
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Literal, get_args, get_origin, get_type_hints

ADDED_LATER = (
    "hybrid", "method_config", "machine.keep_replay", "starts", "curriculum", "replay.relabelling",
    "replay.arrival_share", "sac.network", "sac.features", "sac.detail_scale", "sac.actor_every",
    "sac.decay_updates", "replay.pursued_share", "sac.reward_window", "sac.entropy_in_targets",
    "schedule_epochs", "hybrid.adaptive_tau", "hybrid.spread_ratio", "hybrid.tau_rate",
)  # fmt: skip
"""Fields that configs of older runs lack, by dotted name."""


def flatten(options: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """Nested options by dotted name."""
    flat = {}
    for name, value in options.items():
        flat |= flatten(value, f"{path}{name}.") if isinstance(value, dict) else {path + name: value}
    return flat


def with_track(values: Any) -> Any:
    """Plain options of a run, with `machine.track` where an older one says whether it logged for TensorBoard."""
    machine = values.get("machine") if isinstance(values, dict) else None
    if not isinstance(machine, dict) or not isinstance(machine.get("tensorboard"), bool):
        return values
    kept = {name: value for name, value in machine.items() if name != "tensorboard"}
    return values | {"machine": {"track": "tensorboard" if machine["tensorboard"] else None} | kept}


def build_dataclass(cls: type, values: Any, path: str = "") -> Any:
    """An instance of a dataclass from plain values that name each of its fields once.

    Args:
        cls: the dataclass; its fields may be dataclasses.
        values: by field name. Fields of `ADDED_LATER` may be missing.
        path: dotted name of the group in the config, with a dot at its end.

    Raises ValueError on an unknown or missing field, or a value of another type; one line that names the field.
    """
    if not isinstance(values, dict):
        raise ValueError(f"config {path.rstrip('.') or 'file'} is {values!r}; expected an object with named fields")
    names = {f.name for f in fields(cls)}
    needed = {name for name in names if path + name not in ADDED_LATER}
    for found, kind in ((values.keys() - names, "unknown"), (needed - values.keys(), "missing")):
        if found:
            raise ValueError(f"{kind} config field {path}{min(found)}")
    hints = get_type_hints(cls)
    return cls(**{name: _value(hints[name], value, path + name) for name, value in values.items()})


def _value(hint: Any, value: Any, name: str) -> Any:
    """A value checked against the type hint of its field."""
    if is_dataclass(hint):
        return build_dataclass(hint, value, f"{name}.")
    options = get_args(hint) or (hint,)
    if get_origin(hint) is Literal:
        legal = isinstance(value, str) and value in options
    else:
        legal = type(value) in options or (float in options and type(value) is int)
    if not legal:
        names = " or ".join(o.__name__ if isinstance(o, type) else repr(o) for o in options)
        raise ValueError(f"config field {name} is {value!r}; expected {names}")
    return value
