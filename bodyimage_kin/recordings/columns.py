"""From the columns of a table to a recording: names and units said once, and what people get wrong found.

A laboratory's file speaks degrees, millimetres and its own names, and somewhere in it a row stands twice or a clock
runs back. All of that is looked for here, and said with the row and the column where it stands.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int

from bodyimage_kin import _checks
from bodyimage_kin.body import Embodiment
from bodyimage_kin.errors import InvalidConfig, InvalidRecording, UnknownName
from bodyimage_kin.recordings._look import FACTORS, Chosen, Look, Part, Units
from bodyimage_kin.recordings.from_arrays import recording
from bodyimage_kin.recordings.resampling import clock, interpolated, last_before
from bodyimage_kin.recordings.tables import Table, matching, read_table
from bodyimage_kin.robot import Robot

__all__ = ["Column", "Columns", "recording_of", "table_for"]

Column: TypeAlias = str | int
"""A column's name, or where it stands (from 0)."""
Columns: TypeAlias = Mapping[str, "Column | Sequence[Column] | Mapping[str, Column]"]
"""Variable of a recording -> its columns: a name, a list in order, joint -> name, or a pattern with one ``*``."""

_FLOATS = ("q", "hand_image", "hand_position", "hand_offset", "time", "trial", "block", "repeat", "at_reference")
_LISTS = ("touched", "intensity")
_PARTS = ("q", "hand_image", "hand_position", "hand_offset")


def table_for(path: Path, columns: Columns | None, variable: str | None = None, decimal: str = ".") -> Table:
    """The table of a file, its columns by position where these columns are given so."""
    by_position = columns is not None and all(isinstance(one, int) for one in _named(columns))
    return read_table(path, by_position=by_position, variable=variable, decimal=decimal)


def recording_of(
    table: Table,
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
) -> xr.Dataset:
    """A recording from a table that has been read; :func:`bodyimage_kin.read_recording` says what each argument is."""
    known = robot.robot if isinstance(robot, Embodiment) else robot
    chosen = _choose(table, _guess(table, known) if columns is None else columns, joints, known)
    units = _checked_units(units or {}, chosen)
    look = Look(table, chosen, np.flatnonzero(_kept(table, where)), units, known)
    values = {name: look.values(name) for name in _FLOATS if name in chosen}
    lists = {name: look.lists(name) for name in _LISTS if name in chosen}
    if "hand_image" in values:
        values["hand_image"] = _seen(values["hand_image"], unseen)
        look.at_the_image(values["hand_image"], size)
    order = _checks.choice("order", order or _order(table, values, gap), ("stream", "scattered"))
    look.at_postures(values["q"], order)
    look.at_distances(values)
    trial = look.trials(values, order, gap)
    look.at_doubled_rows(values, lists, order)
    unit = robot.camera.model.unit if isinstance(robot, Embodiment) else "px"
    if sampling is not None:
        if "time" not in values:
            raise InvalidConfig("sampling: there is no column of time to resample by; name it in columns")
        if order == "scattered":
            raise InvalidConfig("sampling: a scattered recording has no order in time; leave it out")
    return _assembled(look, values, lists, trial, order, unit, sampling)


# What the columns are ------------------------------------------------------------------------------------------------


def _named(columns: Columns) -> Iterator[Column]:
    for one in columns.values():
        if isinstance(one, Mapping):
            yield from one.values()
        elif isinstance(one, str | int):
            yield one
        else:
            yield from one


def _guess(table: Table, robot: Robot | None) -> Columns:
    """Columns that bear a variable's name, ``q.NAME`` and the like, or the name of a joint of the robot."""
    found: dict[str, Sequence[str] | Mapping[str, str]] = {}
    names = list(table.columns)
    for variable in (*_FLOATS, *_LISTS):
        if variable in names:
            found[variable] = [variable]
        elif parts := matching(names, f"{variable}.*") or matching(names, f"{variable}_*"):
            found[variable] = parts if variable == "q" else list(parts.values())
    if "q" not in found and robot is not None:
        found["q"] = {joint: joint for joint in robot.joint_names if joint in names}
    if not found.get("q"):
        raise InvalidRecording(
            f"'{table.name}': no column is named as a joint (it has {_few(names)}); give columns={{'q': ...}}"
        )
    return found


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")


