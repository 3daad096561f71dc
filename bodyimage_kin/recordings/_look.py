"""What people get wrong in tables, found and said with the row and the column where it stands."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float, Int

from bodyimage_kin import _checks
from bodyimage_kin.errors import DataWarning, InvalidConfig, InvalidRecording
from bodyimage_kin.recordings.tables import Table
from bodyimage_kin.robot import Robot

FACTORS: Mapping[str, Mapping[str, float]] = {
    "q": {"rad": 1.0, "deg": math.pi / 180, "m": 1.0, "mm": 1e-3},
    "hand_image": {"m": 1.0, "mm": 1e-3, "px": 1.0},
    "hand_position": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "hand_offset": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
}
"""Variable -> unit of a file -> what its numbers are multiplied by."""
LENGTHS = ("m", "mm")
"""Units of joints that slide."""
Units: TypeAlias = Mapping[str, "str | Mapping[str, str]"]
"""Variable -> its unit in the file; of ``q`` also joint -> unit."""
_FAR = 50.0
"""No hand is farther away than this [m]: a file that says so speaks millimetres."""
_SLACK = 0.1
"""How far beyond a joint's limit a felt value may be, over the joint's range, before it is taken for one in degrees."""
_JUMP = math.pi
"""Median step of a stream [rad] beyond which its joints are taken for ones in degrees."""
_GAP = 20.0
"""A pause of so many median steps is told."""


@dataclass(frozen=True)
class Part:
    """The columns of one variable of a recording.

    Attributes:
        columns: Their names in the table, in order.
        labels: What each is of: a joint, an axis.
    """

    columns: tuple[str, ...]
    labels: tuple[str, ...]


Chosen: TypeAlias = dict[str, Part]
"""Variable of a recording -> its columns."""


@dataclass(frozen=True, eq=False)
class Look:
    """Values of the rows that are kept, and what people get wrong in them.

    Attributes:
        table: The table.
        chosen: Which columns are meant.
        rows: (kept,) rows of the table.
        units: As they were given.
        robot: Whose joints these are, where it is known.
    """

    table: Table
    chosen: Chosen
    rows: Int[np.ndarray, "kept"]
    units: Units
    robot: Robot | None

    def values(self, variable: str) -> Float[np.ndarray, "kept width"]:
        """Numbers of a variable, in our units."""
        part = self.chosen[variable]
        columns = [self.table.floats(column)[self.rows] for column in part.columns]
        factors = [1.0 if unit is None else FACTORS[variable][unit] for unit in self._units_of(variable)]
        return np.stack(columns, axis=1) * np.array(factors)

    def wholes(self, variable: str, values: Float[np.ndarray, "kept"]) -> Int[np.ndarray, "kept"]:
        """Whole numbers of a variable.

        Raises:
            InvalidRecording: A number that is none, or a cell that is empty.
        """
        wrong = np.flatnonzero(~(values == np.round(values)))
        if len(wrong):
            raise InvalidRecording(
                f"{self.place(int(wrong[0]), variable)}: {values[wrong[0]]:g} is no whole number; {variable} "
                "has one in each row"
            )
        return values.astype(np.int64)

    def joint_units(self) -> list[str]:
        """Our unit of each joint: metres where the robot says that it slides, or the file speaks of lengths."""
        return [
            "m" if unit in LENGTHS or (unit is None and self._slides(name)) else "rad"
            for name, unit in zip(self.chosen["q"].labels, self._units_of("q"), strict=True)
        ]

    def _slides(self, name: str) -> bool:
        return self.robot is not None and any(
            joint.name == name and joint.kind == "prismatic" for joint in self.robot.tree.joints
        )

    def _units_of(self, variable: str) -> list[str | None]:
        """Unit in the file of each column; None where nothing is said.

        Raises:
            InvalidConfig: A length of a joint that turns.
        """
        given, labels = self.units.get(variable), self.chosen[variable].labels
        if isinstance(given, Mapping):
            each = [given.get(name) for name in labels]
        else:
            # An angle said of all joints is said of those that turn.
            angles = variable == "q" and given not in (*LENGTHS, None)
            each = [None if angles and self._slides(name) else given for name in labels]
        if variable == "q" and self.robot is not None:
            for name, unit in zip(labels, each, strict=True):
                if unit is not None and (unit in LENGTHS) != self._slides(name):
                    what = "turns; its unit is 'rad' or 'deg'" if unit in LENGTHS else "slides; its unit is 'm' or 'mm'"
                    raise InvalidConfig(
                        f"units: {unit!r} of joint '{name}', which {what}; give joints units of their own: "
                        f"units={{'q': {{{name!r}: ...}}}}"
                    )
        return each

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
            outside = np.argwhere((image < -0.5) | (image > limits))
        if len(outside):
            row, axis = outside[0].tolist()
            raise InvalidRecording(
                f"{self.place(row, 'hand_image', axis)}: {image[row, axis]:g} is outside the image of "
                f"{size[0]} x {size[1]} ({len(outside)} such values); mend it, or say with unseen= what means unseen"
            )

    def at_postures(self, q: Float[np.ndarray, "kept joint"], order: str) -> None:
        """Raises where joints seem to be in degrees and no unit was given; warns of joints that never move."""
        names = self.chosen["q"].labels
        if not np.isfinite(q).all(1).any():
            raise InvalidRecording(f"'{self.table.name}': no row has a value of every joint")
        self._refuse_degrees(q, order)
        still = [
            name for name, spread in zip(names, np.nanmax(q, axis=0) - np.nanmin(q, axis=0), strict=True) if not spread
        ]
        if len(still) == len(names):
            raise InvalidRecording(f"'{self.table.name}': no joint moves; nothing can be learned from it")
        if still:
            _warn(f"'{self.table.name}': joint {', '.join(map(repr, still))} never moves")

    def _refuse_degrees(self, q: Float[np.ndarray, "kept joint"], order: str) -> None:
        """Raises where joints whose unit nobody said seem to be in another than ours."""
        units = self._units_of("q")
        for index, (name, unit) in enumerate(zip(self.chosen["q"].labels, units, strict=True)):
            if unit is not None:
                continue
            values = np.where(np.isfinite(q[:, index]), q[:, index], 0.0)
            if self.robot is not None:
                joint = self.robot.joint_index(name)
                lower, upper = float(self.robot.lower[joint]), float(self.robot.upper[joint])
                beyond = np.maximum(lower - values, values - upper)
                limit, told = _SLACK * (upper - lower), f"beyond its limits {lower:g} to {upper:g}"
            else:
                beyond, limit, told = np.abs(values), 4 * math.pi, "two turns and more"
            worst = int(beyond.argmax())
            if math.isfinite(limit) and beyond[worst] > limit:
                raise InvalidRecording(
                    f"{self.place(worst, 'q', index)}: joint '{name}' is {values[worst]:g}, {told}; "
                    f"{_remedy('mm', 'm') if self._slides(name) else _remedy('deg', 'rad')}"
                )
        turning = [index for index, unit in enumerate(units) if unit is None]
        steps = np.abs(np.diff(q[:, turning], axis=0)).max(1) if order == "stream" and len(q) > 1 and turning else []
        if np.isfinite(steps).any() and np.nanmedian(steps) > _JUMP:
            raise InvalidRecording(
                f"'{self.table.name}': joints jump by {np.nanmedian(steps):.3g} from row to row (median); "
                f"{_remedy('deg', 'rad')}; rows that do not follow each other in time need order='scattered'"
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
        parts = [values[name] for name in ("q", "hand_image", "hand_position", "time", "trial") if name in values]
        rows = np.nan_to_num(np.concatenate(parts, axis=1), nan=np.inf)
        _, first, count = np.unique(rows, axis=0, return_index=True, return_counts=True)
        doubled = np.sort(first[count > 1])
        if "touched" in lists:
            return  # a posture that is touched twice is a repeat, and no mistake
        if len(doubled):
            _warn(f"{self.place(int(doubled[0]), 'q')}: this row stands {count.max()} times ({len(doubled)} such rows)")


def _remedy(other: str, ours: str) -> str:
    words = {"deg": "degrees", "mm": "millimetres"}
    return f"if it is in {words[other]} give units={{'q': '{other}'}}, else units={{'q': '{ours}'}}"


def _warn(message: str) -> None:
    warnings.warn(message, DataWarning, stacklevel=5)
