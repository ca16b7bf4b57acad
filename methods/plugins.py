"""Methods that are not built in, by `package.module:Class` or by the entry point of an installed package.

A package registers its classes in the entry-point group `curiobench.methods`, in its pyproject.toml:

    [project.entry-points."curiobench.methods"]
    mine = "my_pkg.curiosity:Mine"

A plug-in is only imported when a spec names it. Any error in a plug-in becomes one ValueError that names spec and file.
"""

import hashlib
import importlib
import inspect
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import ModuleType, NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from curiobench.methods.curriculum import Curriculum
from curiobench.methods.relabelling import Relabelling
from curiobench.methods.reward import IntrinsicReward
from curiobench.methods.specs import installed_methods

Method = IntrinsicReward | Curriculum | Relabelling
"""Kinds of methods."""

PLAIN = (bool, int, float, str, NoneType)
"""Types of settings that JSON can store, alone or in a union. A Literal of strings is also allowed."""


def load_installed(name: str) -> type[Method]:
    """The class behind an entry point. Raises ValueError like `load_class`, and if two packages use that name."""
    values = installed_methods()[name]
    if len(values) > 1:
        raise ValueError(
            f"method {name!r}: several installed packages provide it: {', '.join(values)}; name one of these"
        )
    return load_class(values[0], f"{name} ({values[0]})")


def load_class(path: str, spec: str) -> type[Method]:
    """Import a method.

    If the current directory is not on sys.path, it is appended at the end, so that a file there cannot replace an
    installed package. The console script `curiobench` does not have it there; `python -m curiobench` has it first.

    Args:
        path: `package.module:Class`.
        spec: its name in messages.

    Raises:
        ValueError: no such module or class, an import that raises, or a class that is not a method. The message is one
            line.
    """
    module_name, _, class_name = path.partition(":")
    if not all(part.isidentifier() for part in [*module_name.split("."), class_name]):
        raise ValueError(f"method {spec!r}: expected package.module:Class")
    if not {"", os.getcwd()} & {*sys.path}:
        sys.path.append(os.getcwd())
    module = _import(module_name, spec)
    where = f"method {spec!r} in {getattr(module, '__file__', None) or module_name}"
    try:
        found = getattr(module, class_name, None)
    except (Exception, SystemExit) as error:  # a module can define __getattr__
        raise ValueError(f"{where}: looking for {class_name} raised {error_line(error)}") from error
    if found is None:
        methods = [name for name, value in vars(module).items() if _is_method(value)]
        raise ValueError(f"{where}: there is no class {class_name!r}; its methods are {', '.join(methods) or 'none'}")
    if not _is_method(found):
        kinds = " or ".join(f"{kind.__module__}.{kind.__name__}" for kind in get_args(Method))
        raise ValueError(f"{where}: {class_name} is not a class derived from {kinds}")
    if missing := sorted(found.__abstractmethods__):
        raise ValueError(f"{where}: {class_name} lacks {', '.join(missing)}")
    _check_config(found, where)
    return found


def _import(name: str, spec: str) -> ModuleType:
    importlib.invalidate_caches()  # the file may be newer than the import caches
    try:
        return importlib.import_module(name)
    except (Exception, SystemExit) as error:
        if isinstance(error, ModuleNotFoundError) and error.name and f"{name}.".startswith(f"{error.name}."):
            advice = f"; leave out the .py of a file's name: {name[:-3]}" if name.endswith(".py") else ""
            raise ValueError(
                f"method {spec!r}: there is no module {name!r}, neither installed nor in {os.getcwd()}{advice}"
            ) from None
        raise ValueError(f"method {spec!r}: {_culprit(error)}: importing {name} raised {error_line(error)}") from error


def _culprit(error: BaseException) -> str:
    """File and line at which an import failed."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.filename}, line {error.lineno}"
    frames = traceback.extract_tb(error.__traceback__)
    outside = [f for f in frames if not f.filename.startswith("<frozen importlib") and f.filename != __file__]
    return next((f"{f.filename}, line {f.lineno}" for f in outside if f.filename != importlib.__file__), "unknown file")


def error_line(error: BaseException) -> str:
    """Type and first line of an error."""
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__


def _is_method(value: Any) -> bool:
    return inspect.isclass(value) and issubclass(value, Method) and value not in get_args(Method)


def _check_config(method: type[Method], where: str) -> None:
    """Raise ValueError unless `Config` can be turned into flags, stored as JSON and created without arguments."""
    where = f"{where}: {method.__name__}.Config"
    config = getattr(method, "Config", None)
    frozen = getattr(getattr(config, "__dataclass_params__", None), "frozen", False)
    if not (inspect.isclass(config) and is_dataclass(config) and frozen):
        raise ValueError(f"{where} is {config!r}; expected a dataclass with frozen=True")
    try:
        config()
        hints = get_type_hints(config)
    except Exception as error:
        raise ValueError(f"{where} cannot be made from its defaults: {error_line(error)}") from error
    for field in fields(config):
        if not _is_plain(hints[field.name]):
            raise ValueError(
                f"{where}.{field.name} is a {hints[field.name]}; settings are bool, int, float, str, "
                "None, alternatives of them, or a Literal of strings"
            )


def _is_plain(hint: Any) -> bool:
    if get_origin(hint) is Literal:
        return all(isinstance(option, str) for option in get_args(hint))
    return get_origin(hint) in (None, Union, UnionType) and all(t in PLAIN for t in get_args(hint) or (hint,))


@contextmanager
def building(method: type[Method], spec: str) -> Iterator[None]:
    """Turn any exception of a method's constructor into a ValueError that names spec and file."""
    try:
        yield
    except Exception as error:
        raise ValueError(f"method {spec!r} in {file_of(method)}: building it raised {error_line(error)}") from error


def file_of(method: type[Method]) -> str:
    """Path of the file that defines a method's class; the module's name if there is none, as in a REPL session."""
    return getattr(sys.modules.get(method.__module__), "__file__", None) or method.__module__


def trace(method: type[Method]) -> dict[str, str]:
    """Source of a method that is not built in, for the record of a run: `method_file` and `method_sha256`.

    The digest covers the file of the class, but not the files that it imports.
    """
    path = file_of(method)
    digest = hashlib.sha256(Path(path).read_bytes()).hexdigest() if Path(path).is_file() else ""
    return {"method_file": path, "method_sha256": digest}
