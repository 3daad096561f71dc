"""What a recording is: one xarray.Dataset, what is felt beside a simulator's truth.

Dimensions ``(trial, time, joint | axis | space | contact)``; shorter trials are padded (numbers NaN, taxels and counts
-1, ``at_reference`` false). Only ``q`` and one observation are always there.

============================ =========================================================================================
felt
``q``                        (trial, time, joint) felt joint values [rad or m] (equation 3)
``hand_image``               (trial, time, axis) what the camera reports of the hand, in its unit; NaN unseen
``touched``                  (trial, time, contact) taxels that report a touch at once, padded -1
``hand_position``            (trial, time, space) a tracker's point, in the tracker's own frame [m]
``intensity``                (trial, time, contact) of each touch
``at_reference``             (trial, time) whether the hand rests at the reference taxel
``reference_image``          (axis,) image of the hand there, known beforehand
``hand_offset``              (trial, time, space) the observed point in the hand's link [m], where it varies
``block``                    (trial, time) number of the block that is held out together
``repeat``                   (trial, time) number of the posture that is repeated, -1 for none
truth
``true_q``                   (trial, time, joint)
``true_hand_image``          (trial, time, axis) NaN only where the hand has no image
``true_hand_position``       (trial, time, space) the hand's centre in the root [m]
``true_touched``             (trial, time, contact) the taxels the hand is on, silent or not
============================ =========================================================================================

``q``, ``hand_image`` or ``hand_position`` or ``touched``: at least one of the three observations. The coordinate
``joint`` names the joints; ``time`` [s] goes forward. Attributes: ``order`` (``"stream"``, ordered in time, the
default, or ``"scattered"``, one trial of postures in no order, whose time is a plain count), ``sampling`` [s] where
there is one, ``encoder_noise`` and ``image_noise`` where they are stated, and where the recording comes from. Each
variable has its ``units``.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Hashable, Iterable, Mapping, Sequence
from importlib import metadata
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int, Shaped

from bodyimage_kin import _checks
from bodyimage_kin._arrays import as_float_array
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidRecording, UnknownName

__all__ = [
    "COORDINATES",
    "FELT",
    "OBSERVATIONS",
    "ORDERS",
    "TRUE",
    "VARIABLES",
    "WHOLE",
    "align",
    "assemble",
    "canonical_order",
    "check",
    "experience",
    "first_taxel",
    "is_scattered",
    "joint_names",
    "joint_units",
    "normalised",
    "require_aligned",
    "versions",
    "with_blocks",
    "without_truth",
]

_SAMPLE = ("trial", "time")
OBSERVATIONS = ("hand_image", "touched", "hand_position")
"""At least one of them makes a recording."""
FELT: Mapping[str, tuple[str, ...]] = {
    "q": (*_SAMPLE, "joint"),
    "hand_image": (*_SAMPLE, "axis"),
    "touched": (*_SAMPLE, "contact"),
    "hand_position": (*_SAMPLE, "space"),
    "intensity": (*_SAMPLE, "contact"),
    "at_reference": _SAMPLE,
    "reference_image": ("axis",),
    "hand_offset": (*_SAMPLE, "space"),
    "block": _SAMPLE,
    "repeat": _SAMPLE,
}
TRUE: Mapping[str, tuple[str, ...]] = {
    "true_q": (*_SAMPLE, "joint"),
    "true_hand_image": (*_SAMPLE, "axis"),
    "true_hand_position": (*_SAMPLE, "space"),
    "true_touched": (*_SAMPLE, "contact"),
}
VARIABLES: Mapping[str, tuple[str, ...]] = {**FELT, **TRUE}
"""Every variable a recording may have, and its dimensions."""
COORDINATES = ("trial", "time", "joint", "axis", "space", "contact")
WHOLE = ("touched", "block", "repeat", "true_touched")
"""Variables of whole numbers; all others but ``at_reference`` are float64."""
ORDERS = ("stream", "scattered")
_FIFTHS = 5
_PACKAGES = ("pin", "mujoco", "torch", "numpy", "scipy", "xarray")


def assemble(
    variables: Mapping[str, Shaped[np.ndarray, "..."]],
    *,
    joints: Sequence[str],
    axes: Sequence[str],
    time: Float[np.ndarray, "time"],
    units: Mapping[str, str],
    attributes: Mapping[str, Any],
) -> xr.Dataset:
    """The dataset of arrays that have the dimensions of the schema.

    Args:
        variables: Name -> array.
        joints: Names of the joints, in the order of ``q``.
        axes: Names of the image's coordinates; none without an image.
        time: Of the samples [s], or a plain count where no unit is given for it.
        units: Of ``q``, of ``hand_image`` and of ``time``.
        attributes: Order, sampling and origin; versions are added.
    """
    units = {**units, "hand_position": "m", "hand_offset": "m", "reference_image": units.get("hand_image", "")}
    found = {
        name: (
            VARIABLES[name],
            variables[name],
            {"units": unit} if (unit := units.get(name.removeprefix("true_"))) else {},
        )
        for name in VARIABLES
        if name in variables
    }
    used = {dim for dims, _, _ in found.values() for dim in dims}
    coords: dict[str, Any] = {
        "trial": np.arange(variables["q"].shape[0]),
        "time": ("time", time, {"units": units["time"]} if units.get("time") else {}),
        "joint": list(joints),
        "axis": list(axes),
        "space": ["x", "y", "z"],
    }
    recording = xr.Dataset(found, {name: values for name, values in coords.items() if name in used})
    return recording.assign_attrs(**attributes, versions=json.dumps(versions()))


def joint_units(body: Embodiment) -> str:
    """Unit of a body's felt joints: ``"rad"``, ``"m"``, or one a joint with spaces between."""
    kinds = {joint.name: joint.kind for joint in body.robot.tree.joints}
    units = ["m" if kinds[name] == "prismatic" else "rad" for name in body.joints]
    return units[0] if len(set(units)) == 1 else " ".join(units)


