"""What a learned Jacobian does in the visual servo law ``u = -lambda Jh^+ e``.

Near the goal the image error then follows ``de/dt = -lambda M e`` with ``M = J Jh^+``, whose eigenvalues mu decide. See
Chaumette and Hutchinson, "Visual servo control, part I" (2006), on stability.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from bodyimage_kin._arrays import ArrayLike, Floats, as_float_array, as_pair
from bodyimage_kin.errors import InvalidArray

__all__ = ["critical_gain", "locally_stable", "monotone", "servo_matrix"]

_EPS = float(np.finfo(np.float64).eps)


@np.errstate(all="ignore")
def servo_matrix(true: ArrayLike, estimated: ArrayLike) -> Float[np.ndarray, "*batch m m"]:
    """M = J Jh^+, the identity when the estimate moves the image as meant.

    Args:
        true: (*batch, m, p) [unit/rad].
        estimated: The same shape. Singular values below rounding (max(m, p) eps of the greatest) count as zero.

    Returns:
        Dimensionless, zero for a zero estimate. NaN at postures with a non-finite entry.

    Raises:
        InvalidArray: Not two float arrays of one shape.
    """
    J, Jh = as_pair(true, estimated, ("true", "estimated"), ndim=2)
    finite = np.isfinite(J).all((-1, -2), keepdims=True) & np.isfinite(Jh).all((-1, -2), keepdims=True)
    J, Jh = np.where(finite, J, 0), np.where(finite, Jh, 0)
    gram = Jh @ Jh.swapaxes(-1, -2)
    spread = np.linalg.eigvalsh(gram)
    # The Gram matrix squares the condition number but is much the faster; below 100 that costs four digits at most.
    fast = spread[..., 0] > 1e-4 * spread[..., -1]
    M = np.empty_like(gram)
    M[fast] = J[fast] @ Jh[fast].swapaxes(-1, -2) @ np.linalg.inv(gram[fast])
    M[~fast] = J[~fast] @ np.linalg.pinv(Jh[~fast], rcond=max(J.shape[-2:]) * _EPS)
    return np.where(finite, M, np.nan)


def _square(servo_matrix: ArrayLike) -> tuple[Floats, Bool[np.ndarray, "*batch"], Floats]:
    """The matrices (zero where not finite), which are finite, and what is zero to rounding in each (*batch,)."""
    M = as_float_array(servo_matrix, "servo_matrix", ndim=2)
    if M.shape[-1] != M.shape[-2]:
        raise InvalidArray(f"servo_matrix has shape {M.shape}; it must be (*batch, m, m), J times the inverse of Jh")
    finite = np.asarray(np.isfinite(M).all((-1, -2)))
    M = np.where(finite[..., None, None], M, 0)
    return M, finite, np.asarray(10 * M.shape[-1] * _EPS * np.linalg.norm(M, axis=(-2, -1)))


def locally_stable(servo_matrix: ArrayLike) -> Bool[np.ndarray, "*batch"]:
    """Whether a small enough gain converges near the goal: all eigenvalues of M have positive real part.

    Args:
        servo_matrix: M, (*batch, m, m), of :func:`servo_matrix`.

    Returns:
        False also where an eigenvalue is zero to rounding or M is not finite.

    Raises:
        InvalidArray: Not a float array of square matrices.
    """
    M, finite, zero = _square(servo_matrix)
    return np.asarray(finite & (np.linalg.eigvals(M).real.min(-1, initial=np.inf) > zero))


def monotone(servo_matrix: ArrayLike) -> Bool[np.ndarray, "*batch"]:
    """Whether a small enough gain shrinks the image error from the first step on: sym(M) is positive definite.

    Args:
        servo_matrix: M, (*batch, m, m), of :func:`servo_matrix`.

    Returns:
        False also where an eigenvalue of sym(M) is zero to rounding or M is not finite.

    Raises:
        InvalidArray: Not a float array of square matrices.
    """
    M, finite, zero = _square(servo_matrix)
    return np.asarray(finite & (np.linalg.eigvalsh((M + M.swapaxes(-1, -2)) / 2)[..., 0] > zero))


@np.errstate(all="ignore")
def critical_gain(servo_matrix: ArrayLike) -> Float[np.ndarray, "*batch"]:
    """The gain ``lambda dt`` per step below which the sampled servo converges near the goal, min 2 Re(mu) / |mu|^2.

    Args:
        servo_matrix: M, (*batch, m, m), of :func:`servo_matrix`.

    Returns:
        Dimensionless, 2 for a perfect estimate, 0 where no gain converges (not :func:`locally_stable`); NaN where M is
        not finite.

    Raises:
        InvalidArray: Not a float array of square matrices.
    """
    M, finite, zero = _square(servo_matrix)
    mu = np.linalg.eigvals(M)
    gain = np.where(mu.real.min(-1) > zero, (2 * mu.real / np.abs(mu) ** 2).min(-1), 0.0)
    return np.where(finite, gain, np.nan)
