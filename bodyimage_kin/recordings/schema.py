"""What a recording is: one xarray.Dataset, what is felt beside the simulator's truth.

Dimensions ``(trial, time, joint | axis | space)``; shorter trials are padded (postures NaN, taxel -1, at_reference
False).

============================ =========================================================================================
felt
``q``                        (trial, time, joint) felt joint values [rad] (equation 3)
``hand_image``               (trial, time, axis) where the eye sees the hand [m on the screen], NaN where it does not
``taxel``                    (trial, time) the taxel that reports a touch, -1 for none
``at_reference``             (trial, time) whether the hand rests at the reference taxel
``reference_image``          (axis,) image of the hand at the reference taxel [m], known beforehand
truth
``true_q``                   (trial, time, joint)
``true_hand_image``          (trial, time, axis) NaN only where the hand is not in front of the camera plane
``true_hand_position``       (trial, time, space) the hand's centre in the root [m]
``true_taxel``               (trial, time) the taxel the hand is on, silent or not
============================ =========================================================================================
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import metadata

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int

from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidRecording

FELT: Mapping[str, tuple[str, ...]] = {
    "q": ("trial", "time", "joint"),
    "hand_image": ("trial", "time", "axis"),
    "taxel": ("trial", "time"),
    "at_reference": ("trial", "time"),
    "reference_image": ("axis",),
}
TRUE: Mapping[str, tuple[str, ...]] = {
    "true_q": ("trial", "time", "joint"),
    "true_hand_image": ("trial", "time", "axis"),
    "true_hand_position": ("trial", "time", "space"),
    "true_taxel": ("trial", "time"),
}
_UNITS = {
    "q": "rad",
    "true_q": "rad",
    "hand_image": "m",
    "true_hand_image": "m",
    "reference_image": "m",
    "true_hand_position": "m",
}
_PACKAGES = ("bodyimage-kin", "pin", "mujoco", "torch", "numpy", "scipy", "xarray")


def make_recording(
    body: Embodiment,
    *,
    q: Float[np.ndarray, "trial time joint"],
    hand_image: Float[np.ndarray, "trial time axis"],
    taxel: Int[np.ndarray, "trial time"],
    at_reference: Bool[np.ndarray, "trial time"],
    reference_image: Float[np.ndarray, "axis"],
    true_q: Float[np.ndarray, "trial time joint"],
    true_hand_image: Float[np.ndarray, "trial time axis"],
    true_hand_position: Float[np.ndarray, "trial time space"],
    true_taxel: Int[np.ndarray, "trial time"],
    sampling: float,
    motion: str,
    config: str,
) -> xr.Dataset:
    """The dataset of these arrays, with its origin as attributes.

    Args:
        body: Whose recording it is.
        q: And all further arrays: as the module's table says.
        hand_image: See the table.
        taxel: See the table.
        at_reference: See the table.
        reference_image: See the table.
        true_q: See the table.
        true_hand_image: See the table.
        true_hand_position: See the table.
        true_taxel: See the table.
        sampling: Time between samples [s].
        motion: Name of the motion's class.
        config: Everything the simulation was asked for, as JSON.
    """
    arrays = {
        "q": q,
        "hand_image": hand_image,
        "taxel": taxel,
        "at_reference": at_reference,
        "reference_image": reference_image,
        "true_q": true_q,
        "true_hand_image": true_hand_image,
        "true_hand_position": true_hand_position,
        "true_taxel": true_taxel,
    }
    recording = xr.Dataset(
        {
            name: xr.DataArray(arrays[name], dims=dims, attrs={"units": _UNITS[name]} if name in _UNITS else {})
            for name, dims in {**FELT, **TRUE}.items()
        },
        coords={
            "trial": np.arange(q.shape[0]),
            "time": ("time", np.round(np.arange(q.shape[1]) * sampling, 9), {"units": "s"}),
            "joint": list(body.joints),
            "axis": ["x", "y"],
            "space": ["x", "y", "z"],
        },
    )
    return recording.assign_attrs(
        motion=motion,
        embodiment=body.name,
        embodiment_sha256=body.sha256,
        urdf_sha256=body.robot.sha256,
        rows=body.require_skin().shape[0],
        columns=body.require_skin().shape[1],
        sampling=sampling,
        config=config,
        versions=json.dumps(versions()),
    )


def versions() -> dict[str, str]:
    """Versions of the packages a result depends on."""
    return {name: metadata.version(name) for name in _PACKAGES}


def experience(recording: xr.Dataset) -> xr.Dataset:
    """The recording without the truth: all that a learner may ever see.

    Raises:
        InvalidRecording: A felt variable is missing or misshapen.
    """
    return check(recording).drop_vars([name for name in recording.variables if str(name).startswith("true_")])


def check(recording: xr.Dataset, *, truth: bool = False) -> xr.Dataset:
    """The recording itself, once its variables are known to be there.

    Args:
        recording: A recording or an experience.
        truth: Whether the truth is needed too.

    Raises:
        InvalidRecording: Names the variable and what is wrong with it.
    """
    if not isinstance(recording, xr.Dataset):
        raise InvalidRecording(f"a recording is an xarray.Dataset, not {type(recording).__name__}")
    for name, dims in {**FELT, **(TRUE if truth else {})}.items():
        if name not in recording:
            remedy = "; an experience has no truth: give the recording itself" if name in TRUE else ""
            raise InvalidRecording(f"the recording has no variable '{name}'{remedy}")
        if recording[name].dims != dims:
            raise InvalidRecording(f"variable '{name}' has dimensions {recording[name].dims}; it must have {dims}")
    if recording.sizes["trial"] == 0 or recording.sizes["time"] == 0:
        raise InvalidRecording("the recording has no samples")
    return recording
