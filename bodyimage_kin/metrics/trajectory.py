"""How well an integrated or predicted hand image follows the true one.

Velocities are given as displacements per step, so that no time step has to be known; both scores are free of it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from bodyimage_kin._arrays import ArrayLike, Floats, as_float_array, as_pair
from bodyimage_kin.metrics._whitening import ratio

__all__ = ["curl", "trajectory_rmse", "velocity_correlation", "velocity_nrmse"]


def _finite_rows(true: ArrayLike, estimated: ArrayLike) -> tuple[Floats, Floats]:
    true, estimated = as_pair(true, estimated, ("true", "estimated"), ndim=1)
    true, estimated = true.reshape(-1, true.shape[-1]), estimated.reshape(-1, true.shape[-1])
    seen = np.isfinite(true).all(-1) & np.isfinite(estimated).all(-1)
    return true[seen], estimated[seen]


@np.errstate(all="ignore")
def velocity_correlation(true: ArrayLike, estimated: ArrayLike) -> Float[np.ndarray, "m"]:
    """Pearson correlation of estimated and true velocity along each image axis.

    Args:
        true: True displacements per step, (*samples, m) [unit]: ``np.diff(positions, axis=time)``, not positions.
        estimated: Estimated displacements, of the same shape.

    Returns:
        One correlation an image axis, in [-1, 1], pooled over all samples finite in both. NaN where either does not
        vary or no sample is left.

    Raises:
        InvalidArray: Not two float arrays of one shape.
    """
    true, estimated = _finite_rows(true, estimated)
    if len(true) == 0:
        return np.full(true.shape[-1], np.nan)
    # A constant column keeps a rounding residue after its mean is taken off; it has no correlation all the same.
    varies = (np.ptp(true, axis=0) > 0) & (np.ptp(estimated, axis=0) > 0)
    true, estimated = (np.where(varies, a / np.where(varies, np.ptp(a, axis=0), 1), 0) for a in (true, estimated))
    true, estimated = true - true.mean(0), estimated - estimated.mean(0)
    correlation = ratio((true * estimated).sum(0), np.sqrt((true**2).sum(0) * (estimated**2).sum(0)))
    return np.where(varies, correlation.clip(-1, 1), np.nan)


@np.errstate(all="ignore")
def velocity_nrmse(true: ArrayLike, estimated: ArrayLike) -> Float[np.ndarray, "m"]:
    """RMS error of the velocity along each image axis, over the range of the true velocity.

    Args:
        true: True displacements per step, (*samples, m) [unit]: ``np.diff(positions, axis=time)``, not positions.
        estimated: Estimated displacements, of the same shape.

    Returns:
        One dimensionless error an image axis, pooled over all samples finite in both. NaN where the true velocity
        does not vary or no sample is left.

    Raises:
        InvalidArray: Not two float arrays of one shape.
    """
    true, estimated = _finite_rows(true, estimated)
    if len(true) == 0:
        return np.full(true.shape[-1], np.nan)
    return ratio(np.sqrt(((estimated - true) ** 2).mean(0)), np.ptp(true, axis=0))


@np.errstate(all="ignore")
def trajectory_rmse(true: ArrayLike, estimated: ArrayLike) -> float:
    """RMS distance between estimated and true position of the hand image.

    Args:
        true: True positions, (*samples, m) [unit].
        estimated: Estimated positions, of the same shape.

    Returns:
        The root of the mean squared distance [unit] over all samples finite in both; NaN when there is none.

    Raises:
        InvalidArray: Not two float arrays of one shape.
    """
    true, estimated = _finite_rows(true, estimated)
    return float(np.sqrt(((estimated - true) ** 2).sum(-1).mean())) if len(true) else float("nan")


@np.errstate(all="ignore")
def curl(jacobian_derivative: ArrayLike) -> Float[np.ndarray, "*batch m p p"]:
    """What keeps a Jacobian from being the derivative of any function: ``d_l J_ik - d_k J_il``.

    Args:
        jacobian_derivative: (*batch, m, p, p), where [..., i, k, l] is the derivative of J_ik by joint l [unit/rad^2].

    Returns:
        Antisymmetric in its last two axes [unit/rad^2], zero for a true Jacobian; NaN where an entry is NaN.

    Raises:
        InvalidArray: Not a float array, or its last two axes differ.
    """
    derivative = as_float_array(jacobian_derivative, "jacobian_derivative", ndim=3)
    if derivative.shape[-1] != derivative.shape[-2]:
        as_pair(derivative, derivative.swapaxes(-1, -2), ("jacobian_derivative", "its transpose"), ndim=3)
    return np.asarray(derivative - derivative.swapaxes(-1, -2))
