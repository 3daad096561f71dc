"""Recordings of one's own: arrays, lists or columns of a table, checked and put into the schema."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Float, Shaped

from bodyimage_kin import _checks
from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin.errors import InvalidRecording, UnknownName
from bodyimage_kin.recordings.schema import (
    OBSERVATIONS,
    ORDERS,
    TRUE,
    VARIABLES,
    WHOLE,
    assemble,
    check,
    normalised,
    with_blocks,
)

__all__ = ["Values", "recording"]

Values: TypeAlias = ArrayLike | pd.DataFrame
"""One trial, ``(time, ...)``; several, ``(trial, time, ...)`` or a list with an array a trial."""
_NAMES = ("x", "y", "z")


def recording(
    q: Values,
    hand_image: Values | None = None,
    *,
    joints: Sequence[str] | None = None,
    order: str = "stream",
    unit: str | None = None,
    axes: Sequence[str] | None = None,
    touched: Values | None = None,
    intensity: Values | None = None,
    hand_position: Values | None = None,
    hand_offset: Values | None = None,
    at_reference: Values | None = None,
    reference_image: ArrayLike | None = None,
    block: Values | None = None,
    repeat: Values | None = None,
    sampling: float | None = None,
    time: ArrayLike | None = None,
    joint_units: str | Sequence[str] = "rad",
    encoder_noise: float | None = None,
    image_noise: float | None = None,
    origin: str = "",
    **truth: Values,
) -> xr.Dataset:
    """A recording from arrays, lists or data frames: postures and at least one observation of the hand.

    One trial is an array with a row a sample; several are an array with a first axis for them, or a list of arrays,
    which may differ in length. What is said of samples comes in the same form as ``q``.

    Args:
        q: (time, joint) felt joint values [rad or m]; a data frame names its joints by its columns.
        hand_image: (time, axis) what a camera reports of the hand, in ``unit``; NaN where it is unseen. A data frame
            names its axes.
        joints: Names of the joints, in the order of ``q``; of a data frame, the columns to take.
        order: ``"stream"``, samples one after the other in time, or ``"scattered"``, postures in no order.
        unit: Of the hand image: ``"px"``, ``"m"``.
        axes: Names of the image's coordinates; x, y, z where nothing is said.
        touched: (time,) or (time, contact) taxels that report a touch, -1 for none; or a list with a list of taxels, a
            single one or None a sample.
        intensity: Of each of these touches, in the same form.
        hand_position: (time, 3) a tracker's point, in the tracker's frame [m].
        hand_offset: (time, 3) the observed point in the hand's link [m]; (3,) where it is one.
        at_reference: (time,) whether the hand rests at a place whose image is known.
        reference_image: (axis,) that image.
        block: (time,) number of the block that each sample is held out with. A scattered recording gets contiguous
            fifths of its rows where none are given.
        repeat: (time,) number of the posture that each sample repeats, -1 for none.
        sampling: Time between the samples of a stream [s].
        time: (time,) of each sample [s], going forward; or dates.
        joint_units: ``"rad"``, ``"m"``, or one a joint.
        encoder_noise: Standard deviation of what is felt of a joint, where it is known [rad or m].
        image_noise: Of each coordinate of the hand image [unit].
        origin: Where the recording comes from, in words.
        truth: A simulator's own ``true_q``, ``true_hand_image``, ``true_hand_position``, ``true_touched``.

    Returns:
        The recording; :mod:`bodyimage_kin.recordings.schema` says what is in it.

    Raises:
        InvalidRecording: Nothing observed, arrays that do not fit each other, values that are no numbers; names the
            variable and the row.
    """
    scattered = _checks.choice("order", order, ORDERS, error=InvalidRecording) == "scattered"
    for name in truth:
        if name not in TRUE:
            raise UnknownName("argument of recording()", name, (*inspect.signature(recording).parameters, *TRUE))
    samples = {
        "hand_image": hand_image, "touched": touched, "intensity": intensity, "hand_position": hand_position,
        "hand_offset": hand_offset, "at_reference": at_reference, "block": block, "repeat": repeat, **truth,
    }  # fmt: skip
    given = {name: value for name, value in samples.items() if value is not None}
    if not any(name in given for name in OBSERVATIONS):
        raise InvalidRecording(f"nothing is observed beside q; give one of {', '.join(OBSERVATIONS)}")
    postures, names = _postures(q, joints)
    trials = _Trials(_is_many(q), [len(rows) for rows in postures])
    variables = {"q": trials.padded(postures, np.nan)}
    variables |= {name: trials.read(name, value) for name, value in given.items()}
    if reference_image is not None:
        variables["reference_image"] = as_float_array(reference_image, "reference_image", error=InvalidRecording)
    if scattered:
        _check_scattered(variables["q"], sampling, time)
    _fit_contacts(variables)
    _check_widths(variables, names)
    units = {"q": _joint_units(joint_units, names)}
    found = _axes(variables, axes, hand_image)
    if found:
        if unit is None:
            raise InvalidRecording("unit: say what the hand image is in, such as unit='px' or unit='m'")
        units["hand_image"] = _checks.text("unit", unit, error=InvalidRecording)
    times, unit_of_time = _time(trials.longest, sampling, time)
    attributes: dict[str, Any] = {"order": order}
    for name, value in {"encoder_noise": encoder_noise, "image_noise": image_noise}.items():
        if value is not None:
            attributes[name] = _checks.number(name, value, least=0.0, error=InvalidRecording)
    if sampling is not None:
        attributes["sampling"] = float(sampling)
    if origin:
        attributes["origin"] = _checks.text("origin", origin, error=InvalidRecording)
    units["time"] = unit_of_time
    made = assemble(variables, joints=names, axes=found, time=times, units=units, attributes=attributes)
    return with_blocks(check(made))


# Values of samples ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Trials:
    """How many samples each trial has, and whether values come with an axis for trials."""

    many: bool
    lengths: Sequence[int]

    @property
    def longest(self) -> int:
        return max(self.lengths)

    def read(self, name: str, value: Values) -> Shaped[np.ndarray, "trial time ..."]:
        """A variable, padded."""
        dims = VARIABLES[name][2:]
        if dims == ("space",) and np.ndim(value) == 1 and len(value) == len(_NAMES):
            value = [np.tile(as_float_array(value, name, error=InvalidRecording), (n, 1)) for n in self.lengths]
            parts = value
        else:
            parts = list(value) if self.many else [value]
        if len(parts) != len(self.lengths):
            raise InvalidRecording(f"{name} has {len(parts)} trials, q has {len(self.lengths)}")
        padding = False if name == "at_reference" else -1 if name in WHOLE else np.nan
        if dims == ("contact",):
            rows = [_contacts(name, part, padding) for part in parts]
        else:
            rows = [_table(name, part) if dims else _column(name, part) for part in parts]
        for trial, (row, length) in enumerate(zip(rows, self.lengths, strict=True)):
            if len(row) != length:
                where = f" in trial {trial}" if self.many else ""
                raise InvalidRecording(f"{name} has {len(row)} rows{where}, q has {length}; give one a posture")
        return self.padded(rows, padding)

    def padded(self, rows: Sequence[Shaped[np.ndarray, "..."]], padding: float | int) -> Shaped[np.ndarray, "..."]:
        """Trials of unlike length, and of unlike numbers of contacts, as one array."""
        shape = np.max([row.shape[1:] for row in rows], axis=0).astype(int)
        found = np.full((len(rows), self.longest, *shape), padding, dtype=rows[0].dtype)
        for place, row in zip(found, rows, strict=True):
            place[tuple(slice(length) for length in row.shape)] = row
        return found


def _is_many(q: Values) -> bool:
    """Whether there is a list or an axis of trials."""
    if isinstance(q, list | tuple) and any(isinstance(one, pd.DataFrame) for one in q):
        return True
    if isinstance(q, list | tuple) and q and all(hasattr(one, "ndim") and one.ndim == 2 for one in q):
        return True
    return not isinstance(q, pd.DataFrame) and as_float_array(q, "q", error=InvalidRecording).ndim == 3


def _postures(q: Values, joints: Sequence[str] | None) -> tuple[list[Float[np.ndarray, "time joint"]], tuple[str, ...]]:
    """Postures of each trial, and the joints' names."""
    parts = list(q) if _is_many(q) else [q]
    if joints is None:
        if not isinstance(parts[0], pd.DataFrame):
            raise InvalidRecording("joints: name the joints of q, in its order: joints=[...]")
        joints = list(parts[0].columns)
    if isinstance(joints, str) or not all(isinstance(name, str) and name for name in joints):
        raise InvalidRecording(f"joints: {joints!r} are no names; give a list of texts")
    rows = []
    for part in parts:
        if isinstance(part, pd.DataFrame):
            for name in joints:
                if name not in part.columns:
                    raise UnknownName("column of q", name, map(str, part.columns))
            part = part[list(joints)]
        rows.append(_table("q", part))
    if not all(len(row) for row in rows):
        raise InvalidRecording("q has no rows")
    return rows, tuple(joints)


