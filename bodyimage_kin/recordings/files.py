"""Recordings as NetCDF files that describe themselves, written once and atomically."""

from __future__ import annotations

import os
from pathlib import Path

import xarray as xr

from bodyimage_kin._files import atomic_path
from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.recordings.schema import check


def write_recording(recording: xr.Dataset, path: str | os.PathLike[str]) -> None:
    """Writes a recording (or an experience) as NetCDF; an interrupted write leaves nothing under the final name.

    Raises:
        InvalidRecording: Not a recording, or a place that cannot be written to.
    """
    check(recording)
    try:
        with atomic_path(Path(path)) as temporary:
            recording.to_netcdf(temporary, engine="h5netcdf")
    except OSError as problem:
        raise InvalidRecording(f"cannot write recording '{path}': {problem}") from problem


def read_recording(path: str | os.PathLike[str]) -> xr.Dataset:
    """Reads a recording that :func:`write_recording` wrote.

    Raises:
        InvalidRecording: A file that is missing, is no NetCDF, or lacks a variable.
    """
    if not Path(path).is_file():
        raise InvalidRecording(f"there is no recording at '{path}'")
    try:
        with xr.open_dataset(path, engine="h5netcdf") as stored:
            recording = stored.load()
    except (OSError, ValueError, KeyError) as problem:
        raise InvalidRecording(f"'{path}' is no NetCDF recording: {problem}") from problem
    return check(recording)