def _choose(table: Table, columns: Columns, joints: Sequence[str] | None, robot: Robot | None) -> Chosen:
    chosen: Chosen = {}
    for variable, given in columns.items():
        if variable not in (*_FLOATS, *_LISTS):
            raise UnknownName("variable of a recording", variable, (*_FLOATS, *_LISTS))
        chosen[variable] = _part(table, variable, given)
    if "q" not in chosen:
        raise InvalidConfig("columns: 'q' is missing; name the columns of the joints")
    part = chosen["q"]
    if joints is not None:
        if len(joints) != len(part.columns):
            raise InvalidConfig(f"joints: {len(joints)} names for {len(part.columns)} columns of q; give one each")
        part = Part(part.columns, tuple(joints))
    if doubled := sorted({name for name in part.labels if part.labels.count(name) > 1}):
        raise InvalidConfig(f"columns: joint {doubled[0]!r} is named twice; give each joint one column")
    for name in part.labels if robot is not None else ():
        if name not in robot.joint_names:  # type: ignore[union-attr]
            raise UnknownName("joint", name, robot.joint_names)  # type: ignore[union-attr]
    chosen["q"] = part
    return chosen


def _part(table: Table, variable: str, given: Column | Sequence[Column] | Mapping[str, Column]) -> Part:
    if isinstance(given, Mapping):
        labels, wanted = tuple(map(str, given)), list(given.values())
    elif isinstance(given, str) and "*" in given and given not in table.columns:
        found = matching(list(table.columns), given)
        if not found:
            raise UnknownName(f"column of '{table.name}' like", given, table.columns)
        return Part(tuple(found.values()), tuple(found))
    else:
        wanted = [given] if isinstance(given, str | int) else list(given)
        labels = tuple(map(str, wanted))
    if not wanted or (variable not in ("q", "hand_image", *_LISTS) and len(wanted) != _width(variable)):
        raise InvalidConfig(f"columns: {variable} has {len(wanted)} columns; give {_width(variable)}")
    columns = tuple(str(one) for one in wanted)
    for column in columns:
        if variable not in _LISTS:
            _ = table[column]
    return Part(columns, labels)


def _width(variable: str) -> int:
    return 3 if variable in ("hand_position", "hand_offset") else 1


def _checked_units(units: Units, chosen: Chosen) -> Units:
    for variable, unit in units.items():
        if variable not in FACTORS:
            raise UnknownName("variable with a unit", variable, FACTORS)
        if variable not in chosen:
            raise InvalidConfig(f"units: the recording gets no {variable}; name its columns, or leave its unit out")
        if variable == "q" and isinstance(unit, Mapping):
            for joint, one in unit.items():
                if joint not in chosen["q"].labels:
                    raise UnknownName("joint with a unit", joint, chosen["q"].labels)
                _checks.choice(f"units['q'][{joint!r}]", one, FACTORS["q"])
        else:
            _checks.choice(f"units[{variable!r}]", unit, FACTORS[variable])
    return dict(units)


def _kept(table: Table, where: Mapping[Column, float | int | str] | None) -> Bool[np.ndarray, "rows"]:
    """Rows in which each of these columns has its value."""
    kept = np.ones(table.rows, dtype=bool)
    for column, value in (where or {}).items():
        if isinstance(value, str):
            kept &= table[str(column)].astype(str) == value
        else:
            kept &= table.floats(str(column)) == _checks.number(f"where[{column!r}]", value)
    if not kept.any():
        raise InvalidRecording(f"'{table.name}': no row is left" + (f" where {dict(where)}" if where else ""))
    return kept


