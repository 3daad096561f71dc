"""Recordings as files: NetCDF that describes itself, written atomically; tables of others, read without trust."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import h5py
import xarray as xr

from bodyimage_kin import _checks
from bodyimage_kin._files import atomic_path
from bodyimage_kin.body import Embodiment
from bodyimage_kin.errors import InvalidConfig, InvalidRecording
from bodyimage_kin.recordings._attributes import decoded, encoded
from bodyimage_kin.recordings._look import Units
from bodyimage_kin.recordings.bags import is_bag, read_bag
from bodyimage_kin.recordings.columns import Column, Columns, recording_of, table_for
from bodyimage_kin.recordings.schema import COORDINATES, VARIABLES, check, with_blocks
from bodyimage_kin.recordings.tables import TABLES
from bodyimage_kin.robot import Robot

__all__ = ["MOST_BYTES", "read_recording", "write_recording"]

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


def read_recording(
    path: str | os.PathLike[str],
    columns: Columns | None = None,
    *,
    units: Units | None = None,
    robot: Robot | Embodiment | None = None,
    joints: Sequence[str] | None = None,
    order: Literal["stream", "scattered"] | str | None = None,
    size: Sequence[int] | None = None,
    unseen: Sequence[float | int] = (),
    where: Mapping[Column, float | int | str] | None = None,
    gap: float | int | None = None,
    sampling: float | int | None = None,
    variable: str | None = None,
    decimal: str = ".",
    join_within: float | int = 0.1,
) -> xr.Dataset:
    """Reads a recording: one of ours from NetCDF, a table of postures and observations, or a bag.

    A table is a text (CSV and its like), a Parquet file or a MATLAB file of a matrix or of structs. What people get
    wrong in one is said in one line, with row and column: degrees taken for radians, millimetres for metres, time going
    backwards, an image outside the sensor are errors; gaps, doubled rows and joints that never move are warnings.

    A bag is one of ROS 1 (.bag), of ROS 2 (its folder, .db3) or MCAP: joint states, and one tracked point or marker. It
    has a row for each observation of the point, the joints being interpolated to its time.

    Args:
        path: The file; its ending says what it is.
        columns: Variable of a recording (``q``, ``hand_image``, ``hand_position``, ``hand_offset``, ``touched``,
            ``intensity``, ``time``, ``trial``, ``block``, ``repeat``, ``at_reference``) -> its columns: a name, a
            number (from 0, where every column is given so), a list of them, joint -> name, or a pattern with one ``*``
            that stands for the joint. None: columns named ``q.JOINT``, ``hand_image.u`` and the like, or as the joints.
            Of a bag: ``q`` -> topic of joint states, and ``hand_position`` or ``hand_image`` -> topic of the point (its
            x and y), in brackets the frame or marker that is meant, ``"/tf[wrist_marker]"``. None: the only ones.
        units: Variable -> its unit in the file: ``"deg"``, ``"mm"``, ``"px"``, ``"ms"`` ...; radians, metres and
            seconds where nothing is said, and pixels of an image. Of ``q`` also joint -> unit.
        robot: Whose joints these are: their names and limits are checked; of an embodiment, also the image's unit. Of a
            bag, what moves beside its joints is passed over.
        joints: Names of the joints, where the columns of ``q`` are a list; of a bag, which joints are taken.
        order: ``"stream"``, rows one after the other in time, or ``"scattered"``, postures in no order; a column of
            time says the first.
        size: (width, height) of the image [px], to check it.
        unseen: Numbers that stand for an unseen hand, where all coordinates bear one.
        where: Column -> value: only rows that have it are taken.
        gap: A pause of more than this begins a new trial [s].
        sampling: Puts each trial on a clock of this step [s], as :func:`bodyimage_kin.recordings.resample` does; None:
            samples stay where they are.
        variable: Name of the variable in a MATLAB file that holds several.
        decimal: What stands before the decimals in a text.
        join_within: Joint states on both sides of an observation in a bag must be this near in time [s].

    Returns:
        The recording; what no recording has is left in the file.

    A scattered recording without blocks gets contiguous fifths of its rows.

    Raises:
        UnknownName: A column, variable or joint that there is not.
        InvalidConfig: Arguments that do not fit together, or arguments of tables with a NetCDF file.
        MissingDependency: A Parquet file, without pyarrow; a bag, without rosbags.
        InvalidRecording: A file that is missing, is no NetCDF, claims to hold more than a GiB, lacks a variable or
            holds something else in one.
    """
    options: dict[str, Any] = {
        "units": units, "order": order, "size": size, "unseen": unseen, "gap": gap, "sampling": sampling,
    }  # fmt: skip
    if is_bag(Path(path)) and Path(path).exists():
        if variable is not None or where is not None:
            raise InvalidConfig("variable and where are of tables; of a bag give topics in columns")
        return _from_bag(Path(path), columns, robot, joints, join_within, **options)
    if not Path(path).is_file():
        raise InvalidRecording(f"there is no recording at '{path}'")
    if Path(path).suffix.lower() in TABLES:
        table = table_for(Path(path), columns, variable, decimal)
        return recording_of(table, columns, robot=robot, joints=joints, where=where, **options)
    of_tables: dict[str, object] = {
        "columns": columns, "units": units, "robot": robot, "joints": joints, "order": order, "size": size,
        "unseen": unseen or None, "where": where, "gap": gap, "sampling": sampling, "variable": variable,
    }  # fmt: skip
    if given := [name for name, value in of_tables.items() if value is not None]:
        raise InvalidConfig(f"{given[0]}: this is of tables ({', '.join(TABLES)}); '{Path(path).name}' is none")
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
    for stored_variable in recording.variables.values():
        stored_variable.attrs = decoded(stored_variable.attrs)
    return with_blocks(check(recording))


def _from_bag(
    path: Path,
    topics: Columns | None,
    robot: Robot | Embodiment | None,
    joints: Sequence[str] | None,
    join_within: float | int,
    **options: Any,
) -> xr.Dataset:
    """A recording from a bag; of a robot's joints those are taken that the bag tells of."""
    within = _checks.number("join_within", join_within, above=0.0)
    body = robot if isinstance(robot, Embodiment) else None
    if joints is None and body is not None:
        joints = body.joints
    table, columns = read_bag(path, topics, joints=joints, width=None if body is None else body.m, join_within=within)
    if joints is None and isinstance(robot, Robot):
        columns["q"] = {name: column for name, column in columns["q"].items() if name in robot.joint_names}
    return recording_of(table, columns, robot=robot, **options)


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