def versions() -> dict[str, str]:
    """Versions of the packages a result depends on."""
    return dict(_versions())


@functools.cache
def _versions() -> dict[str, str]:
    from bodyimage_kin import __version__

    # Of code that is edited where it lies, what the installer noted is not what runs.
    return {"bodyimage-kin": __version__, **{name: metadata.version(name) for name in _PACKAGES}}


def experience(recording: xr.Dataset) -> xr.Dataset:
    """The recording without the truth: all that a learner may ever see.

    Variables, coordinates, dimensions and attributes whose names begin with ``true_`` are dropped, whoever put them
    there.

    Raises:
        InvalidRecording: Not a recording; names what is wrong.
    """
    return without_truth(check(recording))


def without_truth(recording: xr.Dataset) -> xr.Dataset:
    """A dataset without what is named ``true_``, as of :func:`experience`, whatever else it lacks."""
    felt = recording.drop_dims(_true_ones(recording.dims))
    felt = felt.drop_vars(_true_ones(felt.variables)).copy()
    for attributes in (felt.attrs, *(variable.attrs for variable in felt.variables.values())):
        for name in _true_ones(attributes):
            del attributes[name]
    return felt


def _true_ones(names: Iterable[Hashable]) -> list[Hashable]:
    return [name for name in names if str(name).startswith("true_")]


def check(recording: xr.Dataset) -> xr.Dataset:
    """The recording itself, once it is known to be one; numbers of other kinds become those of the schema.

    float32, float16 and whole numbers become float64 where numbers are meant, whole numbers of any kind int64 where
    taxels and counts are (NaN becomes -1).

    Raises:
        InvalidRecording: Names the variable and what is wrong with it.
    """
    _refuse_other(recording)
    if "q" not in recording.data_vars:
        raise InvalidRecording("the recording has no variable 'q'")
    if not any(name in recording.data_vars for name in OBSERVATIONS):
        raise InvalidRecording(f"the recording has no observation beside 'q'; give one of {', '.join(OBSERVATIONS)}")
    changed = {}
    for name, dims in VARIABLES.items():
        if name not in recording.data_vars:
            continue
        variable = recording[name]
        if variable.dims != dims:
            raise InvalidRecording(f"variable '{name}' has dimensions {variable.dims}; it must have {dims}")
        if 0 in variable.shape:
            empty = dims[variable.shape.index(0)]
            what = "samples" if empty in _SAMPLE else f"'{empty}' of variable '{name}'"
            raise InvalidRecording(f"the recording has no {what}")
        values = normalised(name, variable.values)
        if values.dtype != variable.dtype:
            changed[name] = variable.copy(data=values)
    units = recording["q"].attrs.get("units", "rad")
    if not isinstance(units, str) or not set(units.split()) <= {"rad", "m"}:
        _checks.refuse("the unit of 'q'", units, "radians and metres: 'rad', 'm', or one a joint", InvalidRecording)
    _checks.choice("order", recording.attrs.get("order", "stream"), ORDERS, error=InvalidRecording)
    _check_coordinates(recording)
    return recording.assign(changed) if changed else recording


