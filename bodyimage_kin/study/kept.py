"""What a store keeps, read with nothing heavy imported: what it is for, its cells, and how far its study is."""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, TypeVar

from bodyimage_kin._files import write_bytes
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.study.blocks import Block, blocks
from bodyimage_kin.study.parts import Part, parts_in

__all__ = [
    "KIND",
    "MARKER",
    "RowProgress",
    "SetAside",
    "by_recording",
    "cells_in",
    "opened",
    "rows_of",
    "set_aside",
    "settings",
]

KIND = "study"
MARKER = "bodyimage_kin.json"
_T = TypeVar("_T")


class SetAside(UserWarning):
    """A file of a store is damaged or of something else; what it should hold is computed again."""


@dataclass(frozen=True)
class RowProgress:
    """How far a row is on one recording.

    Attributes:
        embodiment: Name in the study.
        recording: Likewise.
        estimator: Likewise.
        total: Number of its seeds.
        missing: How many of them nobody has worked on.
        failures: What went wrong -> its seeds.
    """

    embodiment: str
    recording: str
    estimator: str
    total: int
    missing: int
    failures: Mapping[str, Sequence[int]]


def settings(folder: Path) -> dict[str, Any] | None:
    """What the study in a folder was asked for; None when there is none."""
    try:
        marker = json.loads((folder / MARKER).read_text(encoding="utf-8"))
        return dict(marker["settings"]) if marker["kind"] == KIND else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


@contextlib.contextmanager
def opened(folder: Path) -> Iterator[dict[str, Any]]:
    """What the study in a folder was asked for, while something is made of it.

    Raises:
        InvalidConfig: A folder without a study, or one of which this version can make nothing.
    """
    origin = settings(folder)
    if origin is None:
        raise InvalidConfig(f"'{folder}' holds no study; run one into it first")
    try:
        yield origin
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as problem:
        said = f"{type(problem).__name__}: {problem}"
        raise InvalidConfig(f"'{folder}' holds no study that this version can read ({said})") from None


def rows_of(folder: Path) -> list[RowProgress]:
    """How far each row of the study in a folder is, on each recording that it is computed on. Nothing is written.

    Raises:
        InvalidConfig: As :func:`opened`.
    """
    with opened(folder) as origin:
        return list(_rows(folder, origin))


def by_recording(ones: Sequence[Block]) -> list[list[Block]]:
    """Blocks, those of one recording in one embodiment together."""
    return [list(group) for _, group in groupby(ones, key=lambda block: block.place)]


def cells_in(
    folder: Path,
    ones: Sequence[Block],
    rows: Mapping[str, dict[str, Any]],
    take: Callable[[Part], _T],
    *,
    mend: bool = False,
) -> dict[tuple[str, int], _T]:
    """What is kept of the cells of one recording in one embodiment.

    Of a cell that is there twice, as after a retry, the one counts of which fewer seeds failed.

    Args:
        folder: Of the store.
        ones: All blocks of the recording.
        rows: Of the study, name -> table.
        take: What is wanted of a cell.
        mend: Whether a file with something in it that is damaged or of something else gets another name, after all
            that is sound was copied; otherwise nothing is written.

    Returns:
        Name of a row, number of a block -> what was wanted.
    """
    wanted: dict[tuple[str, str], dict[str, Any]] = {}
    for name, row in rows.items():
        if ones[0].is_on(row):
            config = ones[0].config(row)
            wanted |= {(name, str(block.number)): block.identity(name, config) for block in ones}
    found: dict[tuple[str, int], tuple[int, _T]] = {}
    for path in sorted((folder / "cells" / ones[0].place).glob("*.parts")):
        sound, wrong = [], []
        with contextlib.suppress(FileNotFoundError):  # of a run beside this one, that has set it aside meanwhile
            for part in _parts(path):
                problem = part if isinstance(part, str) else _not_wanted(part, wanted, folder)
                if isinstance(part, str) or problem:
                    wrong.append(str(problem))
                    continue
                if mend:
                    sound.append(part)
                if problem is None:
                    key = part.identity["estimator"], part.identity["block"]
                    failed = sum(map(bool, part.notes["failures"]))
                    if key not in found or failed < found[key][0]:
                        found[key] = failed, take(part)
            if wrong:
                set_aside(path, "; ".join(dict.fromkeys(wrong)), sound, mend=mend)
    return {key: one for key, (_, one) in found.items()}


def set_aside(path: Path, why: str, sound: Sequence[Part] = (), *, mend: bool) -> None:
    """Gives a file another name, and says so.

    Args:
        path: The file.
        why: What is wrong with it.
        sound: What else is in it, for a file of its own.
        mend: Whether it is really done: nothing is written for whoever only reads.
    """
    done = "it counts as missing"
    if mend:
        with contextlib.suppress(OSError):
            if sound:
                kept = path.with_name(f"mended.{secrets.token_hex(4)}{path.suffix}")
                write_bytes(kept, b"".join(part.pack() for part in sound))
            os.replace(path, path.with_name(f"{path.name}.damaged"))
            done = f"it is set aside as '{path.name}.damaged'"
    warnings.warn(f"'{path}': {why}; {done} and computed again", SetAside, stacklevel=2)


# Inner ---------------------------------------------------------------------------------------------------------------


def _rows(folder: Path, origin: Mapping[str, Any]) -> Iterator[RowProgress]:
    table = origin["config"]["estimators"]
    for ones in by_recording(blocks(origin, folder)):
        kept = cells_in(folder, ones, table, lambda part: part.notes["failures"])
        for name, row in table.items():
            if not ones[0].is_on(row):
                continue
            failures: dict[str, list[int]] = {}
            missing = 0
            for block in ones:
                said = kept.get((name, block.number))
                missing += len(block.seeds) if said is None else 0
                for seed, failure in zip(block.seeds, said or (), strict=said is not None):
                    if failure:
                        failures.setdefault(failure, []).append(seed)
            total = sum(len(block.seeds) for block in ones)
            yield RowProgress(ones[0].embodiment, ones[0].recording, name, total, missing, failures)


def _parts(path: Path) -> Iterator[Part | str]:
    try:
        yield from parts_in(path)
    except FileNotFoundError:
        raise
    except OSError as problem:
        yield str(problem.strerror)


def _not_wanted(part: Part, wanted: Mapping[tuple[str, str], Mapping[str, Any]], folder: Path) -> str | None:
    """Why a part is none of the cells; None: it is one; empty: a run beside this one added it to the study."""
    identity = wanted.get((str(part.identity.get("estimator")), str(part.identity.get("block"))))
    if identity is None:
        there = (settings(folder) or {}).get("config", {}).get("estimators", {})
        name = str(part.identity.get("estimator"))
        return "" if name in there else f"it holds something else (estimator is '{name}')"
    if wrong := part.other_than(identity):
        return wrong
    failures = part.notes.get("failures")
    if not isinstance(failures, list) or len(failures) != len(identity["seeds"]):
        return "it holds no scores"
    return None
