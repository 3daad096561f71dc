"""From the columns of a table to a recording: names and units said once, and what people get wrong found.

A laboratory's file speaks degrees, millimetres and its own names, and somewhere in it a row stands twice or a clock
runs back. All of that is looked for here, and said with the row and the column where it stands.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int

from bodyimage_kin import _checks
from bodyimage_kin.body import Embodiment
from bodyimage_kin.errors import DataWarning, InvalidConfig, InvalidRecording, UnknownName
from bodyimage_kin.recordings.from_arrays import recording
from bodyimage_kin.recordings.tables import MOST_ROWS, Table, matching, read_table
from bodyimage_kin.robot import Robot

__all__ = ["Column", "Columns", "read_columns"]

Column: TypeAlias = str | int
"""A column's name, or where it stands (from 0)."""
Columns: TypeAlias = Mapping[str, "Column | Sequence[Column] | Mapping[str, Column]"]
"""Variable of a recording -> its columns: a name, a list in order, joint -> name, or a pattern with one ``*``."""

_FACTORS: Mapping[str, Mapping[str, float]] = {
    "q": {"rad": 1.0, "deg": math.pi / 180, "m": 1.0, "mm": 1e-3},
    "hand_image": {"m": 1.0, "mm": 1e-3, "px": 1.0},
    "hand_position": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "hand_offset": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
}
"""Variable -> unit of a file -> what its numbers are multiplied by."""
_FLOATS = ("q", "hand_image", "hand_position", "hand_offset", "time", "trial", "block", "repeat", "at_reference")
_LISTS = ("touched", "intensity")
_PARTS = ("q", "hand_image", "hand_position", "hand_offset")
_FAR = 50.0
"""No hand is farther away than this [m]: a file that says so speaks millimetres."""
_SLACK = 0.1
"""How far beyond a joint's limit a felt value may be, over the joint's range, before it is taken for one in degrees."""
_JUMP = math.pi
"""Median step of a stream [rad] beyond which its joints are taken for ones in degrees."""
_GAP = 20.0
"""A pause of so many median steps is told."""


def read_columns(
    path: Path,
    columns: Columns | None = None,
    *,
    units: Mapping[str, str] | None = None,
    robot: Robot | Embodiment | None = None,
    joints: Sequence[str] | None = None,
    order: Literal["stream", "scattered"] | str | None = None,
    size: Sequence[int] | None = None,
    unseen: Sequence[float | int] = (),
    where: Mapping[Column, float | int | str] | None = None,
    gap: float | int | None = None,
    variable: str | None = None,
    decimal: str = ".",
    most_rows: int = MOST_ROWS,
) -> xr.Dataset:
    """A recording from a table; :func:`bodyimage_kin.read_recording` says what each argument is."""
    by_position = columns is not None and all(isinstance(one, int) for one in _named(columns))
    table = read_table(path, by_position=by_position, variable=variable, decimal=decimal, most_rows=most_rows)
    known = robot.robot if isinstance(robot, Embodiment) else robot
    chosen = _choose(table, _guess(table, known) if columns is None else columns, joints, known)
    units = _checked_units(units or {}, chosen)
    look = _Look(table, chosen, np.flatnonzero(_kept(table, where)), units)
    values = {name: look.values(name) for name in _FLOATS if name in chosen}
    lists = {name: look.lists(name) for name in _LISTS if name in chosen}
    if "hand_image" in values:
        values["hand_image"] = _seen(values["hand_image"], unseen)
        look.at_the_image(values["hand_image"], size)
    order = _checks.choice("order", order or _order(table, values, gap), ("stream", "scattered"))
    look.at_postures(values["q"], known, order)
    look.at_distances(values)
    trial = look.trials(values, order, gap)
    look.at_doubled_rows(values, lists, order)
    unit = robot.camera.model.unit if isinstance(robot, Embodiment) else "px"
    return _assembled(table, chosen, values, lists, trial, order, units, unit)


# What the columns are ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Part:
    """The columns of one variable of a recording.

    Attributes:
        columns: Their names in the table, in order.
        labels: What each is of: a joint, an axis.
    """

    columns: tuple[str, ...]
    labels: tuple[str, ...]


