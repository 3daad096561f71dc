"""Where a study is kept: a folder that any number of workers write into, each file whole, and known when it is read.

::

    bodyimage_kin.json                              what the store is for
    given/                                          recordings and embodiments that the study was handed
    recordings/EMBODIMENT/RECORDING/block0.part     what was simulated (:func:`recording_of` reads it)
    facts/EMBODIMENT/RECORDING/block0.part          facts of the recordings
    cells/EMBODIMENT/RECORDING/ROW/block0.part      scores of one row
    logs/EMBODIMENT/RECORDING/ROW/block0.log        what was printed meanwhile, if anything

A part begins with the checksum of all that follows: one line of JSON that says what the part is and lists its arrays,
then their bytes. A file that is damaged, or says that it is something else, is set aside with a warning and computed
again; it stops nothing.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from bodyimage_kin import _files
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidRecording, OutputRefused
from bodyimage_kin.recordings import check
from bodyimage_kin.study.grid import Block
from bodyimage_kin.study.specs import Table

__all__ = [
    "KIND",
    "Part",
    "SetAside",
    "Store",
    "before_it_grew",
    "body_files",
    "differences",
    "fingerprint",
    "padded",
    "said",
    "settings",
]

KIND = "study"
_MARKER = "bodyimage_kin.json"
_MAGIC = b"bodyimage_kin part 1 "
_LEFT_OVER = 10.0
"""Age from which a temporary file of a process that is gone is swept [s]."""
_MOST_SAID = 2000
"""Characters of a failure that are kept."""


class SetAside(UserWarning):
    """A file of a store is damaged or of something else; what it should hold is computed again."""


@dataclass(frozen=True, eq=False)
class Part:
    """What a file holds.

    Attributes:
        identity: What it is (:meth:`Block.identity`).
        arrays: Name -> numbers, or text; the first axis is the block's seeds.
        notes: What else is to be kept, as JSON says it.
    """

    identity: Mapping[str, Any]
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    notes: dict[str, Any] = field(default_factory=dict)

    def pack(self) -> bytes:
        """As bytes."""
        listed, bodies = {}, []
        for name, values in self.arrays.items():
            kind = "text"
            if values.dtype.kind in "biuf":
                kind = values.dtype.newbyteorder("<").str
                data = np.ascontiguousarray(values, dtype=kind).tobytes()
            else:
                data = json.dumps(values.tolist(), default=str).encode()
            listed[name] = [kind, list(values.shape), len(data)]
            bodies.append(data)
        head = json.dumps({"identity": self.identity, "notes": self.notes, "arrays": listed}, default=str)
        rest = head.encode() + b"\n" + b"".join(bodies)
        return _MAGIC + hashlib.sha256(rest).hexdigest().encode() + b"\n" + rest

    @classmethod
    def unpack(cls, data: bytes) -> Part:
        """The inverse of :meth:`pack`.

        Raises:
            ValueError: Damaged, or no part.
        """
        first, _, rest = data.partition(b"\n")
        if not first.startswith(_MAGIC):
            raise ValueError("it is no part of a store")
        if hashlib.sha256(rest).hexdigest().encode() != first[len(_MAGIC) :]:
            raise ValueError("its checksum is wrong")
        line, _, body = rest.partition(b"\n")
        head, arrays, begin = json.loads(line), {}, 0
        for name, (kind, shape, size) in head["arrays"].items():
            piece, begin = body[begin : begin + size], begin + size
            if kind == "text":
                arrays[name] = np.array(json.loads(piece), dtype=str).reshape(shape)
            else:
                arrays[name] = np.frombuffer(piece, dtype=kind).reshape(shape)
        return cls(head["identity"], arrays, head["notes"])


@dataclass(frozen=True)
class Store:
    """A folder of results.

    Attributes:
        folder: The folder.
    """

    folder: Path

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
        place = cls(_files.claim(folder, KIND, {**origin, "folder": str(begin.absolute())}).absolute())
        place._sweep()
        return place

    def part(self, block: Block, estimator: str = "") -> Path:
        """File of a cell; without an estimator, of the facts of its recordings."""
        name = f"block{block.number}.part"
        if not estimator:
            return self.folder / "facts" / block.place / name
        return self.folder / "cells" / block.place / estimator / name

    def log(self, block: Block, estimator: str = "recordings") -> Path:
        """File of what a task prints."""
        return self.folder / "logs" / block.place / estimator / f"block{block.number}.log"

    def read(self, path: Path, identity: Mapping[str, Any]) -> Part | None:
        """A part, once it is known to be what it should be; None: missing, or set aside."""
        try:
            part = Part.unpack(path.read_bytes())
            if part.identity == dict(identity):
                return part
            of = {key: value for key, value in part.identity.items() if identity.get(key) != value}
            why = f"it is of something else ({', '.join(of)} differ)"
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as problem:
            why = f"{problem or type(problem).__name__}"
        self.set_aside(path, why)
        return None

    def set_aside(self, path: Path, why: str) -> None:
        """Gives a file another name, and says so."""
        other = path.with_name(f"{path.name}.damaged")
        try:
            os.replace(path, other)
            done = f"it is set aside as '{other.name}'"
        except OSError:
            done = "it counts as missing"
        warnings.warn(f"'{path}': {why}; {done} and computed again", SetAside, stacklevel=2)

    def write(self, path: Path, part: Part) -> None:
        """Writes a part atomically.

        Raises:
            OutputRefused: A place that cannot be written to.
        """
        self._write(path, part.pack())

    def write_recordings(self, block: Block, recordings: Mapping[str, Sequence[xr.Dataset | str]]) -> None:
        """Writes the recordings of a block: role -> one a seed, or the hash of one that was handed over."""
        arrays: dict[str, np.ndarray] = {}
        listed: dict[str, list[Any]] = {}
        for role, ones in recordings.items():
            for index, one in enumerate(ones):
                of = one if isinstance(one, str) else _take_apart(one, f"{role}/{index}/", arrays)
                listed.setdefault(role, []).append(of)
        self.write(self._recordings(block), Part(block.identity(), arrays, {"recordings": listed}))

    def read_recordings(self, block: Block) -> dict[str, list[xr.Dataset]] | None:
        """What :meth:`write_recordings` wrote; None: missing, or set aside.

        Raises:
            InvalidRecording: One that was handed over is not in the store.
        """
        part = self.read(self._recordings(block), block.identity())
        if part is None:
            return None
        return {
            role: [
                self.given_recording(of) if isinstance(of, str) else _put_together(of, f"{role}/{index}/", part.arrays)
                for index, of in enumerate(ones)
            ]
            for role, ones in part.notes["recordings"].items()
        }

    def _recordings(self, block: Block) -> Path:
        return self.folder / "recordings" / block.place / f"block{block.number}.part"

    # What the study was handed ----------------------------------------------------------------------------------------

    def give(self, given: Mapping[str, xr.Dataset | Embodiment]) -> None:
        """Keeps recordings and embodiments, by their hashes, unless they are there."""
        for sha256, thing in given.items():
            if isinstance(thing, xr.Dataset):
                path, identity = self._given(sha256)
                if self.read(path, identity) is None:
                    arrays: dict[str, np.ndarray] = {}
                    self.write(path, Part(identity, arrays, {"recording": _take_apart(thing, "", arrays)}))
            else:
                folder = self.folder / "given" / sha256
                for name, data in body_files(thing).items():
                    self._write(folder / name, data)

    def given_recording(self, sha256: str) -> xr.Dataset:
        """A recording that the study was handed.

        Raises:
            InvalidRecording: It is not there.
        """
        part = self.read(*self._given(sha256))
        if part is None:
            raise InvalidRecording(f"recording {sha256[:12]} is not in the store; give it to the study again")
        return _put_together(part.notes["recording"], "", part.arrays)

    def _given(self, sha256: str) -> tuple[Path, Table]:
        return self.folder / "given" / f"{sha256}.part", {"recording": sha256}

    def _write(self, path: Path, data: bytes) -> None:
        try:
            # Nothing makes a folder anew that was deleted under the run.
            (self.folder / _MARKER).stat()
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


def settings(folder: Path) -> dict[str, Any] | None:
    """What the study in a folder was asked for; None when there is none."""
    try:
        marker = json.loads((folder / _MARKER).read_text(encoding="utf-8"))
        return dict(marker["settings"]) if marker["kind"] == KIND else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def before_it_grew(stored: Mapping[str, Any], asked: Mapping[str, Any]) -> dict[str, Any]:
    """What is asked, without what may be added to a store: then nothing may differ.

    A cell's random streams are its own, and its seeds learn together. So embodiments, recordings and estimators may be
    added, and seeds after blocks that are complete: no bit of a cell that is there already depends on them.
    """
    config = dict(asked["config"])
    there = stored.get("config", {})
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
