"""Where a study is kept: a folder that any number of workers write into, each file whole, and known when it is read.

::

    bodyimage_kin.json                              what the store is for
    given/                                          recordings and embodiments that the study was handed
    recordings/EMBODIMENT/RECORDING/block0.parts    facts of recordings, then these (:func:`recording_of` reads them)
    cells/EMBODIMENT/RECORDING/*.parts              scores; a file for a cell, or for many that take little time
    logs/EMBODIMENT/RECORDING/ROW/block0.log        what was printed meanwhile, if anything

Files are on the disk before they have their names, and say what they hold (:mod:`bodyimage_kin.study.parts`). What is
damaged, or of something else, is set aside with a warning and computed again; it stops nothing. Who only reads a store
writes nothing.
"""

from __future__ import annotations

import errno
import functools
import hashlib
import json
import math
import secrets
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from bodyimage_kin import _files
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidRecording, OutputRefused
from bodyimage_kin.recordings import check
from bodyimage_kin.study.blocks import Block
from bodyimage_kin.study.kept import KIND, MARKER, set_aside, settings
from bodyimage_kin.study.parts import Part, parts_in
from bodyimage_kin.study.specs import Table

__all__ = ["Store", "before_it_grew", "body_files", "differences", "fingerprint", "padded", "said"]

_LEFT_OVER = 10.0
"""Age from which a temporary file of a process that is gone is swept [s]."""
_MOST_SAID = 2000
"""Characters of a failure that are kept."""


