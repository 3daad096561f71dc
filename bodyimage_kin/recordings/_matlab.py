"""MATLAB files (to version 7) as named columns; what a file claims to hold is bounded before anything is made of it."""

from __future__ import annotations

import contextlib
import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Shaped

from bodyimage_kin.errors import InvalidRecording, UnknownName

_COMPRESSED, _MATRIX = 15, 14
_CELL, _STRUCT, _OBJECT, _SPARSE, _OPAQUE = 1, 2, 3, 5, 17
_DEEPEST = 32
"""Structs within structs: no table of anybody's comes near it."""


def read_matlab(path: Path, variable: str | None, most_bytes: int) -> dict[str, Shaped[np.ndarray, "rows"]]:
    """Columns of a variable: of a matrix ("0", "1", ...), or of structs.

    Args:
        path: The file.
        variable: Its name; None: that of the only list, or of the longest.
        most_bytes: A file that unpacks to more is refused.

    Raises:
        InvalidRecording: A file of version 7.3, one that is damaged or claims more than it holds, or one of several
            variables.
        UnknownName: No such variable.
    """
    import scipy.io

    with path.open("rb") as file:
        head = file.read(128)
    if b"MATLAB 7.3" in head or head[:8] == b"\x89HDF\r\n\x1a\n":
        raise InvalidRecording(f"'{path.name}' is a MATLAB 7.3 file; in MATLAB: save(name, '-v7')")
    _refuse_claims(path, head, most_bytes)
    try:
        found = scipy.io.loadmat(path, simplify_cells=True)
    except Exception as problem:  # whatever a damaged file makes of scipy's reader
        raise InvalidRecording(f"'{path.name}' is no MATLAB file that can be read: {_first_line(problem)}") from None
    names = [name for name in found if not name.startswith("__")]
    if variable is None:
        # The records are what is longest: scalars and short lists beside them say something about them.
        lists = [name for name in names if isinstance(found[name], list | np.ndarray) and np.ndim(found[name]) > 0]
        longest = max((len(found[name]) for name in lists), default=0)
        lists = [name for name in lists if len(found[name]) == longest]
        if len(lists) != 1:
            raise InvalidRecording(f"'{path.name}' holds {', '.join(names) or 'nothing'}; name one with variable=")
        variable = lists[0]
    elif variable not in names:
        raise UnknownName(f"variable of '{path.name}'", variable, names)
    return _flattened(path.name, found[variable])


# What a file claims --------------------------------------------------------------------------------------------------


def _refuse_claims(path: Path, head: bytes, most_bytes: int) -> None:
    """Refuses a file of version 5 to 7 that unpacks to too much, or in which an array is larger than its own bytes.

    Raises:
        InvalidRecording: Such a file.
    """
    if head[126:128] not in (b"IM", b"MI"):
        return  # version 4: its arrays are plain bytes, of which none are made that are not there
    order = "<" if head[126:128] == b"IM" else ">"
    total = 0
    with path.open("rb") as file:
        file.seek(128)
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack(order + "II", tag)
            # Whatever the tag says, no more is read than there is.
            data = file.read(min(size, most_bytes + 1))
            if kind == _COMPRESSED:
                data = _unpacked(data, most_bytes + 1 - total)
            total += len(data)
            if total > most_bytes:
                raise InvalidRecording(
                    f"'{path.name}' unpacks to more than {most_bytes / 2**30:.3g} GB; give a part of it"
                )
            claims = _Claims(path.name, order, data)
            with contextlib.suppress(_Cut, struct.error):
                start, end = 0, len(data)
                if kind == _COMPRESSED:
                    kind, start, end, _ = claims.element(0, len(data))
                if kind == _MATRIX:
                    claims.matrix(start, end)


def _unpacked(packed: bytes, most: int) -> bytes:
    """What is packed, or as much of it as is to be unpacked."""
    unpacker = zlib.decompressobj()
    try:
        return unpacker.decompress(packed, max(most, 1))
    except zlib.error:
        return b""  # scipy tells what is damaged


class _Cut(Exception):
    """The bytes end where more are claimed; scipy says what of it is damaged."""