_Chosen: TypeAlias = dict[str, _Part]


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


def _choose(table: Table, columns: Columns, joints: Sequence[str] | None, robot: Robot | None) -> _Chosen:
    chosen: _Chosen = {}
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
        part = _Part(part.columns, tuple(joints))
    if doubled := sorted({name for name in part.labels if part.labels.count(name) > 1}):
        raise InvalidConfig(f"columns: joint {doubled[0]!r} is named twice; give each joint one column")
    for name in part.labels if robot is not None else ():
        if name not in robot.joint_names:  # type: ignore[union-attr]
            raise UnknownName("joint", name, robot.joint_names)  # type: ignore[union-attr]
    chosen["q"] = part
    return chosen


def _part(table: Table, variable: str, given: Column | Sequence[Column] | Mapping[str, Column]) -> _Part:
    if isinstance(given, Mapping):
        labels, wanted = tuple(map(str, given)), list(given.values())
    elif isinstance(given, str) and "*" in given and given not in table.columns:
        found = matching(list(table.columns), given)
        if not found:
            raise UnknownName(f"column of '{table.name}' like", given, table.columns)
        return _Part(tuple(found.values()), tuple(found))
    else:
        wanted = [given] if isinstance(given, str | int) else list(given)
        labels = tuple(map(str, wanted))
    if not wanted or (variable not in ("q", "hand_image", *_LISTS) and len(wanted) != _width(variable)):
        raise InvalidConfig(f"columns: {variable} has {len(wanted)} columns; give {_width(variable)}")
    columns = tuple(str(one) for one in wanted)
    for column in columns:
        if variable not in _LISTS:
            _ = table[column]
    return _Part(columns, labels)


def _width(variable: str) -> int:
    return 3 if variable in ("hand_position", "hand_offset") else 1


def _checked_units(units: Mapping[str, str], chosen: _Chosen) -> dict[str, str]:
    for variable, unit in units.items():
        if variable not in _FACTORS:
            raise UnknownName("variable with a unit", variable, _FACTORS)
        if variable not in chosen:
            raise InvalidConfig(f"units: the recording gets no {variable}; name its columns, or leave its unit out")
        _checks.choice(f"units[{variable!r}]", unit, _FACTORS[variable])
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


