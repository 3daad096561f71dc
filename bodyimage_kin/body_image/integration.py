"""Where the unseen hand must be: the displacements a learned Jacobian foresees, summed along the felt motion.

This is spatial perception out of motor experience (equations 2 and 7 of Fuke, Ogino and Asada, 2007). Errors add up
over the path, so the sum begins anew whenever the hand rests at the reference taxel. What it then begins *at* decides
what an experiment can claim, and is therefore a named choice.
"""

from __future__ import annotations

import json
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from bodyimage_kin.body_image._checks import choice, float_array, postures, variable, whole
from bodyimage_kin.errors import InvalidConfig, InvalidRecording

__all__ = ["METHODS", "RESETS", "integrate"]

RESETS = ("reference", "posture_map", "secant", "true", "none")
METHODS = ("euler", "midpoint")

# Postures a learned Jacobian is asked for at once: bounds the memory of long recordings.
_BLOCK = 1 << 18


def integrate(
    exp: Any,
    learned: Any,
    reset: str = "reference",
    method: str = "euler",
    substeps: int = 1,
    initial: Any = None,
    posture_map: Any = None,
) -> xr.DataArray:
    """Estimate the hand image over time from postures alone (equations 2 and 7).

    Between two resets ``r(t+1) = r(t) + learned.displacement(q(t), q(t+1) - q(t))``. At every sample with
    ``at_reference`` the estimate is set to

    - ``"reference"``: ``exp.reference_image``, one constant known beforehand;
    - ``"posture_map"``: ``posture_map(q)``, the F of equation 7;
    - ``"secant"``: as ``"reference"``, and later samples get one displacement from the posture of the reset,
      ``r(t) = r_reset + displacement(q_reset, q(t) - q_reset)`` (equation 7 with its dtheta taken literally);
    - ``"true"``: the simulator's own hand image, a diagnostic that is labelled as such;
    - ``"none"``: nothing, the sum runs on from ``initial``.

    Args:
        exp: Experience: ``q`` (trial, time, joint) [rad or m], NaN where padded; ``at_reference`` (trial, time) bool;
            ``reference_image`` (axis,) [m on the screen].
        learned: Anything with ``displacement(q, dq)``, tensors (*batch, p) -> (*batch, m) [m]. Called once for all
            samples, in blocks when there are very many.
        reset: As above.
        method: ``"euler"`` evaluates at the posture before the step, ``"midpoint"`` at the mean of both ends.
        substeps: Equal parts that each step is divided into.
        initial: Hand image at the first sample [m], (m,) or (trial, m). A reset at that very sample wins.
        posture_map: For ``"posture_map"``: a callable (N, p) -> (N, m) [m], such as a fitted `PostureToImage`.

    Returns:
        ``hand_estimate`` (trial, time, axis) [m on the screen]; NaN where padded and before the first reset (unless
        ``initial`` is given). A gap in the postures makes a running sum NaN until the next reset.

    Raises:
        InvalidConfig: An unknown reset or method, fewer than one substep, ``"posture_map"`` without one, ``"none"``
            without ``initial``.
        InvalidRecording: A variable is missing, or there are no samples.
        InvalidArray: ``initial``, or what ``learned`` or ``posture_map`` return, has the wrong shape.
    """
    choice("reset", reset, RESETS)
    choice("method", method, METHODS)
    substeps = whole("substeps", substeps, 1)
    if reset == "posture_map" and posture_map is None:
        raise InvalidConfig("reset='posture_map' needs posture_map; give a fitted PostureToImage or another callable")
    if reset == "none" and initial is None:
        raise InvalidConfig("reset='none' needs initial, the hand image at the first sample")

    q = postures(exp)
    felt = np.isfinite(q).all(axis=-1)
    starts, values = _starts(exp, q, felt, reset, initial, posture_map)
    times = np.arange(q.shape[1])
    last_start = np.maximum.accumulate(np.where(starts, times, -1), axis=1)
    origin = last_start if reset == "secant" else np.broadcast_to(times - 1, last_start.shape)

    trial, time = np.nonzero(felt & ~starts & (last_start >= 0))
    before = origin[trial, time]
    known = felt[trial, before]
    trial, time, before = trial[known], time[known], before[known]
    start = q[trial, before]
    steps = values.copy()
    steps[trial, time] = _displacements(learned, start, q[trial, time] - start, method, substeps, values.shape[-1])

    estimate = np.full_like(values, np.nan)
    if reset == "secant":
        estimate[trial, time] = values[trial, before] + steps[trial, time]
        estimate[starts] = values[starts]
    else:
        _sum_between(starts, steps, estimate)
    return _labelled(exp, estimate, reset, method, substeps, initial)


