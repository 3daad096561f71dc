"""How wrong a learned Jacobian is, posture by posture and pooled.

J is the true Jacobian of the hand image, Jh the estimated one, E = Jh - J, all (m, p) [m/rad]. A unit metric W (p x p)
says how much each joint motion matters; in the whitened space ``Jt = J W^1/2`` the squared norm is the mean squared
image displacement that the motion behind W causes. Everything is computed in float64.

Undefined is NaN: a posture with a non-finite entry in J or Jh has NaN in every score, pooled scores leave it out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np
from jaxtyping import Float

from bodyimage_kin.errors import InvalidArray, UnknownName
from bodyimage_kin.metrics._inputs import ArrayInput, Floats, as_floats, as_pair, ratio, square_root

_CHUNK = 1 << 16  # postures at a time, so that temporaries stay in the tens of megabytes


def unit_metric(
    kind: Literal["identity", "range", "use"] | str,
    *,
    dq: ArrayInput | None = None,
    lower: ArrayInput | None = None,
    upper: ArrayInput | None = None,
    p: int | None = None,
) -> Float[np.ndarray, "p p"]:
    """The unit metric of joint space: how much a unit of motion of each joint matters.

    Args:
        kind: ``"identity"``; ``"range"``, diag(range^2); or ``"use"``, mean(dq dq') of the probe motion, plus 1e-6 of
            its mean diagonal on the diagonal so that it can be inverted.
        dq: Joint displacements of the probe motion, (*samples, p) [rad or m], for ``"use"``; rows that are not finite
            are left out.
        lower: Lower joint limits, (p,) [rad or m], for ``"range"``; an unlimited joint counts as [-pi, pi].
        upper: Upper joint limits, likewise.
        p: Number of joints, for ``"identity"``.

    Returns:
        Symmetric, in [rad^2] but for the identity.

    Raises:
        UnknownName: No such kind.
        InvalidArray: What this kind needs is missing, or holds no motion.
    """
    if kind == "identity":
        if p is None or p < 1:
            raise InvalidArray("unit metric 'identity' needs p, the number of joints")
        return np.eye(p)
    if kind == "range":
        if lower is None or upper is None:
            raise InvalidArray("unit metric 'range' needs lower and upper, the joint limits")
        low, high = as_pair(lower, upper, ("lower", "upper"), ndim=1)
        unlimited = (low == -np.inf) & (high == np.inf)
        width = np.where(unlimited, np.pi, high) - np.where(unlimited, -np.pi, low)
        if low.ndim != 1 or not (np.isfinite(width) & (width > 0)).all():
            raise InvalidArray("joint limits must be (p,), with each lower limit below its upper one")
        return np.diag(width**2)
    if kind == "use":
        if dq is None:
            raise InvalidArray("unit metric 'use' needs dq, the joint displacements of the probe motion")
        gram = mean_gram(dq, "dq")
        if not np.trace(gram) > 0:
            raise InvalidArray("dq holds no motion to weigh the joints by; give displacements of a moving robot")
        return np.asarray(gram + 1e-6 * np.trace(gram) / len(gram) * np.eye(len(gram)))
    raise UnknownName("unit metric", kind, ["identity", "range", "use"])


def mean_gram(dq: ArrayInput, name: str) -> Float[np.ndarray, "p p"]:
    """mean(dq dq') per sample, so that long and short recordings compare.

    Args:
        dq: Joint displacements, (*samples, p) [rad or m]; rows that are not finite are left out.
        name: What the error calls them.

    Raises:
        InvalidArray: Not a float array, or no finite row.
    """
    motion = as_floats(dq, name, ndim=1)
    motion = motion.reshape(-1, motion.shape[-1])
    motion = motion[np.isfinite(motion).all(-1)]
    if len(motion) == 0:
        raise InvalidArray(f"{name} has no finite row; give the joint displacements of a recorded motion")
    return np.asarray(motion.T @ motion / len(motion))


def _chunks(true: Floats, estimated: Floats, root: Floats | None) -> Iterator[tuple[slice, Floats, Floats, Floats]]:
    """Whitened pairs (postures, m, p), a bounded number at a time, and which are finite (the others become zero)."""
    m, p = true.shape[-2:]
    true, estimated = true.reshape(-1, m, p), estimated.reshape(-1, m, p)
    for start in range(0, len(true), _CHUNK):
        place = slice(start, start + _CHUNK)
        J, Jh = true[place], estimated[place]
        finite = np.isfinite(J).all((-1, -2)) & np.isfinite(Jh).all((-1, -2))
        if not finite.all():
            J, Jh = (np.where(finite[:, None, None], a, 0) for a in (J, Jh))
        if root is not None:
            J, Jh = ((a.reshape(-1, p) @ root).reshape(-1, m, p) for a in (J, Jh))
        yield place, J, Jh, finite


def _per_posture(
    score: Callable[[Floats, Floats], Floats], true: ArrayInput, estimated: ArrayInput, metric: ArrayInput | None
) -> Floats:
    """``score`` of whitened (postures, m, p) pairs, in the batch shape of the Jacobians."""
    J, Jh = as_pair(true, estimated, ("true", "estimated"), ndim=2)
    root = None if metric is None else square_root(metric, J.shape[-1])
    tail = score(np.zeros((0, *J.shape[-2:])), np.zeros((0, *J.shape[-2:]))).shape[1:]
    result = np.empty((int(np.prod(J.shape[:-2])), *tail))
    with np.errstate(all="ignore"):
        for place, j, jh, finite in _chunks(J, Jh, root):
            result[place] = score(j, jh)
            result[place][~finite] = np.nan
    return result.reshape(J.shape[:-2] + tail)


def _inner(A: Floats, B: Floats) -> Floats:
    return np.asarray(np.einsum("nij,nij->n", A, B))


def _relative_error(J: Floats, Jh: Floats) -> Floats:
    E = Jh - J
    return np.asarray(np.sqrt(ratio(_inner(E, E), _inner(J, J))))


def relative_error(
    true: ArrayInput, estimated: ArrayInput, metric: ArrayInput | None = None
) -> Float[np.ndarray, "*batch"]:
    """Relative error ``|E W^1/2| / |J W^1/2|`` of each posture, Frobenius norms.

    Args:
        true: (*batch, m, p) [m/rad].
        estimated: The same shape.
        metric: Unit metric W, (p, p); the identity when None.

    Returns:
        Dimensionless, 0 when exact, 1 for a zero estimate. NaN where the true one vanishes or an entry is not finite.

    Raises:
        InvalidArray: Shapes that differ, or a metric that is none.
    """
    return _per_posture(_relative_error, true, estimated, metric)


def pooled_relative_error(true: ArrayInput, estimated: ArrayInput, metric: ArrayInput | None = None) -> float:
    """Relative error over all postures at once, ``sqrt(mean |E W^1/2|^2 / mean |J W^1/2|^2)``.

    Args:
        true: (*batch, m, p) [m/rad].
        estimated: The same shape.
        metric: Unit metric W, (p, p); the identity when None.

    Returns:
        Dimensionless. Postures with a non-finite entry are left out; NaN when none is left or the true ones vanish.

    Raises:
        InvalidArray: Shapes that differ, or a metric that is none.
    """
    J, Jh = as_pair(true, estimated, ("true", "estimated"), ndim=2)
    root = None if metric is None else square_root(metric, J.shape[-1])
    error = size = 0.0
    with np.errstate(all="ignore"):
        for _, j, jh, _ in _chunks(J, Jh, root):
            error, size = error + float(((jh - j) ** 2).sum()), size + float((j**2).sum())
        return float(np.sqrt(ratio(error, size)))


def displacement_error(predicted: ArrayInput, true_displacement: ArrayInput) -> float:
    """Relative RMS error of predicted displacements over a motion, ``sqrt(mean |d - J dq|^2 / mean |J dq|^2)``.

    The headline for an estimator that predicts displacements and has a Jacobian only by differentiation.

    Args:
        predicted: Predicted displacements of the hand image d, (*samples, m) [m].
        true_displacement: The true ones, J dq or the change of the true image, of the same shape.

    Returns:
        Dimensionless, 1 for a prediction of zero. Rows not finite in either are left out; NaN when none is left or
        nothing truly moves.

    Raises:
        InvalidArray: Not two float arrays of one shape.
    """
    d, truth = as_pair(predicted, true_displacement, ("predicted", "true_displacement"), ndim=1)
    finite = np.isfinite(d).all(-1) & np.isfinite(truth).all(-1)
    with np.errstate(all="ignore"):
        return float(np.sqrt(ratio(((d[finite] - truth[finite]) ** 2).sum(), (truth[finite] ** 2).sum())))
