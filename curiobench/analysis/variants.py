"""What sets runs apart that share a method: the options in which they differ."""

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from curiobench.config import flatten

_APART = ("task", "method", "seed")
"""Options with a column of their own."""
_SETTINGS = "method_config."
"""Before the names of a method's own settings."""


def variants(options: Sequence[Mapping[str, Any]]) -> list[str]:
    """The options in which a run differs from others of its task and method, as "sac.tau=0.1, sac.gamma=0.9".

    Where such runs are of several presets, the preset is named, and further options only where they differ within it.

    Args:
        options: of each run, nested as in config.json, the machine's left out.

    Returns:
        A text a run; "" where the others have the same options.
    """
    flat = [flatten(run) for run in options]
    found = [""] * len(flat)
    for members in _groups(flat, "task", "method"):
        differing = _differing([flat[i] for i in members])
        named = ["preset"] if "preset" in differing and len(differing) > 1 else []  # the name alone sets no run apart
        for alike in _groups([flat[i] for i in members], "preset"):
            within = [members[i] for i in alike]
            names = named + [name for name in _differing([flat[i] for i in within]) if name != "preset"]
            for i in within:
                found[i] = ", ".join(f"{_flag(name)}={_word(flat[i][name])}" for name in names if name in flat[i])
    return found


def unlike_options(options: Sequence[Mapping[str, Any]], named: Sequence[str]) -> list[str]:
    """Options in which runs of one task differ although every method has them, such as the number of epochs.

    Methods' own settings are left out: two that share a name, such as a `beta`, have nothing in common. So is what a
    run's variant tells. Runs of several presets are compared within each, if variants tell the preset.

    Args:
        options: as of `variants`.
        named: the variant of each run.

    Returns:
        One line a task whose methods are compared on unequal terms.
    """
    lines = []
    flat = [flatten(run) for run in options]
    apart = ("preset",) if any(_tells(text, "preset") for text in named) else ()
    for members in _groups(flat, "task", *apart):
        runs = [flat[i] for i in members]
        common = [name for name in _differing(runs) if all(name in run for run in runs) and not _is_own(name)]
        untold = {name: {_word(flat[i][name]) for i in members if not _tells(named[i], name)} for name in common}
        if values := {name: sorted(words) for name, words in untold.items() if len(words) > 1}:
            told = ", ".join(f"{_flag(name)} ({' or '.join(words)})" for name, words in values.items())
            lines.append(f"runs of {runs[0]['task']} differ in {told}")
    return lines


def _tells(variant: str, name: str) -> bool:
    """Whether a variant's text gives the value of an option."""
    return any(part.startswith(f"{_flag(name)}=") for part in variant.split(", "))


def _is_own(name: str) -> bool:
    return name in _APART or name.startswith(_SETTINGS)


def _groups(runs: Sequence[Mapping[str, Any]], *names: str) -> list[list[int]]:
    """Positions of the runs that share these options."""
    groups = defaultdict(list)
    for i, run in enumerate(runs):
        groups[tuple(run[name] for name in names)].append(i)
    return list(groups.values())


def _differing(runs: Sequence[Mapping[str, Any]]) -> list[str]:
    names = dict.fromkeys(name for run in runs for name in run)
    unset = object()
    return [
        name
        for name in names
        if name not in _APART and len({json.dumps(run[name]) if name in run else unset for run in runs}) > 1
    ]


def _flag(name: str) -> str:
    """Name of an option on the command line, with underscores."""
    return name.replace(_SETTINGS, "method.")


def _word(value: Any) -> str:
    text = value[:8] if isinstance(value, str) and len(value) == 64 else str(value)  # a digest is told by its head
    return "".join(character if character.isprintable() else " " for character in text[:60])
