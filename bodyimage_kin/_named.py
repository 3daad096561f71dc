"""What users name in text, ``"package.module:Class"``: found, and checked before anything is built of it."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bodyimage_kin.errors import InvalidConfig


def named_class(kind: str, place: str, methods: Sequence[str], folder: Path | None = None) -> type[Any]:
    """The class at a place, imported but not built.

    Args:
        kind: What it is to be, for an error: ``"backend"``.
        place: ``"package.module:Class"``.
        methods: What makes it such a thing: the names of methods, one of which it must have.
        folder: As of :func:`named_object`.

    Raises:
        InvalidConfig: As :func:`named_object`, or what is there is no class of that kind.
    """
    found = named_object(kind, place, folder)
    fits = isinstance(found, type) and any(callable(getattr(found, method, None)) for method in methods)
    if not fits:
        said = "" if isinstance(found, type) else f" (it is no class but a {type(found).__name__})"
        raise InvalidConfig(f"{kind} {place!r} has no method {' or '.join(methods)}{said}; name a class that has")
    return found


def named_object(kind: str, place: str, folder: Path | None = None) -> Any:
    """What stands at a place; its module is imported.

    The module is looked for in what is installed, then in ``folder``, then in the current folder; the folder that has
    it is searched last by every import after that. No other file of a folder is imported.

    Args:
        kind: What it is to be, for an error: ``"score"``.
        place: ``"package.module:NAME"``.
        folder: Where the file lies that names it.

    Raises:
        InvalidConfig: There is no such module, importing it fails, or it has nothing of that name.
    """
    module, _, attribute = place.partition(":")
    if not all(part.isidentifier() for part in (*module.split("."), *attribute.split("."))):
        raise InvalidConfig(f"cannot load {kind} {place!r}: this names no class; give 'package.module:Class'")
    root = module.partition(".")[0]
    folders = [Path.cwd()] if folder is None else [folder.absolute(), Path.cwd()]
    if module not in sys.modules:
        _find(root, folders)
    try:
        found: Any = importlib.import_module(module)
    except ModuleNotFoundError as problem:
        if problem.name is None or not f"{module}.".startswith(f"{problem.name}."):
            raise InvalidConfig(f"cannot load {kind} {place!r}: importing {module} fails: {problem}") from problem
        places = " or ".join(f"'{one}'" for one in dict.fromkeys(folders))
        raise InvalidConfig(
            f"cannot load {kind} {place!r}: {problem}; put {root}.py into {places}, or install it (pip install -e .)"
        ) from None
    except Exception as problem:
        said = f"{type(problem).__name__}: {' '.join(str(problem).split())}"
        raise InvalidConfig(f"cannot load {kind} {place!r}: importing {module} fails: {said}") from problem
    for part in attribute.split("."):
        if not hasattr(found, part):
            raise InvalidConfig(f"cannot load {kind} {place!r}: '{module}' has no '{attribute}'; name a class in it")
        found = getattr(found, part)
    return found


def _find(root: str, folders: Sequence[Path]) -> None:
    """Lets imports search the first of some folders that has a module, unless it is found already."""
    importlib.invalidate_caches()
    if root in sys.modules or importlib.util.find_spec(root) is not None:
        return
    for folder in folders:
        if (folder / f"{root}.py").is_file() or (folder / root).is_dir():
            sys.path.append(str(folder))
            return