def _table(name: str, value: Values) -> Float[np.ndarray, "time width"]:
    array = as_float_array(value, name, error=InvalidRecording)
    if array.ndim != 2:
        raise InvalidRecording(f"{name} has shape {array.shape}; give a row a sample")
    return array


def _column(name: str, value: Values) -> Shaped[np.ndarray, "time"]:
    array = np.asarray(value)
    if array.ndim != 1:
        raise InvalidRecording(f"{name} has shape {array.shape}; give one value a sample")
    return normalised(name, array)


def _contacts(name: str, value: Values, padding: float | int) -> Shaped[np.ndarray, "time contact"]:
    """What is said of touches, a row a sample: of an array, or of lists of unlike length."""
    if not isinstance(value, list | tuple | pd.Series):
        array = normalised(name, np.asarray(value))
        if array.ndim not in (1, 2):
            raise InvalidRecording(f"{name} has shape {array.shape}; give (time,), (time, contact), or lists of taxels")
        return array[:, None] if array.ndim == 1 else array
    cells = [_cell(name, sample, cell) for sample, cell in enumerate(value)]
    found = np.full((len(cells), max([1, *map(len, cells)])), padding, dtype=np.int64 if name in WHOLE else np.float64)
    for row, cell in zip(found, cells, strict=True):
        row[: len(cell)] = cell
    return found