@dataclass(frozen=True)
class Store:
    """A folder of results.

    Attributes:
        folder: The folder.
        mends: Whether what is damaged gets another name; not for whoever only reads.
    """

    folder: Path
    mends: bool = False

    @classmethod
    def claim(cls, folder: Path, origin: Mapping[str, Any], begin: Path) -> Store:
        """The store of a study, made when missing.

        Args:
            folder: New, empty, or of the same study, or of one that this study adds to (:func:`before_it_grew`).
            origin: Config and hashes; all that decides what comes out.
            begin: Where the study's relative paths begin.

        Raises:
            OutputRefused: A folder of something else, or of a study with another origin; says what differs.
        """
        before = settings(folder)
        stored = {key: value for key, value in (before or origin).items() if key != "folder"}
        if different := list(differences(stored, before_it_grew(stored, origin))):
            shown = "; ".join(different[:5]) + (f"; and {len(different) - 5} more" if len(different) > 5 else "")
            raise OutputRefused(f"'{folder}' holds another study: {shown}; name another folder for this one")
        place = cls(_files.claim(folder, KIND, {**origin, "folder": str(begin.absolute())}).absolute(), mends=True)
        place._sweep()
        return place

    def log(self, block: Block, estimator: str = "recordings") -> Path:
        """File of what a task prints."""
        return self.folder / "logs" / block.place / estimator / f"block{block.number}.log"

    # Cells and recordings ---------------------------------------------------------------------------------------------

    def write_cells(self, block: Block, cells: Sequence[Part]) -> None:
        """Writes cells of one recording in one embodiment into a new file.

        Raises:
            OutputRefused: A place that cannot be written to.
        """
        first = cells[0].identity
        name = f"{first['estimator']}.block{first['block']}.{secrets.token_hex(4)}.parts"
        self._write(self.folder / "cells" / block.place / name, *cells)

    def write_recordings(self, block: Block, facts: Part, recordings: Mapping[str, Sequence[xr.Dataset | str]]) -> None:
        """Writes the recordings of a block, role -> one a seed, or the hash of one that was handed over.

        Raises:
            OutputRefused: A place that cannot be written to.
        """
        arrays: dict[str, np.ndarray] = {}
        listed: dict[str, list[Any]] = {}
        for role, ones in recordings.items():
            for index, one in enumerate(ones):
                of = one if isinstance(one, str) else _take_apart(one, f"{role}/{index}/", arrays)
                listed.setdefault(role, []).append(of)
        path, (_, identity) = self._recordings(block)
        self._write(path, facts, Part(identity, arrays, {"recordings": listed}))

    def facts(self, block: Block) -> Part | None:
        """Facts of a block's recordings; None: missing, or set aside."""
        path, (identity, _) = self._recordings(block)
        parts = self._read(path, identity)
        return parts[0] if parts else None

    def recordings(self, block: Block) -> tuple[Part, dict[str, list[xr.Dataset]]] | None:
        """What :meth:`write_recordings` wrote, facts and all; None: missing, or set aside.

        Raises:
            InvalidRecording: One that was handed over is not in the store.
        """
        path, identities = self._recordings(block)
        parts = self._read(path, *identities)
        if parts is None:
            return None
        facts, kept = parts
        return facts, {
            role: [
                self.given_recording(of) if isinstance(of, str) else _put_together(of, f"{role}/{index}/", kept.arrays)
                for index, of in enumerate(ones)
            ]
            for role, ones in kept.notes["recordings"].items()
        }

    def _recordings(self, block: Block) -> tuple[Path, tuple[Table, Table]]:
        """The file of a block's recordings, and what its two parts say that they are."""
        path = self.folder / "recordings" / block.place / f"block{block.number}.parts"
        return path, (block.identity(), block.identity() | {"holds": "recordings"})

    # What the study was handed ----------------------------------------------------------------------------------------

    def give(self, given: Mapping[str, xr.Dataset | Embodiment]) -> None:
        """Keeps recordings and embodiments, by their hashes, unless they are there."""
        for sha256, thing in given.items():
            if isinstance(thing, xr.Dataset):
                path, identity = self._given(sha256)
                if self._read(path, identity) is None:
                    arrays: dict[str, np.ndarray] = {}
                    self._write(path, Part(identity, arrays, {"recording": _take_apart(thing, "", arrays)}))
            else:
                folder = self.folder / "given" / sha256
                for name, data in body_files(thing).items():
                    self._write(folder / name, data)

    @functools.lru_cache(maxsize=4)  # noqa: B019 (a handful of recordings, for every block that names them)
    def given_recording(self, sha256: str) -> xr.Dataset:
        """A recording that the study was handed; to be copied before anything in it is changed.

        Raises:
            InvalidRecording: It is not there.
        """
        path, identity = self._given(sha256)
        parts = self._read(path, identity)
        if parts is None:
            raise InvalidRecording(f"recording {sha256[:12]} is not in the store; give it to the study again")
        return _put_together(parts[0].notes["recording"], "", parts[0].arrays)

    def _given(self, sha256: str) -> tuple[Path, Table]:
        return self.folder / "given" / f"{sha256}.parts", {"recording": sha256}

    def _read(self, path: Path, *identities: Mapping[str, Any]) -> list[Part] | None:
        """The first parts of a file, known to be what they should be; None: missing, or set aside."""
        found: list[Part] = []
        try:
            for part in parts_in(path):
                if isinstance(part, str):
                    raise ValueError(part)
                if wrong := part.other_than(identities[len(found)]):
                    raise ValueError(wrong)
                found.append(part)
                if len(found) == len(identities):
                    return found
            raise ValueError("it is cut")
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as problem:
            set_aside(path, str(problem), mend=self.mends)
        return None

    def _write(self, path: Path, *things: Part | bytes) -> None:
        data = b"".join(one.pack() if isinstance(one, Part) else one for one in things)
        try:
            # Nothing makes a folder anew that was deleted under the run.
            (self.folder / MARKER).stat()
            path.parent.mkdir(parents=True, exist_ok=True)
            _files.write_bytes(path, data)
        except OSError as problem:
            gone = problem.errno == errno.ENOENT and not self.folder.exists()
            said = "the folder was deleted" if gone else problem.strerror
            raise OutputRefused(
                f"cannot write '{path}': {said}; what is finished is kept, run the study again"
            ) from None

    def _sweep(self) -> None:
        """Removes temporary files of processes that were killed while they wrote."""
        old = time.time() - _LEFT_OVER
        for path in self.folder.rglob(".*.tmp"):
            try:
                if path.stat().st_mtime < old:
                    path.unlink()
            except OSError:
                continue


def before_it_grew(stored: Mapping[str, Any], asked: Mapping[str, Any]) -> dict[str, Any]:
    """What is asked, without what may be added to a store: then nothing may differ.

    A cell's random streams are its own, and its seeds learn together. So embodiments, recordings and estimators may be
    added, and seeds after blocks that are complete: no bit of a cell that is there already depends on them.
    """
    there = stored.get("config", {})
    config = {**asked["config"], "labels": there.get("labels")}
    if config["labels"] is None:
        # Labels may change.
        del config["labels"]
    found = dict(asked, config=config)
    for table, names in (
        *((config, name) for name in ("embodiments", "recordings", "estimators")),
        *((found, name) for name in ("urdf_sha256", "embodiment_sha256", "skin_shape")),
    ):
        known = (there if table is config else stored).get(names, {})
        table[names] = {name: value for name, value in table[names].items() if name in known}
    seeds, count = config["seeds"], len(there.get("seeds", []))
    if count % config["block"] == 0 and seeds[:count] == there.get("seeds"):
        config["seeds"] = seeds[:count]
    return found


