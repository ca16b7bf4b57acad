"""The definition of a grid, from flags and a YAML file."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import yaml

from curiobench.cli.arguments import GridArguments
from curiobench.config import LARGEST_SEED, RunConfig
from curiobench.files import read_content
from curiobench.tasks.registration import check_name

Scalar = str | int | float | bool | None
Options = Mapping[str, Scalar]
"""Options of `curiobench train` by name, without the leading hyphens."""

MOST_SEEDS = 1_000
"""Seeds of one grid that are asked for by their number."""
_VARIANT = re.compile(r"[A-Za-z0-9][A-Za-z0-9._=+-]{0,99}")
"""Part of a folder's name, so nothing that leads elsewhere."""


@dataclass(frozen=True)
class Grid:
    """A grid: a cell for every task, method, seed and variant."""

    tasks: Sequence[str] = ()
    """Names of tasks."""
    methods: Sequence[str] = ()
    """Method specs."""
    seeds: Sequence[int] = (0, 1, 2)
    """Seeds."""
    preset: str = RunConfig.preset
    """Preset of all cells."""
    robot: str = RunConfig.robot
    """Robot of all cells."""
    options: Options = field(default_factory=dict)
    """Options of all cells."""
    variants: Mapping[str, Options] = field(default_factory=lambda: {"": {}})
    """Options of some cells, by the variant's name, which becomes part of the folders' names."""

    def __post_init__(self) -> None:
        for name in ("tasks", "methods", "seeds"):
            values = getattr(self, name)
            if not values:
                raise ValueError(f"the grid has no {name}: name some by --{name}, or by {name} in the file")
            if doubled := _repeated(values):
                raise ValueError(f"{name}: {doubled[0]} is given more than once")
        for seed in (min(self.seeds), max(self.seeds)):
            if not 0 <= seed <= LARGEST_SEED:
                raise ValueError(f"seeds has {seed}; a seed must be from 0 to {LARGEST_SEED}")


def _repeated(values: Sequence[Any]) -> list[Any]:
    """Values that occur earlier in the sequence."""
    return [value for i, value in enumerate(values) if value in values[:i]]


def define(arguments: GridArguments) -> Grid:
    """The grid of a command line: its file, overridden by its flags. Raises ValueError, one line."""
    values = {} if arguments.file is None else read_definition(arguments.file)
    for name in ("tasks", "methods"):
        if (text := getattr(arguments, name)) is not None:
            values[name] = _split(text)
    if arguments.seeds is not None:
        values["seeds"] = _seeds(_split(arguments.seeds) if "," in arguments.seeds else arguments.seeds, "seeds")
    values |= {name: text for name in ("preset", "robot") if (text := getattr(arguments, name)) is not None}
    if arguments.options is not None:
        values["options"] = values.get("options", {}) | _options_of_text(arguments.options)
    return Grid(**values)


def read_definition(path: Path) -> dict[str, Any]:
    """Arguments of `Grid` from a YAML file.

    Raises ValueError, one line that names the file: it cannot be read, or holds unknown or doubled keys or values of
    another type.
    """
    content = read_content(path)
    try:
        values = yaml.load(content, Loader=_Loader)  # derived from SafeLoader
    except yaml.MarkedYAMLError as error:
        where = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise ValueError(f"{path}{where}: {error.problem}") from None
    except (yaml.YAMLError, ValueError, RecursionError, LookupError, AttributeError, OverflowError) as error:
        raise ValueError(f"cannot read {path}: {' '.join(str(error).split())}") from None
    try:
        found = _mapping(values, "the file")
        return {name: _READERS[check_name("key", name, (*_READERS,))](value, name) for name, value in found.items()}
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