def _refuse_other(recording: object) -> None:
    if not isinstance(recording, xr.Dataset):
        raise InvalidRecording(f"a recording is an xarray.Dataset, not {type(recording).__name__}")


def normalised(name: str, values: Shaped[np.ndarray, "..."]) -> Shaped[np.ndarray, "..."]:
    """Values of a variable as the schema has them: float64, int64 or bool.

    Raises:
        InvalidRecording: Booleans, text or complex values where numbers are meant, or numbers that cannot be.
    """
    if name == "at_reference":
        return _flags(name, values)
    if name in WHOLE:
        whole = _whole(name, values)
        if whole.size and whole.min() < -1:
            raise InvalidRecording(f"variable '{name}' holds {whole.min()}; give whole numbers from 0, -1 for none")
        return whole
    numbers = as_float_array(values, f"variable '{name}'", error=InvalidRecording)
    if np.isinf(numbers).any():
        place = [int(axis[0]) for axis in np.nonzero(np.isinf(numbers))]
        raise InvalidRecording(f"variable '{name}' is infinite at {place}; give NaN where nothing is known")
    return numbers


def _whole(name: str, values: Shaped[np.ndarray, "..."]) -> Int[np.ndarray, "..."]:
    if values.dtype.kind in "iu":
        return values.astype(np.int64, copy=False)
    numbers = as_float_array(values, f"variable '{name}'", error=InvalidRecording)
    known = np.isfinite(numbers)
    if not (numbers[known] == np.floor(numbers[known])).all() or np.isinf(numbers).any():
        raise InvalidRecording(f"variable '{name}' holds numbers that are not whole; give whole ones, -1 for none")
    return np.where(known, numbers, -1.0).astype(np.int64)


def _flags(name: str, values: Shaped[np.ndarray, "..."]) -> Bool[np.ndarray, "..."]:
    if values.dtype == np.bool_:
        return values
    if values.dtype.kind not in "iuf" or not np.isin(values, (0, 1)).all():
        raise InvalidRecording(f"variable '{name}' holds {values.dtype}; give true or false")
    return values.astype(bool)


def _check_coordinates(recording: xr.Dataset) -> None:
    for name in COORDINATES:
        if name in recording.coords and recording[name].dims != (name,):
            raise InvalidRecording(
                f"coordinate '{name}' has dimensions {recording[name].dims}; it must have ('{name}',)"
            )
    if "joint" in recording.coords:
        _refuse_doubled(joint_names(recording))
    if "time" not in recording.coords:
        return
    time = as_float_array(recording["time"].values, "coordinate 'time'", error=InvalidRecording)
    if time.ndim != 1 or not np.isfinite(time).all():
        raise InvalidRecording("coordinate 'time' is not finite; give seconds, or a count")
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back) and not is_scattered(recording):
        raise InvalidRecording(
            f"time does not go forward from sample {back[0]} to {back[0] + 1} ({time[back[0]]:g}, "
            f"{time[back[0] + 1]:g}); sort the samples, or record trials apart"
        )


# What recordings are asked -------------------------------------------------------------------------------------------


def is_scattered(recording: xr.Dataset) -> bool:
    """Whether a recording has no order in time.

    Raises:
        InvalidRecording: It is no dataset.
    """
    _refuse_other(recording)
    order = recording.attrs.get("order")
    return isinstance(order, str) and order == "scattered"


def first_taxel(recording: xr.Dataset, truth: bool = False) -> Int[np.ndarray, "trial time"]:
    """The one taxel that is touched, where a single one is meant: the first of those that are; -1 for none.

    Args:
        recording: With ``touched``.
        truth: Of ``true_touched``: also where it is silent.

    Raises:
        InvalidRecording: Nothing is said of touches.
    """
    name = "true_touched" if truth else "touched"
    _refuse_other(recording)
    if name not in recording:
        raise InvalidRecording(f"the recording has no variable '{name}', the taxels that are touched")
    if recording[name].dims != VARIABLES[name] or recording.sizes["contact"] == 0:
        raise InvalidRecording(
            f"variable '{name}' has dimensions {dict(recording[name].sizes)}; it must have {VARIABLES[name]}"
        )
    touched = normalised(name, recording[name].values)
    first = (touched >= 0).argmax(axis=-1)
    return np.asarray(np.take_along_axis(touched, first[..., None], axis=-1)[..., 0])


