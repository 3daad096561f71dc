"""What the arguments of commands are called in their help, and how they are read."""

from __future__ import annotations

import abc
import contextlib
import json
import math
import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeAlias

from tyro.conf import arg

from bodyimage_kin.errors import InvalidConfig, OutputRefused, UnknownName

__all__ = [
    "Command",
    "File",
    "Flag",
    "Folder",
    "MaybeCount",
    "MaybeEmbodiment",
    "MaybeFile",
    "MaybeFolder",
    "MaybeName",
    "MaybeNumber",
    "Names",
    "Seed",
    "finite",
    "free",
    "pairs",
    "print_json",
    "read_toml",
    "setting",
]


class Command(abc.ABC):
    """What a command is: a frozen dataclass of its arguments, called once. ``EXAMPLES`` end its help."""

    EXAMPLES: ClassVar[tuple[str, ...]]

    @abc.abstractmethod
    def __call__(self) -> int:
        """Does it, and gives the exit status."""


# A hint of a default that is none would say "(default: None)".
File: TypeAlias = Annotated[Path, arg(metavar="FILE")]
Folder: TypeAlias = Annotated[Path, arg(metavar="DIR")]
Flag: TypeAlias = Annotated[bool, arg(help_behavior_hint="")]
Seed: TypeAlias = Annotated[int, arg(metavar="N")]
Names: TypeAlias = Annotated[tuple[str, ...], arg(metavar="NAME ...", help_behavior_hint="")]
MaybeFile: TypeAlias = Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")]
MaybeFolder: TypeAlias = Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")]
MaybeCount: TypeAlias = Annotated[int | None, arg(metavar="N", help_behavior_hint="")]
MaybeNumber: TypeAlias = Annotated[float | None, arg(metavar="X", help_behavior_hint="")]
MaybeName: TypeAlias = Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")]
MaybeEmbodiment: TypeAlias = Annotated[str | None, arg(metavar="NAME|TOML", help_behavior_hint="")]


def pairs(option: str, given: Sequence[str]) -> dict[str, str]:
    """``NAME=VALUE``, several times, as a table.

    Args:
        option: Its name, in an error.
        given: Texts.

    Raises:
        InvalidConfig: A text without ``=``, or a name given twice.
    """
    found: dict[str, str] = {}
    for text in given:
        name, is_there, value = text.partition("=")
        if not (name and is_there and value):
            raise InvalidConfig(f"{option} {text!r}: give NAME=VALUE")
        if name in found:
            raise InvalidConfig(f"{option} {text!r}: '{name}' is given twice")
        found[name] = value
    return found


def setting(text: str) -> Any:
    """A value: a number, what else TOML has (true or false, a list), or a text."""
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text)
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def read_toml(path: Path, known: Sequence[str]) -> dict[str, Any]:
    """The table of a TOML file.

    Args:
        path: The file.
        known: The names that it may have.

    Raises:
        InvalidConfig: A file that cannot be read, or a name that means nothing.
    """
    try:
        found = tomllib.loads(path.read_bytes().decode())
    except OSError as problem:
        raise InvalidConfig(f"cannot read '{path}': {problem.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as problem:
        raise InvalidConfig(f"'{path.name}' is no valid TOML: {problem}") from None
    for name in found:
        if name not in known:
            raise InvalidConfig(str(UnknownName(f"field in {path.name}", name, known)))
    return found


def free(path: Path, overwrite: bool) -> Path:
    """A file's place, once it is known that nothing is lost there.

    Raises:
        OutputRefused: There is one, and nobody said that it may go; or its folder is missing.
    """
    if path.exists() and not (overwrite and path.is_file()):
        raise OutputRefused(f"'{path}' is there already; name another file, or give --overwrite")
    if not path.parent.is_dir():
        raise OutputRefused(f"there is no folder '{path.parent}'; make it, or name another")
    return path


def finite(value: float) -> float | None:
    """A number as JSON has it: none where there is none."""
    return float(value) if math.isfinite(value) else None


def print_json(values: Mapping[str, Any]) -> None:
    """One JSON document on standard output."""
    json.dump(values, sys.stdout, indent=2, allow_nan=False)
    print()
