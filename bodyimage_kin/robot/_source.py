"""Where a URDF comes from: a path, an open file, or the text itself."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from bodyimage_kin.errors import InvalidURDF
from bodyimage_kin.robot import _text
from bodyimage_kin.robot._wording import quote
from bodyimage_kin.robot._xml import MAX_BYTES

_REMEDY: Final = "give a path, or text beginning with '<'"
_LONGEST_PATH: Final = 4096
_SHOWN: Final = 300
"""Characters of a path that an error shows."""


def read(source: object) -> tuple[bytes, Path | None]:
    """The bytes of a URDF, and the file they came from if they did.

    Raises:
        InvalidURDF: Nothing that can be read.
    """
    if isinstance(source, str):
        # What a byte order mark leaves behind in text that was read as UTF-8.
        if source.lstrip(f"{_text.SPACE}\ufeff").startswith("<"):
            return _text.encode(source), None
        return _from_path(source)
    if isinstance(source, bytes | bytearray | memoryview):
        data = bytes(source)
        return (data, None) if _text.is_xml(data) else _from_path(_as_path(data))
    if isinstance(source, os.PathLike):
        return _from_path(os.fspath(source))
    if callable(getattr(source, "read", None)):
        return _from_file(source)
    raise InvalidURDF(f"a robot cannot be read from {type(source).__name__}", remedy=_REMEDY)


def _from_path(name: str | bytes) -> tuple[bytes, Path]:
    text = name if isinstance(name, str) else os.fsdecode(name)
    if not text.strip():
        raise InvalidURDF("the text is empty", remedy=_REMEDY)
    # What is no path may be a whole file that begins with something else than an element.
    if len(text) > _LONGEST_PATH or any(character in text for character in "\n\r\0<"):
        raise InvalidURDF("neither XML nor a path", remedy=_REMEDY)
    try:
        path = Path(text)
        with path.open("rb") as file:
            return file.read(MAX_BYTES + 1), path
    except (OSError, ValueError) as problem:
        reason = problem.strerror if isinstance(problem, OSError) else str(problem)
        # Of a path the last part says most.
        name = repr(text) if len(text) <= _SHOWN else quote(text)
        raise InvalidURDF(f"cannot read {name}: {reason}", remedy=_REMEDY) from None


def _as_path(data: bytes) -> str:
    return os.fsdecode(data[: _LONGEST_PATH + 1])


def _from_file(file: object) -> tuple[bytes, Path | None]:
    try:
        content = file.read(MAX_BYTES + 1)  # type: ignore[attr-defined]
    except (OSError, ValueError, TypeError) as problem:
        raise InvalidURDF(f"cannot read the open file: {problem}", remedy=_REMEDY) from None
    if not isinstance(content, str | bytes | bytearray):
        raise InvalidURDF(f"the open file gives {type(content).__name__}, not text", remedy=_REMEDY)
    name = getattr(file, "name", None)
    path = Path(name) if isinstance(name, str) and Path(name).is_file() else None
    return _text.encode(content) if isinstance(content, str) else bytes(content), path