def differences(stored: Any, asked: Any, name: str = "") -> Iterator[str]:
    """Every value that two nested tables do not share, in words."""
    if isinstance(stored, Mapping) and isinstance(asked, Mapping):
        for key in [*stored, *(key for key in asked if key not in stored)]:
            place = f"{name}.{key}" if name else str(key)
            if key not in stored or key not in asked:
                yield f"{place} is only {'in the store' if key in stored else 'asked'}"
            else:
                yield from differences(stored[key], asked[key], place)
    elif json.dumps(stored) != json.dumps(asked):
        yield f"{name} is {stored!r} in the store, {asked!r} asked"


def fingerprint(recording: xr.Dataset) -> str:
    """Hash of all that a recording says, the same however it is kept.

    Raises:
        InvalidRecording: Not a recording.
    """
    found = hashlib.sha256(json.dumps(recording.attrs, sort_keys=True, default=str).encode())
    for name in sorted(map(str, check(recording).variables)):
        one = recording.variables[name]
        values = np.ascontiguousarray(one.values)
        found.update(json.dumps([name, one.dims, values.shape, one.attrs], sort_keys=True, default=str).encode())
        text = values.dtype.kind not in "biuf"
        found.update(json.dumps(values.tolist(), default=str).encode() if text else str(values.dtype).encode())
        found.update(b"" if text else values.tobytes())
    return found.hexdigest()


def body_files(body: Embodiment) -> dict[str, bytes]:
    """An embodiment as files that :func:`bodyimage_kin.load_embodiment` reads: ``embodiment.toml`` and its URDF."""
    return {"embodiment.toml": body.to_toml("robot.urdf").encode(), "robot.urdf": body.robot.source}


def said(problem: BaseException) -> str:
    """An error in one line that any file can hold: its class and what it says, cut."""
    try:
        words = " ".join(str(problem)[: 10 * _MOST_SAID].split()).replace("\0", "")
    except Exception:
        words = ""
    words = words.encode("utf-8", "backslashreplace").decode()
    words = words if len(words) <= _MOST_SAID else words[: _MOST_SAID - 3] + "..."
    return f"{type(problem).__name__}: {words}" if words else type(problem).__name__


def padded(arrays: list[Any]) -> np.ndarray:
    """Arrays side by side along a new first axis; where one is smaller or None, NaN, of text nothing."""
    there = [np.asarray(one) for one in arrays if one is not None]
    text = any(one.dtype.kind == "U" for one in there)
    shape = tuple(map(max, zip(*(one.shape for one in there), strict=True))) if there else ()
    found = np.full((len(arrays), *shape), "" if text else math.nan, dtype=object if text else float)
    for row, one in zip(range(len(arrays)), arrays, strict=True):
        if one is not None:
            values = np.asarray(one)
            at: tuple[Any, ...] = (row, *map(slice, values.shape))
            found[at] = values
    return found.astype(str) if text else found


def _take_apart(recording: xr.Dataset, prefix: str, arrays: dict[str, np.ndarray]) -> Table:
    """Puts a recording's arrays among others; gives what else there is to it."""
    variables = {}
    for name, one in recording.variables.items():
        arrays[f"{prefix}{name}"] = one.values
        variables[str(name)] = [list(one.dims), _plain(one.attrs), name in recording.coords]
    return {"attrs": _plain(recording.attrs), "variables": variables}


def _put_together(table: Table, prefix: str, arrays: Mapping[str, np.ndarray]) -> xr.Dataset:
    """The inverse of :func:`_take_apart`."""
    found: dict[bool, dict[str, Any]] = {True: {}, False: {}}
    for name, (dims, attrs, is_coordinate) in table["variables"].items():
        found[is_coordinate][name] = (dims, arrays[f"{prefix}{name}"], attrs)
    return xr.Dataset(found[False], found[True], table["attrs"])


def _plain(attributes: Mapping[Any, Any]) -> Table:
    """Attributes as JSON says them."""
    return {
        str(key): value.tolist() if isinstance(value, np.generic | np.ndarray) else value
        for key, value in attributes.items()
    }