def _seen(image: Float[np.ndarray, "rows m"], unseen: Sequence[float | int]) -> Float[np.ndarray, "rows m"]:
    """NaN in every coordinate where one of them is missing, or all bear a number that stands for unseen."""
    missing = np.isnan(image).any(1)
    for value in _checks.numbers_of("unseen", unseen):
        missing |= (image == value).all(1)
    return np.where(missing[:, None], np.nan, image)


def _order(table: Table, values: Mapping[str, np.ndarray], gap: float | int | None) -> str:
    if "time" in values or gap is not None:
        return "stream"
    raise InvalidRecording(
        f"'{table.name}': nothing says whether successive rows follow each other in time; give order='stream' or "
        "order='scattered'"
    )


# The recording -------------------------------------------------------------------------------------------------------


def _assembled(
    look: Look,
    values: Mapping[str, np.ndarray],
    lists: Mapping[str, Sequence[np.ndarray]],
    trial: Int[np.ndarray, "kept"],
    order: str,
    unit: str,
    sampling: float | int | None,
) -> xr.Dataset:
    """The recording, one array a trial."""
    count = int(trial.max()) + 1
    rows = [np.flatnonzero(trial == number) for number in range(count)]
    flat: dict[str, Any] = {name: values[name] for name in _PARTS if name in values}
    flat |= {name: look.wholes(name, values[name][:, 0]) for name in ("block", "repeat") if name in values}
    if "at_reference" in values:
        flat["at_reference"] = np.nan_to_num(values["at_reference"][:, 0]) != 0
    if "touched" in lists:
        flat["touched"] = [taxels.astype(np.int64).tolist() for taxels in lists["touched"]]
    if "intensity" in lists:
        flat["intensity"] = [one.tolist() for one in lists["intensity"]]
    trials = [
        {name: [one[row] for row in place] if isinstance(one, list) else one[place] for name, one in flat.items()}
        for place in rows
    ]
    given: dict[str, Any] = {}
    if "time" in values and order == "stream":
        times = [values["time"][place, 0] for place in rows]
        if sampling is not None:
            given["sampling"] = sampling
            trials = [_on_a_clock(one, time, sampling) for one, time in zip(trials, times, strict=True)]
        elif count == 1:
            given["time"] = times[0]
        elif (step := _equal_steps(times)) is not None:
            given["sampling"] = step
    given |= {name: trials[0][name] if count == 1 else [one[name] for one in trials] for name in flat}
    if "hand_image" in values:
        said = look.units.get("hand_image", unit)
        given["unit"] = "m" if said == "mm" else said
    labels = list(look.chosen["q"].labels)
    return recording(
        given.pop("q"), joints=labels, order=order, origin=look.table.name, joint_units=look.joint_units(), **given
    )


def _on_a_clock(trial: Mapping[str, Any], time: Float[np.ndarray, "samples"], sampling: float | int) -> dict[str, Any]:
    """A trial's values at equal times; see :func:`bodyimage_kin.recordings.resample`."""
    wanted, bridged = clock(time, sampling)
    before, known = last_before(time, wanted, bridged)
    found: dict[str, Any] = {}
    for name, values in trial.items():
        if isinstance(values, list):
            found[name] = [values[row] if there else [] for row, there in zip(before, known, strict=True)]
        elif values.dtype.kind == "f":
            found[name] = interpolated(time, values, wanted, bridged)
        else:
            found[name] = np.where(known, values[before], False if values.dtype.kind == "b" else -1)
    return found


def _equal_steps(times: Sequence[Float[np.ndarray, "..."]]) -> float | None:
    """The time between samples where it is the same throughout, to a hundredth; several trials have no other time."""
    steps = np.concatenate([np.diff(time) for time in times])
    usual = float(np.median(steps)) if len(steps) else 0.0
    return usual if usual > 0.0 and (np.abs(steps - usual) <= 0.01 * usual).all() else None