# What is wrong with them ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Look:
    """Values of the rows that are kept, and what people get wrong in them.

    Attributes:
        table: The table.
        chosen: Which columns are meant.
        rows: (kept,) rows of the table.
        units: As they were given.
    """

    table: Table
    chosen: _Chosen
    rows: Int[np.ndarray, "kept"]
    units: Mapping[str, str]

    def values(self, variable: str) -> Float[np.ndarray, "kept width"]:
        """Numbers of a variable, in our units."""
        columns = [self.table.floats(column)[self.rows] for column in self.chosen[variable].columns]
        unit = self.units.get(variable)
        factor = 1.0 if unit is None else _FACTORS[variable][unit]
        return np.stack(columns, axis=1) * factor

    def lists(self, variable: str) -> list[Float[np.ndarray, "values"]]:
        """What each row lists: of one column that holds lists, or of several columns."""
        columns = [self.table.lists(column) for column in self.chosen[variable].columns]
        return [np.concatenate([column[row] for column in columns]) for row in self.rows]

    def place(self, kept: int, variable: str, index: int = 0) -> str:
        """Where a value stands in the file."""
        return self.table.place(int(self.rows[kept]), self.chosen[variable].columns[index])

    def at_the_image(self, image: Float[np.ndarray, "kept m"], size: Sequence[int] | None) -> None:
        """Raises InvalidRecording where an image is outside the sensor."""
        if size is None:
            return
        limits = np.resize(_checks.numbers_of("size", size, 2, above=0.0), image.shape[1])
        with np.errstate(invalid="ignore"):
            outside = np.argwhere((image < 0) | (image > limits))
        if len(outside):
            row, axis = outside[0].tolist()
            raise InvalidRecording(
                f"{self.place(row, 'hand_image', axis)}: {image[row, axis]:g} is outside the image of "
                f"{size[0]} x {size[1]} ({len(outside)} such values); mend it, or say with unseen= what means unseen"
            )

    def at_postures(self, q: Float[np.ndarray, "kept joint"], robot: Robot | None, order: str) -> None:
        """Raises where joints seem to be in degrees and no unit was given; warns of joints that never move."""
        names = self.chosen["q"].labels
        if not np.isfinite(q).all(1).any():
            raise InvalidRecording(f"'{self.table.name}': no row has a value of every joint")
        if "q" not in self.units:
            self._refuse_degrees(q, robot, order)
        still = [
            name for name, spread in zip(names, np.nanmax(q, axis=0) - np.nanmin(q, axis=0), strict=True) if not spread
        ]
        if len(still) == len(names):
            raise InvalidRecording(f"'{self.table.name}': no joint moves; nothing can be learned from it")
        if still:
            _warn(f"'{self.table.name}': joint {', '.join(map(repr, still))} never moves")

    def _refuse_degrees(self, q: Float[np.ndarray, "kept joint"], robot: Robot | None, order: str) -> None:
        remedy = "if it is in degrees give units={'q': 'deg'}, else units={'q': 'rad'}"
        for index, name in enumerate(self.chosen["q"].labels):
            values = np.where(np.isfinite(q[:, index]), q[:, index], 0.0)
            if robot is not None:
                joint = robot.joint_index(name)
                lower, upper = float(robot.lower[joint]), float(robot.upper[joint])
                beyond = np.maximum(lower - values, values - upper)
                limit = _SLACK * (upper - lower)
            else:
                lower = upper = math.nan
                beyond, limit = np.abs(values), 4 * math.pi
            if math.isfinite(limit) and (worst := int(beyond.argmax())) is not None and beyond[worst] > limit:
                told = f"beyond its limits {lower:g} to {upper:g}" if robot is not None else "two turns and more"
                raise InvalidRecording(
                    f"{self.place(worst, 'q', index)}: joint '{name}' is {values[worst]:g}, {told}; {remedy}"
                )
        steps = np.abs(np.diff(q, axis=0)).max(1) if order == "stream" and len(q) > 1 else np.zeros(1)
        if np.isfinite(steps).any() and np.nanmedian(steps) > _JUMP:
            raise InvalidRecording(
                f"'{self.table.name}': joints jump by {np.nanmedian(steps):.3g} from row to row (median); {remedy}; "
                "rows that do not follow each other in time need order='scattered'"
            )

    def at_distances(self, values: Mapping[str, np.ndarray]) -> None:
        """Raises where lengths seem to be in millimetres and no unit was given."""
        for variable, far in (("hand_position", _FAR), ("hand_offset", 1.0)):
            if variable in values and variable not in self.units:
                found = np.argwhere(np.abs(np.nan_to_num(values[variable])) > far)
                if len(found):
                    row, axis = found[0].tolist()
                    raise InvalidRecording(
                        f"{self.place(row, variable, axis)}: {values[variable][row, axis]:g} m is too far for a hand; "
                        f"if it is in millimetres give units={{{variable!r}: 'mm'}}, else units={{{variable!r}: 'm'}}"
                    )

    def trials(self, values: Mapping[str, np.ndarray], order: str, gap: float | int | None) -> Int[np.ndarray, "kept"]:
        """Number of each row's trial: from a column, from gaps in time, or one.

        Raises:
            InvalidRecording: Time that goes backwards within a trial.
            InvalidConfig: Trials of a scattered recording, or gaps without a time.
        """
        trial = np.zeros(len(self.rows), dtype=np.int64)
        if order == "scattered":
            if "trial" in values or gap is not None:
                raise InvalidConfig(
                    "a scattered recording is one trial; give what divides it as columns={'block': ...}"
                )
            return trial
        if "trial" in values:
            trial = np.unique(values["trial"][:, 0], return_inverse=True)[1].astype(np.int64)
        if "time" not in values:
            if gap is not None:
                raise InvalidConfig("gap: there is no column of time; name it in columns")
            return trial
        time = values["time"][:, 0]
        for number in range(trial.max() + 1):
            inside = np.flatnonzero(trial == number)
            steps = np.diff(time[inside])
            wrong = np.flatnonzero(~(steps > 0))
            if len(wrong):
                row = int(inside[wrong[0] + 1])
                what = "stands still" if steps[wrong[0]] == 0 else "goes backwards"
                raise InvalidRecording(
                    f"{self.place(row, 'time')}: time {what} ({time[row]:g} after {time[inside[wrong[0]]]:g}); sort "
                    "the rows, name the column that tells trials apart, or give order='scattered'"
                )
            pauses = inside[1:][steps > _GAP * np.median(steps)] if len(steps) else inside[:0]
            if gap is None and len(pauses):
                _warn(
                    f"{self.place(int(pauses[0]), 'time')}: a gap before it ({len(pauses)} such); give gap= [s] to "
                    "begin a new trial after each"
                )
        if gap is not None:
            least = _checks.number("gap", gap, above=0.0)
            begins = np.concatenate([[True], (np.diff(time) > least) | (np.diff(trial) != 0)])
            trial = np.cumsum(begins) - 1
        return trial

    def at_doubled_rows(
        self, values: Mapping[str, np.ndarray], lists: Mapping[str, Sequence[np.ndarray]], order: str
    ) -> None:
        """Warns of rows that are there twice."""
        parts = [values[name] for name in ("q", "hand_image", "hand_position", "time") if name in values]
        rows = np.nan_to_num(np.concatenate(parts, axis=1), nan=np.inf)
        _, first, count = np.unique(rows, axis=0, return_index=True, return_counts=True)
        doubled = np.sort(first[count > 1])
        if "touched" in lists:
            return  # a posture that is touched twice is a repeat, and no mistake
        if len(doubled):
            _warn(f"{self.place(int(doubled[0]), 'q')}: this row stands {count.max()} times ({len(doubled)} such rows)")