def _cell(name: str, sample: int, cell: object) -> Shaped[np.ndarray, "contact"]:
    """The touches of one sample."""
    if cell is None or (isinstance(cell, float) and np.isnan(cell)):
        return np.empty(0)
    try:
        array = np.atleast_1d(np.asarray(cell))
        values = normalised(name, array if array.size else np.empty(0))
    except (InvalidRecording, ValueError) as problem:
        raise InvalidRecording(f"{name}, sample {sample}: {problem}") from None
    if values.ndim != 1:
        raise InvalidRecording(f"{name}, sample {sample}: give a taxel, a list of taxels, or None")
    return values


# What fits together --------------------------------------------------------------------------------------------------


def _check_scattered(q: Float[np.ndarray, "trial time joint"], sampling: object, time: object) -> None:
    if len(q) > 1:
        raise InvalidRecording("a scattered recording is one trial; put the rows of all into one array")
    if sampling is not None or time is not None:
        raise InvalidRecording("a scattered recording has no time; leave out sampling and time, or use order='stream'")
    unknown = np.flatnonzero(~np.isfinite(q[0]).all(1))
    if len(unknown):
        raise InvalidRecording(f"q is not finite in row {unknown[0]} (and {len(unknown) - 1} more); leave them out")


def _fit_contacts(variables: dict[str, Shaped[np.ndarray, "..."]]) -> None:
    """Pads what is said of touches to as many contacts as any sample has."""
    names = [name for name in variables if VARIABLES[name][-1] == "contact"]
    most = max((variables[name].shape[-1] for name in names), default=0)
    for name in names:
        values = variables[name]
        missing = [(0, 0), (0, 0), (0, most - values.shape[-1])]
        variables[name] = np.pad(values, missing, constant_values=-1 if name in WHOLE else np.nan)
    if "intensity" in names and not ("touched" in names and variables["touched"].shape == variables["intensity"].shape):
        raise InvalidRecording("intensity: give one for each of 'touched', in the same form")
    if "intensity" in names and (np.isfinite(variables["intensity"]) & (variables["touched"] < 0)).any():
        sample = int(np.argwhere(np.isfinite(variables["intensity"]) & (variables["touched"] < 0))[0, 1])
        raise InvalidRecording(f"intensity, sample {sample}: there is one where no taxel is touched")


