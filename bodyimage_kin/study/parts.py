"""Parts: what the files of a store are made of, each known to be whole when it is read.

A part begins with a line that says its checksum and its length; then comes one line of JSON that says what it is and
lists its arrays, then their bytes. A file is one part after the other.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

__all__ = ["Part", "parts_in"]

_MAGIC = b"bodyimage_kin part 2 "
_LONGEST_LINE = 120
"""Of the first line of a part [bytes]."""


@dataclass(frozen=True, eq=False)
class Part:
    """One thing in a file.

    Attributes:
        identity: What it is (:meth:`bodyimage_kin.study.blocks.Block.identity`).
        arrays: Name -> numbers, or text; the first axis is the block's seeds.
        notes: What else is to be kept, as JSON says it.
    """

    identity: Mapping[str, Any]
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    notes: dict[str, Any] = field(default_factory=dict)

    def other_than(self, identity: Mapping[str, Any]) -> str:
        """What is wrong with this part where another is wanted; empty: nothing."""
        differ = [key for key, value in identity.items() if self.identity.get(key) != value]
        same = self.identity == dict(identity)
        return "" if same else f"it holds something else ({', '.join(differ)} differ)"

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
        return b"%s%s %d\n%s" % (_MAGIC, hashlib.sha256(rest).hexdigest().encode(), len(rest), rest)

    @classmethod
    def unpack(cls, file: BinaryIO) -> Part:
        """The part that begins where a file stands, which then stands behind it.

        Raises:
            ValueError: Damaged, or no part.
        """
        first = file.readline(_LONGEST_LINE)
        words = first[len(_MAGIC) :].split()
        if not first.startswith(_MAGIC) or len(words) != 2 or not words[1].isdigit():
            raise ValueError("it is no part of a store")
        # Not more than there is: a damaged length would ask for memory without end.
        length, left = int(words[1]), os.fstat(file.fileno()).st_size - file.tell()
        if length > left:
            raise ValueError("it is cut")
        rest = file.read(length)
        if hashlib.sha256(rest).hexdigest().encode() != words[0]:
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


def parts_in(path: Path) -> Iterator[Part | str]:
    """The parts of a file, one after the other; in the place of what is damaged, what is wrong with it.

    Raises:
        OSError: The file cannot be read.
    """
    with path.open("rb") as file:
        end = os.fstat(file.fileno()).st_size
        if not end:
            yield "it is empty"
        while (begin := file.tell()) < end:
            try:
                part: Part | str = Part.unpack(file)
            except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as problem:
                part = str(problem) or type(problem).__name__
                # The next part may be sound.
                file.seek(begin + 1)
                there = file.read().find(_MAGIC)
                file.seek(end if there < 0 else begin + 1 + there)
            yield part
