"""Files appear whole or not at all."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bodyimage_kin.errors import OutputRefused


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary name beside ``path`` to write to; renamed when the block succeeds, removed when it does not."""
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Writes a text file atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any, indent: int = 1) -> None:
    """Writes what JSON can say, atomically; a number that is not finite is refused."""
    write_text(path, json.dumps(value, indent=indent, allow_nan=False) + "\n")


def write_bytes(path: Path, data: bytes) -> None:
    """Writes a file atomically, and has it on the disk before it has its name."""
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


# Output folders: made by us, known by a marker, and never anybody else's --------------------------------------------

_MARKER = "bodyimage_kin.json"


def claim(folder: Path, kind: str, settings: Mapping[str, Any]) -> Path:
    """Makes an output folder ours, and says in it what it holds.

    Args:
        folder: Empty, missing, or claimed for the same kind before.
        kind: What the folder is for, e.g. ``"reproduction"``.
        settings: What the run was asked for; kept in the folder.

    Raises:
        OutputRefused: A folder with other things in it, or something that is no folder.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputRefused(f"'{folder}' is not a folder; name another output folder")
    if folder.is_dir() and any(folder.iterdir()) and _kind(folder) != kind:
        raise OutputRefused(
            f"'{folder}' has files in it that are not a {kind} of bodyimage_kin; name a new or an empty output folder"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / _MARKER, json.dumps({"kind": kind, "settings": dict(settings)}, indent=2) + "\n")
    except OSError as problem:
        raise OutputRefused(f"cannot write to '{folder}': {problem.strerror}; name another output folder") from None
    return folder


def _kind(folder: Path) -> str | None:
    try:
        return str(json.loads((folder / _MARKER).read_text(encoding="utf-8"))["kind"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