def joint_names(recording: xr.Dataset) -> tuple[str, ...]:
    """Names of the joints of a recording, in its order.

    Raises:
        InvalidRecording: It does not name them.
    """
    if "joint" not in recording.coords or recording["joint"].dtype.kind not in "OUT":
        raise InvalidRecording("the recording does not name its joints; name them: .assign_coords(joint=[...])")
    return tuple(str(name) for name in recording["joint"].values)


def align(recording: xr.Dataset, body: Embodiment) -> xr.Dataset:
    """A recording of this body, its joints in the body's order.

    Raises:
        InvalidRecording: A joint of the body is missing or doubled, or the hand image is another camera's (number of
            coordinates, unit).
        UnknownName: A joint that the body does not feel.
    """
    recording = check(recording)
    names = joint_names(recording)
    for name in names:
        if name not in body.joints:
            raise UnknownName("felt joint", name, body.joints)
    missing = [name for name in body.joints if name not in names]
    if missing:
        raise InvalidRecording(
            f"the recording lacks joint{'s' if len(missing) > 1 else ''} {', '.join(map(repr, missing))} of embodiment "
            f"'{body.name}'; record them, or feel fewer joints"
        )
    if "hand_image" in recording:
        m, unit = recording.sizes["axis"], recording["hand_image"].attrs.get("units", body.camera.model.unit)
        if (m, unit) != (body.m, body.camera.model.unit):
            raise InvalidRecording(
                f"the hand image has {m} coordinates in {unit}, the camera of embodiment '{body.name}' {body.m} in "
                f"{body.camera.model.unit}; give the embodiment the camera that recorded it"
            )
    if names == body.joints:
        return recording
    return recording.isel(joint=[names.index(name) for name in body.joints])


def require_aligned(recording: xr.Dataset, body: Embodiment) -> xr.Dataset:
    """The recording itself, where its joints stand in the order of a body's: what is learned keeps that order.

    Raises:
        InvalidRecording: They stand in another order; and as :func:`align`.
        UnknownName: As :func:`align`.
    """
    aligned = align(recording, body)
    if joint_names(aligned) != joint_names(recording):
        raise InvalidRecording(
            f"the joints of the recording stand in another order than those of embodiment '{body.name}'; "
            "put them in its order before anything is learned: recordings.align(recording, body)"
        )
    return aligned


def _refuse_doubled(names: Sequence[str]) -> None:
    doubled = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if doubled:
        raise InvalidRecording(f"joint '{doubled[0]}' is there {names.count(doubled[0])} times; name each joint once")


def with_blocks(recording: xr.Dataset) -> xr.Dataset:
    """A scattered recording with blocks: contiguous fifths of its rows where it has none; a stream as it is.

    They are written down when a recording is made or read, so that they travel with the rows.
    """
    if not is_scattered(recording) or "block" in recording:
        return recording
    count = recording.sizes["time"]
    fifths = np.arange(count) * min(_FIFTHS, count) // count
    return recording.assign(block=(_SAMPLE, np.broadcast_to(fifths, (recording.sizes["trial"], count)).copy()))


def canonical_order(recording: xr.Dataset) -> Int[np.ndarray, "rows"]:
    """The order in which a scattered recording is read, whatever order its rows came in.

    By the first joint, then the second and so on, then by what was observed, then by block and repeat. Whoever draws
    or divides rows does it in this order, so that nothing depends on how the rows were written down.

    Raises:
        InvalidRecording: Not a recording, or one that is ordered in time.
    """
    recording = check(recording)
    if not is_scattered(recording):
        raise InvalidRecording("a stream is ordered in time; only a scattered recording has a canonical order")
    columns = [
        column
        for name, dims in FELT.items()
        if name in recording and dims[:2] == _SAMPLE
        for column in recording[name].values[0].reshape(recording.sizes["time"], -1).T
    ]
    # The last key counts most.
    return np.lexsort(columns[::-1])
