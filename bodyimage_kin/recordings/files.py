"""Recordings as NetCDF files that describe themselves, written once and atomically, and read without trust."""

from __future__ import annotations

import os
from pathlib import Path

import h5py
import xarray as xr

from bodyimage_kin._files import atomic_path
from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.recordings._attributes import decoded, encoded
from bodyimage_kin.recordings.schema import COORDINATES, VARIABLES, check

MOST_BYTES = 1 << 30
"""Of all that a file unpacks to; one that claims to hold more is refused before it is read."""
_TEXT = 64
"""Bytes of a name, as Python keeps it."""
_KNOWN = (*VARIABLES, *COORDINATES)


def write_recording(recording: xr.Dataset, path: str | os.PathLike[str]) -> None:
    """Writes a recording (or an experience) as NetCDF; an interrupted write leaves nothing under the final name.

    Attributes that NetCDF cannot hold (booleans, None, lists, tables) are written as JSON.

    Raises:
        InvalidRecording: Not a recording, one with variables or attributes that no recording has, or a place that
            cannot be written to.
    """
    recording = check(recording)
    for name in recording.variables:
        if name not in _KNOWN:
            raise InvalidRecording(f"a recording has no variable '{name}'; write it without: .drop_vars('{name}')")
    stored = recording.drop_encoding()
    stored.attrs = encoded("the recording", recording.attrs)
    for name, variable in stored.variables.items():
        variable.attrs = encoded(f"variable '{name}'", recording[name].attrs)
    try:
        with atomic_path(Path(path)) as temporary:
            stored.to_netcdf(temporary, engine="h5netcdf")
    except (OSError, ValueError, TypeError) as problem:
        raise InvalidRecording(f"cannot write recording '{path}': {_first_line(problem)}") from problem


def read_recording(path: str | os.PathLike[str]) -> xr.Dataset:
    """Reads a recording from NetCDF; what no recording has is left in the file.

    Raises:
        InvalidRecording: A file that is missing, is no NetCDF, claims to hold more than a GiB, lacks a variable or
            holds something else in one.
    """
    if not Path(path).is_file():
        raise InvalidRecording(f"there is no recording at '{path}'")
    try:
        others = _others(Path(path))
        with xr.open_dataset(
            path, engine="h5netcdf", drop_variables=others, decode_times=False, decode_timedelta=False
        ) as stored:
            recording = stored.load()
    except InvalidRecording:
        raise
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, AttributeError, OverflowError) as problem:
        raise InvalidRecording(f"'{path}' is no NetCDF recording: {_first_line(problem)}") from problem
    recording.attrs = decoded(recording.attrs)
    for variable in recording.variables.values():
        variable.attrs = decoded(variable.attrs)
    return check(recording)


def _others(path: Path) -> list[str]:
    """Names of what is in a file and no recording has; the file itself is looked at, and nothing unpacked.

    Raises:
        InvalidRecording: It claims to hold too much, or points at other files.
    """
    size, others = 0, []
    with h5py.File(path, "r") as file:
        for name in file:
            if not isinstance(file.get(name, getlink=True), h5py.HardLink):
                raise InvalidRecording(f"'{path}': '{name}' points elsewhere; give a file that holds its own data")
            if name not in _KNOWN:
                others.append(name)
                continue
            data = file[name]
            if not isinstance(data, h5py.Dataset):
                raise InvalidRecording(f"'{path}': '{name}' is no variable")
            if data.external or data.is_virtual:
                raise InvalidRecording(
                    f"'{path}': '{name}' is kept in other files; give a file that holds its own data"
                )
            # A single chunk is unpacked as a whole, and may be larger than the variable.
            count = max(_count(data.shape or ()), _count(data.chunks or ()))
            size += count * (_TEXT if data.dtype.kind == "O" else max(data.dtype.itemsize, 8))
            if size > MOST_BYTES:
                raise InvalidRecording(
                    f"'{path}' claims to hold more than {MOST_BYTES >> 20} MiB (variable '{name}': "
                    f"{' x '.join(map(str, data.shape or ()))}); cut it into shorter recordings"
                )
    return others


def _count(shape: tuple[int, ...]) -> int:
    # Python's whole numbers, which do not overflow.
    count = 1
    for length in shape:
        count *= int(length)
    return count


def _first_line(problem: Exception) -> str:
    return (str(problem).splitlines() or [type(problem).__name__])[0]
