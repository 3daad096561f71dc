"""Where the unseen hand must be: the displacements a learned Jacobian foresees, summed along the felt motion.

This is spatial perception out of motor experience (equations 2 and 7 of Fuke, Ogino and Asada, 2007). Errors add up
over the path, so the sum begins anew whenever the hand rests at the reference taxel. What it then begins *at* decides
what an experiment can claim, and is therefore a named choice.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from itertools import pairwise
from typing import Any, Literal, TypeAlias

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin._checks import choice, whole
from bodyimage_kin.body_image._checks import postures, variable
from bodyimage_kin.errors import DataWarning, InvalidConfig, InvalidRecording
from bodyimage_kin.estimators import HasDisplacement
from bodyimage_kin.recordings import is_scattered, without_truth

__all__ = ["METHODS", "RESETS", "integrate"]

RESETS = ("reference", "posture_map", "secant", "true", "none")
METHODS = ("euler", "midpoint")
PATHS = ("time", "star")

# Postures a learned Jacobian is asked for at once: bounds the memory of long recordings.
_BLOCK = 1 << 18
_STAR_SUBSTEPS = 40

Reset: TypeAlias = str | Callable[[xr.Dataset], ArrayLike]
"""One of :data:`RESETS`, or a function of what is felt where the hand rests at the reference."""
PostureMap: TypeAlias = Callable[[Float[np.ndarray, "samples p"]], ArrayLike]
"""From postures [rad or m] to hand images (samples, m)."""


def integrate(
    exp: xr.Dataset,
    learned: HasDisplacement,
    reset: Reset = "reference",
    method: str | None = None,
    substeps: int | None = None,
    initial: ArrayLike | None = None,
    posture_map: PostureMap | None = None,
    path: Literal["time", "star"] | str = "time",
) -> xr.DataArray:
    """Estimate the hand image from postures alone (equations 2 and 7).

    Along a stream, ``r(t+1) = r(t) + learned.displacement(q(t), q(t+1) - q(t))`` between two resets. At every sample
    with ``at_reference`` the estimate is set to

    - ``"reference"``: ``exp.reference_image``, one constant known beforehand;
    - ``"posture_map"``: ``posture_map(q)``, the F of equation 7;
    - ``"secant"``: as ``"reference"``, and later samples get one displacement from the posture of the reset,
      ``r(t) = r_reset + displacement(q_reset, q(t) - q_reset)`` (equation 7 with its dtheta taken literally);
    - ``"true"``: the simulator's own hand image, a diagnostic that is labelled as such;
    - ``"none"``: nothing, the sum runs on from ``initial``;
    - a function of what is felt there: it gets the experience at the resets, without any truth, over the one dimension
      ``sample``, and gives images (sample, m).

    A scattered recording has no path in time. With ``path="star"`` each posture is reached straight in joint space from
    one reference: the first sample where ``initial`` is given, else the first ``at_reference`` in the order of joint
    values.

    Args:
        exp: Experience: ``q`` (trial, time, joint) [rad or m], NaN where padded; ``at_reference`` (trial, time) bool;
            ``reference_image`` (axis,), in the unit of the hand image.
        learned: A learned Jacobian; of it, ``displacement(q, dq)`` alone is asked, once for all samples, in blocks when
            there are very many.
        reset: As above.
        method: ``"euler"`` evaluates at the posture before the step (the default in time), ``"midpoint"`` at the mean
            of both ends (the default of a star).
        substeps: Equal parts that each step is divided into; unless given, 1 in time and 40 in a star.
        initial: Hand image at the first sample, (m,) or (trial, m). In time, a reset at that very sample wins.
        posture_map: For ``"posture_map"``: (samples, p) -> (samples, m), such as a fitted `PostureToImage`.
        path: ``"time"`` or ``"star"``.

    Returns:
        ``hand_estimate`` (trial, time, axis), in the unit of the hand image; NaN where padded and before the first
        reset (unless ``initial`` is given). A gap in the postures makes a running sum NaN until the next reset.

    Raises:
        InvalidConfig: An unknown reset, method or path, fewer than one substep, ``"posture_map"`` without one,
            ``"none"`` without ``initial``.
        InvalidRecording: A variable is missing, there are no samples, no trial has a sample to begin at, or a scattered
            recording is to be followed in time.
        InvalidArray: ``initial``, or what ``learned`` or a function of the reset returns, has the wrong shape.

    Warns:
        DataWarning: Some trials have no sample to begin at: the estimate is NaN all over them.
    """
    star = choice("path", path, PATHS) == "star"
    if not callable(reset):
        choice("reset", reset, RESETS)
    method = choice("method", method or ("midpoint" if star else "euler"), METHODS)
    substeps = whole("substeps", (_STAR_SUBSTEPS if star else 1) if substeps is None else substeps, least=1)
    if reset == "posture_map" and posture_map is None:
        raise InvalidConfig("reset='posture_map' needs posture_map; give a fitted PostureToImage or another callable")
    if reset == "none" and initial is None:
        raise InvalidConfig("reset='none' needs initial, the hand image at the first sample")

    q = postures(exp)
    if is_scattered(exp) and not star:
        raise InvalidRecording("a scattered recording has no path in time; give path='star'")
    felt = np.isfinite(q).all(axis=-1)
    m = exp.sizes.get("axis", 0) or int(getattr(learned, "m", 0))
    if m == 0:
        raise InvalidRecording("the recording has no dimension 'axis', so the hand image has no coordinates")
    starts, values = _starts(exp, q, felt, reset, initial, posture_map, m, star)
    _refuse_nowhere(starts, felt)
    times = np.arange(q.shape[1])
    if star:
        last_start = np.broadcast_to(np.where(starts.any(axis=1), starts.argmax(axis=1), -1)[:, None], starts.shape)
    else:
        last_start = np.maximum.accumulate(np.where(starts, times, -1), axis=1)
    at_once = star or reset == "secant"
    origin = last_start if at_once else np.broadcast_to(times - 1, last_start.shape)

    trial, time = np.nonzero(felt & ~starts & (last_start >= 0))
    before = origin[trial, time]
    known = felt[trial, before]
    trial, time, before = trial[known], time[known], before[known]
    start = q[trial, before]
    steps = values.copy()
    steps[trial, time] = _displacements(learned, start, q[trial, time] - start, method, substeps, m)

    estimate = np.full_like(values, np.nan)
    if at_once:
        estimate[trial, time] = values[trial, before] + steps[trial, time]
        estimate[starts] = values[starts]
    else:
        _sum_between(starts, steps, estimate)
    given = None if initial is None else as_float_array(initial, "initial").tolist()
    named = getattr(reset, "__name__", type(reset).__name__) if callable(reset) else reset
    setting = {"reset": named, "method": method, "substeps": substeps, "initial": given, "path": path}
    return _labelled(exp, estimate, _unit(exp, learned), setting)


def _starts(
    exp: xr.Dataset,
    q: Float[np.ndarray, "trial time p"],
    felt: Bool[np.ndarray, "trial time"],
    reset: Reset,
    initial: ArrayLike | None,
    posture_map: PostureMap | None,
    m: int,
    star: bool,
) -> tuple[Bool[np.ndarray, "trial time"], Float[np.ndarray, "trial time m"]]:
    """Where the sum begins anew, and at which image (NaN elsewhere)."""
    trials = q.shape[0]
    starts, values = np.zeros_like(felt), np.full((*felt.shape, m), np.nan)
    if initial is not None:
        every, first = np.arange(trials), felt.argmax(axis=1)
        starts[every, first] = felt.any(axis=1)
        values[every, first] = as_float_array(initial, "initial", shapes=((m,), (trials, m)))
    if reset == "none" or (star and initial is not None):
        return starts, values
    if "at_reference" not in exp:
        raise InvalidRecording(
            "the recording has no variable 'at_reference', so nothing tells where to begin; give reset='none' and "
            "initial=, the hand image at the first sample"
        )
    resets = felt & variable(exp, "at_reference", "trial", "time").astype(bool)
    if star:
        resets = _first_by_posture(q, resets)
    count = (int(resets.sum()), m)
    if callable(reset):
        if resets.any():
            values[resets] = as_float_array(reset(_felt_there(exp, resets)), "the value of reset", shapes=(count,))
    elif reset == "posture_map":
        if resets.any() and posture_map is not None:
            values[resets] = as_float_array(posture_map(q[resets]), "the value of posture_map", shapes=(count,))
    elif reset == "true":
        values[resets] = variable(exp, "true_hand_image", "trial", "time", "axis")[resets]
    else:
        image = variable(exp, "reference_image", "axis")
        what = "variable 'reference_image'"
        values[resets] = as_float_array(image, what, shapes=((m,),), error=InvalidRecording)
    return starts | resets, values


def _first_by_posture(
    q: Float[np.ndarray, "trial time p"], resets: Bool[np.ndarray, "trial time"]
) -> Bool[np.ndarray, "trial time"]:
    """One reset a trial, the same however its rows are ordered."""
    kept = np.zeros_like(resets)
    for trial, row in enumerate(resets):
        at = np.flatnonzero(row)
        if at.size:
            kept[trial, at[np.lexsort(q[trial, at].T[::-1])[0]]] = True
    return kept


def _felt_there(exp: xr.Dataset, there: Bool[np.ndarray, "trial time"]) -> xr.Dataset:
    """What is felt at some samples, over the dimension ``sample`` first; nothing of any truth."""
    felt = without_truth(exp)
    rows = felt.stack(sample=("trial", "time"), create_index=False).isel(sample=np.flatnonzero(there))
    return rows.transpose("sample", ...)


def _refuse_nowhere(starts: Bool[np.ndarray, "trial time"], felt: Bool[np.ndarray, "trial time"]) -> None:
    """Says so where there is nothing to begin at: an estimate of NaN would say nothing."""
    asked, lost = felt.any(axis=1), felt.any(axis=1) & ~starts.any(axis=1)
    remedy = "give initial=, the hand image at the first sample"
    if lost.sum() == asked.sum():
        raise InvalidRecording(f"the hand never rests at the reference, so the estimate begins nowhere; {remedy}")
    if lost.any():
        warnings.warn(
            f"in {lost.sum()} of {asked.sum()} trials the hand never rests at the reference: their estimate is NaN; "
            f"{remedy}",
            DataWarning,
            stacklevel=3,
        )


def _displacements(
    learned: HasDisplacement,
    q: Float[np.ndarray, "samples p"],
    dq: Float[np.ndarray, "samples p"],
    method: str,
    substeps: int,
    m: int,
) -> Float[np.ndarray, "samples m"]:
    """Displacement of the hand image over each whole step dq."""
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
        shape = (at.shape[0] * at.shape[1], m)
        foreseen = as_float_array(moved, "the value of learned.displacement", shapes=(shape,))
        result[begin : begin + block] = foreseen.reshape(substeps, -1, m).sum(axis=0)
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
    exp: xr.Dataset, estimate: Float[np.ndarray, "trial time m"], unit: str, setting: dict[str, Any]
) -> xr.DataArray:
    dims = ("trial", "time", "axis")
    attributes = {**exp.attrs, "units": unit, "long_name": "estimated hand image", "integration": json.dumps(setting)}
    if setting["reset"] == "true":
        attributes["diagnostic"] = "true reset"
    coordinates = {name: exp.coords[name] for name in dims if name in exp.coords}
    return xr.DataArray(estimate, dims=dims, coords=coordinates, name="hand_estimate", attrs=attributes)


def _unit(exp: xr.Dataset, learned: HasDisplacement) -> str:
    """Of the hand image: as the recording says, or the learned Jacobian."""
    for name in ("hand_image", "reference_image"):
        if name in exp and "units" in exp[name].attrs:
            return str(exp[name].attrs["units"])
    return str(getattr(learned, "unit", ""))
