"""Checks of settings, and a setting that several methods have."""

import math
from typing import Any, Literal, get_args

Sees = Literal["full", "positions", "blocks"]
"""Part of the state that a curiosity method gets: all, the positions of hand and blocks, or those of the blocks."""


def check_positive(config: Any, *names: str) -> None:
    """Raise ValueError, with name and value, unless these fields of a config are finite and above 0."""
    for name in names:
        if not 0 < getattr(config, name) < math.inf:
            raise ValueError(f"{name} is {getattr(config, name)}; it must be positive and finite")


def check_at_least(config: Any, least: int, *names: str) -> None:
    """Raise ValueError, with name and value, where one of these fields of a config is below `least`; None is legal."""
    for name in names:
        if (value := getattr(config, name)) is not None and value < least:
            raise ValueError(f"{name} is {value}; it must be at least {least}")


def check_share(config: Any, *names: str) -> None:
    """Raise ValueError, with name and value, unless these fields of a config lie in [0, 1]."""
    for name in names:
        if not 0 <= getattr(config, name) <= 1:
            raise ValueError(f"{name} is {getattr(config, name)}; it must lie in [0, 1]")


def check_option(config: Any, name: str, options: Any) -> None:
    """Raise ValueError, with the value and the options, unless a field of a config is an option of the Literal."""
    if getattr(config, name) not in get_args(options):
        legal = ", ".join(map(repr, get_args(options)))
        raise ValueError(f"{name} is {getattr(config, name)!r}; it must be one of {legal}")
