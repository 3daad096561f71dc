"""Streams put on a clock of equal steps: on request alone, for nothing that was not measured is made up in silence."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int

from bodyimage_kin import _checks
from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.recordings.schema import VARIABLES, WHOLE, check, is_scattered

__all__ = ["clock", "interpolated", "last_before", "resample"]

_STEPS = 3.0
"""A pause of more median steps than this is not bridged, unless it is said."""


def resample(recording: xr.Dataset, sampling: float | int, *, largest_gap: float | int | None = None) -> xr.Dataset:
    """A stream with samples at equal times, from its first to its last.

    Numbers (postures, images, positions) are interpolated along straight lines, touches and numbers of blocks are those
    of the last sample before. Where a neighbour in time is unseen, or the pause between both is too long, nothing is
    known: NaN, or no touch.

    Args:
        recording: A stream whose ``time`` is in seconds.
        sampling: Time between samples [s].
        largest_gap: The longest pause that is bridged [s]; None: three times the median step.

    Returns:
        The recording, with the attribute ``sampling``.

    Raises:
        InvalidRecording: A scattered recording, or one without a time.
        InvalidConfig: Times that are not positive.
    """
    recording = check(recording)
    if is_scattered(recording):
        raise InvalidRecording("a scattered recording has no order in time; nothing lies between its samples")
    if "time" not in recording.coords or recording["time"].attrs.get("units") != "s":
        raise InvalidRecording(
            "the recording does not say its times in seconds; give time=, or sampling=, to recording()"
        )
    time = recording["time"].values.astype(np.float64)
    wanted, bridged = clock(time, sampling, largest_gap)
    before, known = last_before(time, wanted, bridged)
    found = {}
    for name in VARIABLES:
        if name not in recording or "time" not in recording[name].dims:
            continue
        values = recording[name].values
        if name in WHOLE or name == "at_reference":
            there = known.reshape(1, -1, *[1] * (values.ndim - 2))
            found[name] = np.where(there, values[:, before], False if name == "at_reference" else -1)
        elif VARIABLES[name][-1] == "contact":
            found[name] = np.where(known[None, :, None], values[:, before], np.nan)
        else:
            found[name] = np.stack([interpolated(time, trial, wanted, bridged) for trial in values])
    made = recording.drop_dims("time").assign({name: (VARIABLES[name], one) for name, one in found.items()})
    made = made.assign_coords(time=("time", wanted, recording["time"].attrs))
    for name in found:
        made[name].attrs = recording[name].attrs
    return check(made.assign_attrs(sampling=float(sampling)))


def clock(
    time: Float[np.ndarray, "time"], sampling: float | int, largest_gap: float | int | None = None
) -> tuple[Float[np.ndarray, "wanted"], float]:
    """Equal times from the first to the last, and the longest pause that is bridged [s]."""
    step = _checks.number("sampling", sampling, above=0.0)
    steps = np.diff(time)
    usual = _STEPS * float(np.median(steps)) if len(steps) else step
    bridged = usual if largest_gap is None else _checks.number("largest_gap", largest_gap, above=0.0)
    count = int(np.floor((time[-1] - time[0]) / step + 1e-9)) + 1
    if count > 100 * max(len(time), 1000):
        raise InvalidRecording(
            f"sampling={step:g} s makes {count:,} samples of {len(time):,}; give a larger one, or mend the times"
        )
    return np.round(time[0] + step * np.arange(count), 9), bridged


def interpolated(
    time: Float[np.ndarray, "time"],
    values: Float[np.ndarray, "time width"],
    wanted: Float[np.ndarray, "wanted"],
    bridged: float,
) -> Float[np.ndarray, "wanted width"]:
    """Values along the straight lines between samples; NaN where one of both is, or is too far from the other."""
    after = np.searchsorted(time, wanted - 1e-9).clip(0, len(time) - 1)
    on_it = np.abs(time[after] - wanted) <= 1e-9
    before = np.where(on_it, after, (after - 1).clip(0))
    pause = time[after] - time[before]
    share = np.where(pause > 0.0, (wanted - time[before]) / np.where(pause > 0.0, pause, 1.0), 0.0)[:, None]
    found = values[before] + share * (values[after] - values[before])
    outside = (wanted < time[0] - 1e-9) | (wanted > time[-1] + 1e-9)
    return np.where(((pause > bridged * (1 + 1e-9)) | outside)[:, None], np.nan, found)


def last_before(
    time: Float[np.ndarray, "time"], wanted: Float[np.ndarray, "wanted"], bridged: float
) -> tuple[Int[np.ndarray, "wanted"], Bool[np.ndarray, "wanted"]]:
    """The last sample at each time or before it, and whether it still counts: within a long pause it does not."""
    before = (np.searchsorted(time, wanted + 1e-9, side="right") - 1).clip(0)
    pause = time[(before + 1).clip(max=len(time) - 1)] - time[before]
    return before, (pause <= bridged * (1 + 1e-9)) | (np.abs(wanted - time[before]) <= 1e-9)