def _warn(message: str) -> None:
    warnings.warn(message, DataWarning, stacklevel=5)


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")


# The recording -------------------------------------------------------------------------------------------------------


def _assembled(
    table: Table,
    chosen: _Chosen,
    values: Mapping[str, np.ndarray],
    lists: Mapping[str, Sequence[np.ndarray]],
    trial: Int[np.ndarray, "kept"],
    order: str,
    units: Mapping[str, str],
    unit: str,
) -> xr.Dataset:
    """The recording, one array a trial."""
    count = int(trial.max()) + 1
    rows = [np.flatnonzero(trial == number) for number in range(count)]

    def of(flat: np.ndarray | list[list[Any]]) -> Any:
        parts = [[flat[row] for row in one] if isinstance(flat, list) else flat[one] for one in rows]
        return parts[0] if count == 1 else parts

    given: dict[str, Any] = {name: of(values[name]) for name in _PARTS if name in values and name != "q"}
    for name in ("block", "repeat"):
        if name in values:
            given[name] = of(_whole(table, chosen, name, values[name][:, 0]))
    if "at_reference" in values:
        given["at_reference"] = of(np.nan_to_num(values["at_reference"][:, 0]) != 0)
    if "time" in values and count == 1 and order == "stream":
        given["time"] = values["time"][:, 0]
    if "touched" in lists:
        given["touched"] = of([taxels.astype(np.int64).tolist() for taxels in lists["touched"]])
    if "intensity" in lists:
        given["intensity"] = of([one.tolist() for one in lists["intensity"]])
    if "hand_image" in values:
        said = units.get("hand_image", unit)
        given["unit"] = "m" if said == "mm" else said
    return recording(of(values["q"]), joints=list(chosen["q"].labels), order=order, origin=table.name, **given)


def _whole(table: Table, chosen: _Chosen, name: str, values: Float[np.ndarray, "kept"]) -> Int[np.ndarray, "kept"]:
    if not (values == np.round(values)).all():
        raise InvalidRecording(f"'{table.name}': column '{chosen[name].columns[0]}' ({name}) holds no whole numbers")
    return values.astype(np.int64)