def _check_widths(variables: dict[str, Shaped[np.ndarray, "..."]], joints: tuple[str, ...]) -> None:
    """Refuses variables of one dimension that differ in its length."""
    lengths: dict[str, tuple[int, str]] = {"joint": (len(joints), "joints"), "space": (3, "space")}
    for name, values in variables.items():
        dims = VARIABLES[name]
        if values.ndim != len(dims):
            raise InvalidRecording(f"{name} has shape {values.shape}; give {dims}")
        length, of = lengths.setdefault(dims[-1], (values.shape[-1], name))
        if len(dims) != 2 and length != values.shape[-1]:
            raise InvalidRecording(f"{name} has {values.shape[-1]} columns, but there are {length} of {of}")


def _axes(
    variables: dict[str, Shaped[np.ndarray, "..."]], axes: Sequence[str] | None, hand_image: Values | None
) -> tuple[str, ...]:
    """Names of the image's coordinates; none where there is no image."""
    widths = [values.shape[-1] for name, values in variables.items() if VARIABLES[name][-1] == "axis"]
    if not widths:
        return ()
    first = hand_image[0] if isinstance(hand_image, list | tuple) and len(hand_image) else hand_image
    if axes is None and isinstance(first, pd.DataFrame):
        axes = [str(name) for name in first.columns]
    if axes is None:
        axes = _NAMES[: widths[0]] if widths[0] <= len(_NAMES) else [f"image {place}" for place in range(widths[0])]
    if isinstance(axes, str) or len(axes) != widths[0] or not all(isinstance(name, str) for name in axes):
        raise InvalidRecording(f"axes: {axes!r} do not name the {widths[0]} coordinates of the hand image")
    return tuple(axes)


def _joint_units(units: str | Sequence[str], joints: tuple[str, ...]) -> str:
    each = [units] * len(joints) if isinstance(units, str) else list(units)
    if len(each) != len(joints):
        raise InvalidRecording(f"joint_units: {len(each)} units for {len(joints)} joints; give one, or one a joint")
    for unit in each:
        _checks.choice("joint_units", unit, ("rad", "m"), error=InvalidRecording)
    return each[0] if len(set(each)) == 1 else " ".join(each)


def _time(count: int, sampling: float | None, time: ArrayLike | None) -> tuple[Float[np.ndarray, "time"], str]:
    """Times of the samples, and their unit: a plain count where nothing is said."""
    if sampling is not None and time is not None:
        raise InvalidRecording("give sampling or time, not both")
    if sampling is not None:
        step = _checks.number("sampling", sampling, above=0.0, error=InvalidRecording)
        return np.round(np.arange(count) * step, 9), "s"
    if time is None:
        return np.arange(count, dtype=np.float64), ""
    given = np.asarray(time)
    if given.dtype.kind in "mM" and given.size:
        given = (given - (given[0] if given.dtype.kind == "M" else np.timedelta64(0))) / np.timedelta64(1, "s")
    times = as_float_array(given, "time", error=InvalidRecording)
    if times.shape != (count,):
        raise InvalidRecording(f"time has shape {times.shape}; give one for each of the {count} samples")
    return times, "s"