class _Loader(yaml.SafeLoader):
    """Text, true, false and null, lists and mappings; and no key twice: YAML would silently take the last one.

    Numbers stay text, which is read as on the command line: for YAML 1e-3 is text, 012 is ten and 1:30 is ninety.
    """

    yaml_implicit_resolvers: ClassVar = {
        first: [(tag, pattern) for tag, pattern in resolvers if tag.rpartition(":")[2] in ("bool", "null")]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        names = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        if "<<" in names:  # a few lines of nested ones take hours
            raise yaml.constructor.ConstructorError(None, None, "merge keys (<<) are not allowed", node.start_mark)
        if doubled := _repeated(names):
            raise yaml.constructor.ConstructorError(
                None, None, f"the key {doubled[0]!r} is given more than once", node.start_mark
            )
        return super().construct_mapping(node, deep)


def _names(value: Any, where: str) -> list[str]:
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise ValueError(f"{where} is {_kind(value)}; expected a list of names such as [a, b]")
    return value


def _seeds(value: Any, where: str) -> list[int]:
    seeds = []
    for seed in value if isinstance(value, list) else [value]:
        try:
            seeds.append(int(str(seed)))
        except ValueError:
            raise ValueError(f"{where} is {_kind(seed)}; expected a number of seeds, or seeds such as [4, 7]") from None
    return seeds if isinstance(value, list) else _first_seeds(seeds[0])


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{where} is {_kind(value)}; expected a name")
    return value


def _options(value: Any, where: str) -> dict[str, Scalar]:
    return _options_of_pairs(_mapping({} if value is None else value, where).items(), where)


def _options_of_pairs(pairs: Iterable[tuple[str, Any]], where: str) -> dict[str, Scalar]:
    found: dict[str, Scalar] = {}
    for name, option in pairs:
        if not isinstance(option, Scalar):
            raise ValueError(f"{where}: {name} is {_kind(option)}; expected a number, text, true, false or null")
        canonical = name.replace("_", "-")
        if canonical in found:
            raise ValueError(f"{where}: the option {canonical!r} is given more than once")
        found[canonical] = option
    return found


def _variants(value: Any, where: str) -> dict[str, dict[str, Scalar]]:
    variants = {name: _options(options, f"variant {name}") for name, options in _mapping(value, where).items()}
    for name in variants:
        if not _VARIANT.fullmatch(name):
            legal = "letters, digits and . _ = + - (at most 100), and start with a letter or digit"
            raise ValueError(f"variant {name!r}: names use {legal}")
    if not variants:
        raise ValueError(f"{where} is empty")
    return variants


_READERS = {
    "tasks": _names,
    "methods": _names,
    "seeds": _seeds,
    "preset": _text,
    "robot": _text,
    "options": _options,
    "variants": _variants,
}


def _mapping(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{where} is {_kind(value)}; expected keys with values")
    for key in value:
        if not isinstance(key, str):
            raise ValueError(f"{where}: the key {key!r} is {_kind(key)}; put it in quotes")
    return value


def _kind(value: Any) -> str:
    """A value for an error message; the content of lists and mappings is left out."""
    if isinstance(value, list):
        return "a list"
    if isinstance(value, dict):
        return "a mapping"
    return "empty" if value is None else repr(value)[:80]


def _split(text: str) -> list[str]:
    return [part for part in (part.strip() for part in text.split(",")) if part]


def _first_seeds(number: int) -> list[int]:
    if number > MOST_SEEDS:
        one = f"for the one seed {number} write --seeds {number}, (with a comma), or [{number}] in a file"
        raise ValueError(f"seeds {number} means {number} seeds, at most {MOST_SEEDS}; {one}")
    return list(range(number))


def _options_of_text(text: str) -> dict[str, Scalar]:
    words, pairs = {"true": True, "false": False}, []
    for part in _split(text):
        name, sign, value = map(str.strip, part.partition("="))
        if not sign:
            raise ValueError(f"options: {name!r} has no value; expected pairs such as epochs=12,sac.gamma=0.9")
        pairs.append((name, words.get(value.lower(), value)))
    return _options_of_pairs(pairs, "options")
