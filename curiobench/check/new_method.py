"""`curiobench new-method`: a file with a working curiosity method, to be altered."""

import inspect
import keyword
from importlib.util import find_spec
from pathlib import Path

from curiobench.check import template
from curiobench.methods.guard import TAKEN


def write_method(name: str, folder: Path) -> tuple[Path, str]:
    """Write `folder/name.py` from the template.

    Args:
        name: of the module, an identifier; its class has the same name in CamelCase.
        folder: created if it does not exist.

    Returns:
        The file, and the method spec by which `curiobench` finds it from within `folder`.

    Raises ValueError where the name is not possible, or the file exists or cannot be written.
    """
    class_name = "".join(part[:1].upper() + part[1:] for part in name.split("_"))
    _check_name(name, class_name)
    path = folder / f"{name}.py"
    text = inspect.getsource(template).replace("NewMethod", class_name).replace("new_method", name)
    try:
        if not path.exists() and (found := find_spec(name)) and found.origin:  # not a mere folder of that name
            raise ValueError(
                f"{name}:{class_name} would import another module that is called {name!r}; choose another name"
            )
        folder.mkdir(parents=True, exist_ok=True)
        with open(path, "x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        if not folder.is_dir():
            raise ValueError(f"cannot write {path}: {folder} is not a folder") from None
        raise ValueError(f"{path} already exists and was not changed; choose another name") from None
    except OSError as error:
        raise ValueError(f"cannot write {path}: {error.strerror}") from None
    return path, f"{name}:{class_name}"


def _check_name(name: str, class_name: str) -> None:
    for word in (name, class_name):
        if not (word.isidentifier() and word.isascii()) or keyword.iskeyword(word):
            raise ValueError(f"{name!r} cannot name a method: expected letters, digits and _, such as my_method")
    if f"{name}_loss" in TAKEN:
        raise ValueError(f"{name!r} cannot name a method: {name}_loss is a metric of the agent's own")
