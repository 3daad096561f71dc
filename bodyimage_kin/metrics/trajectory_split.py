"""Why an integrated hand image leaves the true one: the steps, the posture one is at, or the way one came.

A Jacobian that is the derivative of some function of posture, a constant one among them, is wrong by an amount that
depends on the posture alone and is undone on the way back. Any other adds something in every closed loop.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin._checks import whole
from bodyimage_kin._shown import Shown
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.metrics._fields import Field, answer, line_integrals

__all__ = ["ErrorSplit", "error_split"]

_STEP_NODES = 4  # on each step, which is short: exact for a Jacobian of degree seven along it


@dataclass(frozen=True, eq=False)
class ErrorSplit(Shown):
    """The error of an integrated hand image as a sum of three.

    All arrays are ``(*batch, time, m)`` [unit], zero at the start of a path and NaN off it.

    Attributes:
        discretisation: What taking finite steps adds, at the Jacobian that is integrated; zero for a constant one.
        position: What the Jacobian gets wrong between the first posture and this one, whatever the way.
        circulation: What this way adds over the straight one: a closed loop. Zero for the derivative of any function.
    """

    discretisation: np.ndarray
    position: np.ndarray
    circulation: np.ndarray

    @property
    def total(self) -> Float[np.ndarray, "*batch time m"]:
        """The sum of the parts, integrated less true hand image."""
        return np.asarray(self.discretisation + self.position + self.circulation)

    @property
    def rms(self) -> dict[str, float]:
        """Root of the mean squared length [unit] of each part and of the total, over all samples on a path.

        In the order discretisation, position, circulation, total; NaN when there is no sample. The total is
        :func:`bodyimage_kin.metrics.trajectory_rmse`. Parts may cancel, so their squares need not sum to its own.
        """
        parts = {name: getattr(self, name) for name in ("discretisation", "position", "circulation", "total")}
        on_path = np.isfinite(self.total).all(-1)
        if not on_path.any():
            return dict.fromkeys(parts, float("nan"))
        return {name: float(np.sqrt((part[on_path] ** 2).sum(-1).mean())) for name, part in parts.items()}


@np.errstate(all="ignore")
def error_split(
    q: ArrayLike,
    true_image: ArrayLike,
    displacement: Field,
    estimated_jacobian: Field,
    *,
    nodes: int = 32,
) -> ErrorSplit:
    """Split the error of ``r_hat_t = r_0 + sum displacement(q_s, dq_s)`` (Euler, without resets) in three, exactly.

    With Jh the estimated Jacobian, and integrals of Jh dq along straight lines in joint space, from each sample to the
    next (path) or from the first sample to this one (chord)::

        discretisation_t = sum Jh(q_s) dq_s - integral along the path
        position_t       = integral along the chord - (r_t - r_0)
        circulation_t    = sum (displacement(q_s, dq_s) - Jh(q_s) dq_s) + integral along path and back along the chord

    They sum to ``r_hat_t - r_t``. The true Jacobian integrates to ``r_t - r_0`` along any way, so it has neither
    position nor circulation, and its discretisation is what the same steps cost the truth. By Stokes' theorem the
    closed integral is that of :func:`bodyimage_kin.metrics.curl` over the enclosed area. A displacement that is not
    linear in dq has that in its circulation too: a bias f(0) adds up along any way, a closed one as well.

    Args:
        q: Postures over time, (*batch, time, p) [rad or m]. A path runs from the first sample whose posture and true
            image are finite to the last before one whose are not.
        true_image: True hand image at these samples, (*batch, time, m) [unit].
        displacement: Predicted displacement, postures and joint displacements (k, p), (k, p) -> (k, m) [unit].
        estimated_jacobian: Its derivative at ``dq = 0``, (k, p) -> (k, m, p) [unit/rad]. Also asked on the chords;
            where it is NaN, so is the split.
        nodes: Gauss-Legendre nodes on each chord (4 on each step). What they miss of a Jacobian that is not smooth goes
            from one part to another, never out of the sum.

    Raises:
        InvalidArray: Arrays that do not fit together, or a function's value of a wrong shape.
        InvalidConfig: Less than one node.
    """
    nodes = whole("nodes", nodes, least=1)
    q, true_image = as_float_array(q, "q", ndim=2), as_float_array(true_image, "true_image", ndim=2)
    if q.shape[:-1] != true_image.shape[:-1]:
        raise InvalidArray(f"q has shape {q.shape} but true_image {true_image.shape}; all axes but the last must agree")
    *batch, time, p = q.shape
    q, image = q.reshape(-1, time, p), true_image.reshape(-1, time, true_image.shape[-1])
    m = image.shape[-1]
    on_path, first = _paths(np.isfinite(q).all(-1) & np.isfinite(image).all(-1))

    trial, before = np.nonzero(on_path[:, :-1] & on_path[:, 1:])
    start, end = q[trial, before], q[trial, before + 1]
    moved = linear = along = np.empty((0, m))
    if len(trial):
        moved = answer(displacement, "displacement", (len(trial), m), start, end - start)
        jacobian = as_float_array(
            estimated_jacobian(start), "the value of estimated_jacobian", shapes=((len(trial), m, p),)
        )
        linear = np.einsum("kmp,kp->km", jacobian, end - start)
        along = line_integrals(estimated_jacobian, "estimated_jacobian", start, end, _STEP_NODES, m)
    steps = np.zeros((3, *image.shape))
    steps[:, trial, before + 1] = linear - along, moved - linear, along
    discretisation, bent, path = np.cumsum(steps, axis=2)

    trial, at = np.nonzero(on_path)
    chord = np.full(image.shape, np.nan)  # off the path, where it makes every part NaN
    chord[trial, at] = line_integrals(
        estimated_jacobian, "estimated_jacobian", q[trial, first[trial]], q[trial, at], nodes, m
    )
    from_start = image - np.take_along_axis(image, first[:, None, None], axis=1)
    parts = (np.where(on_path[..., None], discretisation, np.nan), chord - from_start, bent + path - chord)
    return ErrorSplit(*(np.asarray(part).reshape(*batch, time, m) for part in parts))


def _paths(known: Bool[np.ndarray, "trial time"]) -> tuple[Bool[np.ndarray, "trial time"], Int[np.ndarray, "trial"]]:
    """Which samples are known and joined to the first known one without a gap, and which that one is."""
    begun = np.logical_or.accumulate(known, axis=1)
    broken = np.logical_or.accumulate(begun & ~known, axis=1)
    return begun & ~broken, known.argmax(axis=1)