def _starts(
    exp: xr.Dataset,
    q: Float[np.ndarray, "trial time p"],
    felt: Bool[np.ndarray, "trial time"],
    reset: str,
    initial: Any,
    posture_map: Any,
) -> tuple[Bool[np.ndarray, "trial time"], Float[np.ndarray, "trial time m"]]:
    """Where the sum begins anew, and at which image [m] (NaN elsewhere)."""
    trials, m = q.shape[0], exp.sizes.get("axis", 0)
    if m == 0:
        raise InvalidRecording("the recording has no dimension 'axis', so the hand image has no coordinates")
    starts, values = np.zeros_like(felt), np.full((*felt.shape, m), np.nan)
    if initial is not None:
        every, first = np.arange(trials), felt.argmax(axis=1)
        starts[every, first] = felt.any(axis=1)
        values[every, first] = float_array("initial", initial, (m,), (trials, m))
    if reset == "none":
        return starts, values
    resets = felt & variable(exp, "at_reference", "trial", "time").astype(bool)
    if reset == "posture_map":
        if resets.any():
            values[resets] = float_array("the value of posture_map", posture_map(q[resets]), (int(resets.sum()), m))
    elif reset == "true":
        values[resets] = variable(exp, "true_hand_image", "trial", "time", "axis")[resets]
    else:
        values[resets] = variable(exp, "reference_image", "axis")
    return starts | resets, values


def _displacements(
    learned: Any,
    q: Float[np.ndarray, "samples p"],
    dq: Float[np.ndarray, "samples p"],
    method: str,
    substeps: int,
    m: int,
) -> Float[np.ndarray, "samples m"]:
    """Displacement of the hand image [m] over each whole step dq."""
    import torch

    shift = 0.5 if method == "midpoint" else 0.0
    fractions = ((torch.arange(substeps, dtype=torch.float64) + shift) / substeps)[:, None, None]
    result = np.empty((len(q), m))
    block = max(1, _BLOCK // substeps)
    for begin in range(0, len(q), block):
        step = torch.from_numpy(dq[begin : begin + block])
        at = torch.from_numpy(q[begin : begin + block]) + fractions * step
        part = (step / substeps).expand_as(at)
        moved = learned.displacement(at.reshape(-1, at.shape[-1]), part.reshape(-1, at.shape[-1]))
        moved = float_array("the value of learned.displacement", moved, (at.shape[0] * at.shape[1], m))
        result[begin : begin + block] = moved.reshape(substeps, -1, m).sum(axis=0)
    return result


def _sum_between(
    starts: Bool[np.ndarray, "trial time"],
    steps: Float[np.ndarray, "trial time m"],
    estimate: Float[np.ndarray, "trial time m"],
) -> None:
    # One running sum a segment, not one over everything minus its value at the reset: exact, and an estimator
    # that explodes in one segment leaves the others alone.
    for trial, row in enumerate(starts):
        for begin, end in pairwise([*np.flatnonzero(row), row.size]):
            np.cumsum(steps[trial, begin:end], axis=0, out=estimate[trial, begin:end])


def _labelled(
    exp: xr.Dataset, estimate: Float[np.ndarray, "trial time m"], reset: str, method: str, substeps: int, initial: Any
) -> xr.DataArray:
    dims = ("trial", "time", "axis")
    given = None if initial is None else np.asarray(initial).tolist()
    setting = {"reset": reset, "method": method, "substeps": substeps, "initial": given}
    attributes = {**exp.attrs, "units": "m", "long_name": "estimated hand image", "integration": json.dumps(setting)}
    if reset == "true":
        attributes["diagnostic"] = "true reset"
    coordinates = {name: exp.coords[name] for name in dims if name in exp.coords}
    return xr.DataArray(estimate, dims=dims, coords=coordinates, name="hand_estimate", attrs=attributes)
