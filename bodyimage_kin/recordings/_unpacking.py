"""What compressed parts of a bag unpack to, known to be bounded before any of it is kept.

A chunk of some kilobytes may unpack to more than there is memory, whatever its header says. So nothing here believes a
header: what it claims is looked at first, then the chunk is unpacked piece by piece until there is too much.
"""

from __future__ import annotations

import bz2
import importlib
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.recordings.tables import MOST_BYTES

__all__ = ["MOST_UNPACKED", "bounded", "look_through", "unpacked"]

MOST_UNPACKED = 256 << 20
"""Of one chunk or message [bytes]; recorders make chunks of about one megabyte."""
_PIECE = 1 << 20
_CHUNK, _FOOTER = 0x06, 0x02
_BZ2, _LZ4, _ZSTD = b"BZh", b"\x04\x22\x4d\x18", b"\x28\xb5\x2f\xfd"
Chunks: TypeAlias = frozenset[tuple[str, int, int, str]]
"""File, place in it, packed size and compression of chunks that are known to be small enough."""


def look_through(path: Path) -> Chunks:
    """Looks at all that will be unpacked of a bag of ROS 2 before its reader is let at it.

    Args:
        path: Its file or folder.

    Raises:
        InvalidRecording: A chunk or file that is too large when it is unpacked, or says that it is.
    """
    files = sorted(one for one in path.iterdir() if one.is_file()) if path.is_dir() else [path]
    found: set[tuple[str, int, int, str]] = set()
    for file in files:
        if file.suffix.lower() == ".mcap":
            found |= set(_mcap(file))
        elif file.suffix.lower() in (".zstd", ".zst"):
            with file.open("rb") as bio:
                _count(iter(lambda: bio.read(_PIECE), b""), file.name, "it", MOST_BYTES)
    return frozenset(found)


def bounded(reader: Any, path: Path, chunks: Chunks) -> bool:
    """Keeps an open reader from unpacking more than is known to be small enough.

    Args:
        reader: Of rosbags.
        path: Of the bag.
        chunks: What :func:`look_through` found.

    Returns:
        Whether messages come as they are packed, each to be unpacked by :func:`unpacked`.

    Raises:
        InvalidRecording: An index that points at something that is no chunk of the bag.
    """
    storage = getattr(reader, "storage", None)
    if storage is None:
        for place, chunk in reader.chunks.items():
            reader.chunks[place] = chunk._replace(decompressor=lambda data: unpacked(data, path.name))
        return False
    for one in getattr(storage, "storages", [storage]):
        for chunk in getattr(one, "chunks", ()):
            key = (one.path.name, chunk.chunk_start_offset, chunk.compressed_size, chunk.compression)
            _refuse_claim(chunk.uncompressed_size, path.name)
            if chunk.compression and key not in chunks:
                raise InvalidRecording(f"'{path.name}': its index points at something that is no chunk; record it anew")
    packed = storage.metadata.compression_mode == "message"
    if packed:
        storage.metadata = storage.metadata._replace(compression_mode=None)
    return packed


def unpacked(data: bytes, name: str) -> bytes:
    """Data of a chunk or message, unpacked if they are packed (bz2, LZ4, Zstandard).

    Args:
        data: As they are in the bag.
        name: Of the bag.

    Raises:
        InvalidRecording: More than :data:`MOST_UNPACKED`.
    """
    if not data.startswith((_BZ2, _LZ4, _ZSTD)):
        return data
    found = bytearray()
    for piece in _pieces(iter([data])):
        found += piece
        if len(found) > MOST_UNPACKED:
            raise _too_large(name, "a chunk", MOST_UNPACKED)
    return bytes(found)


# Inner ---------------------------------------------------------------------------------------------------------------


def _mcap(file: Path) -> Iterator[tuple[str, int, int, str]]:
    """Chunks of an MCAP file, each once it is known to be small enough; ends where the file is none."""
    size = file.stat().st_size
    with file.open("rb") as bio:
        bio.seek(8)
        while len(head := bio.read(9)) == 9 and head[0] != _FOOTER:
            place, (length,) = bio.tell(), struct.unpack("<Q", head[1:])
            if place + length > size:
                return
            if head[0] == _CHUNK:
                packed = _chunk(bio, file.name, length)
                yield file.name, place - 9, *packed
            bio.seek(place + length)


def _chunk(bio: BinaryIO, name: str, length: int) -> tuple[int, str]:
    """Packed size and compression of the chunk that begins here, of that many bytes."""
    fixed = bio.read(32)
    if len(fixed) < 32 or length < 40:
        raise InvalidRecording(f"'{name}' is no bag that can be read: a chunk of {length} bytes")
    claimed, said = struct.unpack("<Q", fixed[16:24])[0], struct.unpack("<L", fixed[28:32])[0]
    _refuse_claim(claimed, name)
    compression = bio.read(min(said, length)).decode(errors="replace")
    (packed,) = struct.unpack("<Q", bio.read(8).rjust(8, b"\0"))
    if packed > length:
        raise InvalidRecording(f"'{name}' is no bag that can be read: a chunk of {length} bytes says {packed}")
    if compression:
        _refuse_claim(packed, name)
        _count(iter([bio.read(packed)]), name, "a chunk", MOST_UNPACKED)
    return packed, compression


def _count(data: Iterator[bytes], name: str, what: str, most: int) -> None:
    total = 0
    for piece in _pieces(data):
        total += len(piece)
        if total > most:
            raise _too_large(name, what, most)


def _pieces(data: Iterator[bytes]) -> Iterator[bytes]:
    """Unpacked data of one frame or several, never much of it at a time."""
    one: Any = None
    for given in data:
        rest = given
        while rest:
            if one is None:
                one = _decompressor(rest)
            yield one.decompress(rest, _PIECE)
            while not one.eof and not one.needs_input:
                yield one.decompress(b"", _PIECE)
            rest = (one.unused_data or b"") if one.eof else b""
            if one.eof:
                one = None


def _decompressor(data: bytes) -> Any:
    if data.startswith(_BZ2):
        return bz2.BZ2Decompressor()
    if data.startswith(_LZ4):
        return importlib.import_module("lz4.frame").LZ4FrameDecompressor()
    try:
        return importlib.import_module("compression.zstd").ZstdDecompressor()
    except ImportError:
        return importlib.import_module("backports.zstd").ZstdDecompressor()


def _refuse_claim(size: int, name: str) -> None:
    if size > MOST_UNPACKED:
        raise _too_large(name, "a chunk", MOST_UNPACKED)


def _too_large(name: str, what: str, most: int) -> InvalidRecording:
    return InvalidRecording(
        f"'{name}': {what} unpacks to more than {most >> 20} MiB; record it in smaller chunks, or cut the bag"
    )