class _Claims:
    """The arrays in some bytes, walked without making any."""

    def __init__(self, name: str, order: str, data: bytes) -> None:
        self.name, self.order, self.data = name, order, data

    def element(self, at: int, end: int) -> tuple[int, int, int, int]:
        """Kind of an element, where its data begin and end, and where the next one begins."""
        if at + 8 > end:
            raise _Cut
        kind, size = struct.unpack_from(self.order + "II", self.data, at)
        if kind >> 16:  # small ones have their data within the tag
            return kind & 0xFFFF, at + 4, at + 4 + min(kind >> 16, 4), at + 8
        return kind, at + 8, min(at + 8 + size, end), at + 8 + size + -size % 8

    def matrix(self, at: int, end: int, depth: int = 0) -> None:
        """Raises where an array of these bytes claims more entries than there are bytes for."""
        if depth > _DEEPEST:
            raise InvalidRecording(
                f"'{self.name}': more than {_DEEPEST} structs within each other; save a table, or a list of structs"
            )
        if at == end:
            return  # an empty array
        _, start, _, at = self.element(at, end)
        kind = self.data[start if self.order == "<" else start + 3]
        if kind == _OPAQUE:
            return  # objects of MATLAB's own, of which scipy makes bytes
        _, start, stop, at = self.element(at, end)
        dims = struct.unpack_from(f"{self.order}{(stop - start) // 4}i", self.data, start)
        *_, at = self.element(at, end)  # its name
        count = math.prod(dims)
        if min(dims, default=0) < 0:
            self._refuse(dims)
        if kind in (_CELL, _STRUCT, _OBJECT):
            entries = count
            if kind == _OBJECT:
                *_, at = self.element(at, end)  # its class
            if kind != _CELL:
                _, start, _, at = self.element(at, end)
                (length,) = struct.unpack_from(self.order + "i", self.data, start)
                _, start, stop, at = self.element(at, end)
                entries = count * ((stop - start) // max(length, 1))
            if max(entries, count - 1) * 8 > end - at:
                self._refuse(dims)
            for _ in range(entries):
                inner, start, stop, at = self.element(at, end)
                if inner == _MATRIX:
                    self.matrix(start, stop, depth + 1)
        elif (4 * dims[-1] if kind == _SPARSE else count) > end - at:
            self._refuse(dims)

    def _refuse(self, dims: tuple[int, ...]) -> None:
        size = " x ".join(map(str, dims))
        raise InvalidRecording(f"'{self.name}' claims an array of {size} entries that it does not hold: it is damaged")


# Columns -------------------------------------------------------------------------------------------------------------


def _flattened(name: str, value: Any) -> dict[str, Shaped[np.ndarray, "..."]]:
    """Columns of a matrix ("0", "1", ...), or of a list of structs, those within them with a point between names."""
    if isinstance(value, dict):
        value = [value]
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        matrix = np.atleast_2d(value) if value.ndim > 1 else value[:, None]
        if matrix.ndim != 2:
            raise InvalidRecording(f"'{name}' holds an array of {matrix.ndim} axes; a table has two")
        return {str(index): matrix[:, index] for index in range(matrix.shape[1])}
    records = [dict(_leaves(record)) for record in value]
    fields = list(dict.fromkeys(field for record in records for field in record))
    columns: dict[str, Shaped[np.ndarray, "..."]] = {}
    for field in fields:
        cells = [record.get(field) for record in records]
        if all(isinstance(cell, int | float | np.number) for cell in cells):
            columns[field] = np.asarray(cells, dtype=np.float64)
        else:
            column = np.empty(len(cells), dtype=object)
            column[:] = [None if cell is None else cell for cell in cells]
            columns[field] = column
    return columns


def _leaves(record: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    if not isinstance(record, dict):
        yield prefix or "0", record
        return
    for field, value in record.items():
        name = f"{prefix}.{field}" if prefix else str(field)
        if isinstance(value, dict):
            yield from _leaves(value, name)
        else:
            yield name, value


def _first_line(problem: BaseException) -> str:
    return (str(problem).splitlines() or [type(problem).__name__])[0][:200]
