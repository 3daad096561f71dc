"""How wrong a learned Jacobian is, posture by posture and pooled.

J is the true Jacobian of the hand image, Jh the estimated one, E = Jh - J, all (m, p), ``[unit]`` that of the image. A
metric W (p x p) says how much each joint motion matters: ``"identity"``, the default of every function here, counts all
joints alike; in that of a motion (:func:`bodyimage_kin.metrics.motion_metric`) the squared norm of ``Jt = J W^1/2`` is
the mean squared image displacement that the motion causes. Everything is computed in float64.

Undefined is NaN: a posture with a non-finite entry in J or Jh has NaN in every score, pooled scores leave it out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from jaxtyping import Float

from bodyimage_kin._arrays import ArrayLike, as_pair
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.metrics._postures import SCORES, chunks, per_posture
from bodyimage_kin.metrics._whitening import Metric, metric_root, power_of_two, ratio

__all__ = [
    "axis_relative_error",
    "column_cosine",
    "column_log_norm_ratio",
    "displacement_error",
    "jacobian_errors",
    "log_condition_difference",
    "manipulability_ratio",
    "pooled_relative_error",
    "pooled_scale_free_error",
    "relative_error",
    "row_space_angles",
    "scale_free_error",
    "singular_value_ratios",
]


def jacobian_errors(
    true: ArrayLike,
    estimated: ArrayLike,
    *,
    metric: Metric = "identity",
    joints: Sequence[str] | None = None,
    dims: Sequence[str] = ("posture",),
) -> xr.Dataset:
    """Every score of a learned Jacobian that is defined posture by posture.

    Args:
        true: (*batch, m, p) [unit/rad].
        estimated: The same shape.
        metric: W, ``"identity"`` (the default) or (p, p). Column scores are of the joints themselves, without it.
        joints: Names of the p joints, the coordinate of ``joint``.
        dims: Names of the batch axes; a batch of another number of axes is flattened when there is but one name.

    Returns:
        One variable for each function of this module that has the same name, over ``dims`` and, where it has parts,
        ``joint``, ``axis`` (of the image) or ``direction`` (singular directions, strongest first; angles ascending).
        Each carries ``long_name``, ``units`` and ``source``.

    Raises:
        InvalidArray: Shapes that differ, a metric that is none, or names that do not fit the shape.
    """
    found = per_posture(list(SCORES), true, estimated, metric)
    batch, p = found["relative_error"].shape, found["column_cosine"].shape[-1]
    if joints is not None and len(joints) != p:
        raise InvalidArray(f"{len(joints)} joint names for a Jacobian of {p} columns; name each column")
    if len(dims) != len(batch) and len(dims) != 1:
        raise InvalidArray(f"{len(dims)} dims for a batch of shape {batch}; name each axis, or give one to flatten")
    shape = batch if len(dims) == len(batch) else (int(np.prod(batch)),)
    variables = {
        name: xr.Variable(
            (*dims, *SCORES[name].dims),
            values.reshape(shape + values.shape[len(batch) :]),
            {"long_name": SCORES[name].long_name, "units": SCORES[name].units, "source": f"{__name__}.{name}"},
        )
        for name, values in found.items()
    }
    return xr.Dataset(variables, {} if joints is None else {"joint": list(joints)})


def relative_error(true: ArrayLike, estimated: ArrayLike, metric: Metric = "identity") -> Float[np.ndarray, "*batch"]:
    """Relative error ``|E W^1/2| / |J W^1/2|`` of each posture, Frobenius norms.

    Args:
        true: (*batch, m, p) [unit/rad].
        estimated: The same shape.
        metric: W, ``"identity"`` (the default) or (p, p).

    Returns:
        Dimensionless, 0 when exact, 1 for a zero estimate. NaN where the true one vanishes or an entry is not finite.

    Raises:
        InvalidArray: Shapes that differ, or a metric that is none.
    """
    return per_posture(["relative_error"], true, estimated, metric)["relative_error"]


def axis_relative_error(
    true: ArrayLike, estimated: ArrayLike, metric: Metric = "identity"
) -> Float[np.ndarray, "*batch m"]:
    """Relative error of each image axis (row), as :func:`relative_error`.

    Args:
        true: (*batch, m, p) [unit/rad].
        estimated: The same shape.
        metric: W, ``"identity"`` (the default) or (p, p).

    Returns:
        Dimensionless. NaN where the true row vanishes or an entry is not finite.

    Raises:
        InvalidArray: Shapes that differ, or a metric that is none.
    """
    return per_posture(["axis_relative_error"], true, estimated, metric)["axis_relative_error"]


def scale_free_error(true: ArrayLike, estimated: ArrayLike, metric: Metric = "identity") -> Float[np.ndarray, "*batch"]:
    """Squared relative error left after the best scaling of the estimate, ``1 - <Jh, J>^2 / (|Jh|^2 |J|^2)``.

    Blind to the depth a monocular learner cannot know, and to the sign of the whole Jacobian with it.

    Args:
        true: (*batch, m, p) [unit/rad].
        estimated: The same shape.
        metric: W, ``"identity"`` (the default) or (p, p).

    Returns:
        In [0, 1]. NaN where either Jacobian vanishes or an entry is not finite.

    Raises:
        InvalidArray: Shapes that differ, or a metric that is none.
    """
    return per_posture(["scale_free_error"], true, estimated, metric)["scale_free_error"]


def column_cosine(true: ArrayLike, estimated: ArrayLike) -> Float[np.ndarray, "*batch p"]:
    """Cosine of the angle between the true and the estimated image motion of each joint.

    Args:
        true: (*batch, m, p) [unit/rad].
        estimated: The same shape.

    Returns:
        In [-1, 1]. NaN where either column vanishes or an entry is not finite.

    Raises:
        InvalidArray: Shapes that differ.
    """
    return per_posture(["column_cosine"], true, estimated, "identity")["column_cosine"]


def column_log_norm_ratio(true: ArrayLike, estimated: ArrayLike) -> Float[np.ndarray, "*batch p"]:
    """Natural logarithm of estimated over true size of each joint's image motion.

    Args:
        true: (*batch, m, p) [unit/rad].
        estimated: The same shape.

    Returns:
        0 when equal, -inf for an estimated column of zero. NaN where the true column vanishes or an entry is not
        finite.

    Raises:
        InvalidArray: Shapes that differ.
    """
    return per_posture(["column_log_norm_ratio"], true, estimated, "identity")["column_log_norm_ratio"]


def singular_value_ratios(
    true: ArrayLike, estimated: ArrayLike, metric: Metric = "identity"
) -> Float[np.ndarray, "*batch k"]:
    """Estimated over true singular values of ``J W^1/2``, strongest first.

    Args:
        true: (*batch, m, p) [unit/rad].
        estimated: The same shape.
        metric: W, ``"identity"`` (the default) or (p, p).

    Returns:
        k = min(m, p) ratios, 0 for a direction the estimate has lost. NaN where the true one is zero or an entry is not
        finite. Singular values below rounding (max(m, p) eps of the greatest) are zero.

    Raises:
        InvalidArray: Shapes that differ, or a metric that is none.
    """
    return per_posture(["singular_value_ratios"], true, estimated, metric)["singular_value_ratios"]


def log_condition_difference(
    true: ArrayLike, estimated: ArrayLike, metric: Metric = "identity"
) -> Float[np.ndarray, "*batch"]:
    """Difference of log condition numbers, estimated minus true, of ``J W^1/2``.

    Args:
        true: (*batch, m, p) [unit/rad].
        estimated: The same shape.
        metric: W, ``"identity"`` (the default) or (p, p).

    Returns:
        Positive when the estimate is the worse conditioned, inf when it has lost rank. NaN where the true one is rank
        deficient, the estimate zero, or an entry not finite.

    Raises:
        InvalidArray: Shapes that differ, or a metric that is none.
    """
    return per_posture(["log_condition_difference"], true, estimated, metric)["log_condition_difference"]


def manipulability_ratio(
    true: ArrayLike, estimated: ArrayLike, metric: Metric = "identity"
) -> Float[np.ndarray, "*batch"]:
    """Estimated over true manipulability ``sqrt(det(J W J'))``, the product of the singular values.

    Args:
        true: (*batch, m, p) [unit/rad].
        estimated: The same shape.
        metric: W, ``"identity"`` (the default) or (p, p).

    Returns:
        0 for an estimate that has lost rank. NaN where the true one is rank deficient or an entry is not finite.

    Raises:
        InvalidArray: Shapes that differ, or a metric that is none.
    """
    return per_posture(["manipulability_ratio"], true, estimated, metric)["manipulability_ratio"]


def row_space_angles(
    true: ArrayLike, estimated: ArrayLike, metric: Metric = "identity"
) -> Float[np.ndarray, "*batch k"]:
    """Principal angles between the row spaces of ``J W^1/2``, the joint motions that move the image at all.

    Args:
        true: (*batch, m, p) [unit/rad].
        estimated: The same shape.
        metric: W, ``"identity"`` (the default) or (p, p).

    Returns:
        k = min(m, p) angles in [0, pi/2] [rad], ascending. NaN where either is rank deficient (its row space is then
        smaller) or an entry is not finite.

    Raises:
        InvalidArray: Shapes that differ, or a metric that is none.
    """
    return per_posture(["row_space_angles"], true, estimated, metric)["row_space_angles"]


@np.errstate(all="ignore")
def pooled_relative_error(true: ArrayLike, estimated: ArrayLike, metric: Metric = "identity") -> float:
    """Relative error over all postures at once, ``sqrt(mean |E W^1/2|^2 / mean |J W^1/2|^2)``.

    Args:
        true: (*batch, m, p) [unit/rad].
        estimated: The same shape.
        metric: W, ``"identity"`` (the default) or (p, p).

    Returns:
        Dimensionless. Postures with a non-finite entry are left out; NaN when none is left or the true ones vanish.

    Raises:
        InvalidArray: Shapes that differ, or a metric that is none.
    """
    J, Jh = as_pair(true, estimated, ("true", "estimated"), ndim=2)
    root = metric_root(metric, J.shape[-1])
    # Entries near one, so that no square overflows or vanishes; powers of two lose no digit.
    (J, power), (Jh, estimated_power) = power_of_two(J), power_of_two(Jh)
    most = max(power, estimated_power)
    shrink, estimated_shrink = np.ldexp(1.0, [power - most, estimated_power - most])
    error = size = 0.0
    for _, pairs in chunks(J, Jh, root):
        error += float(((estimated_shrink * pairs.Jh - shrink * pairs.J) ** 2).sum())
        size += float((pairs.J**2).sum())
    return float(np.ldexp(np.sqrt(ratio(error, size)), most - power))


@np.errstate(all="ignore")
def pooled_scale_free_error(true: ArrayLike, estimated: ArrayLike, metric: Metric = "identity") -> float:
    """:func:`scale_free_error` with one scale for all postures, ``<A, B>`` being the mean of ``tr(A W B')`` over them.

    Args:
        true: (*batch, m, p) [unit/rad].
        estimated: The same shape.
        metric: W, ``"identity"`` (the default) or (p, p).

    Returns:
        In [0, 1]. Postures with a non-finite entry are left out; NaN when none is left or either vanishes.

    Raises:
        InvalidArray: Shapes that differ, or a metric that is none.
    """
    J, Jh = as_pair(true, estimated, ("true", "estimated"), ndim=2)
    root = metric_root(metric, J.shape[-1])
    (J, _), (Jh, _) = power_of_two(J), power_of_two(Jh)
    both = true_size = estimated_size = 0.0
    for _, pairs in chunks(J, Jh, root):
        both += float((pairs.J * pairs.Jh).sum())
        true_size, estimated_size = true_size + float((pairs.J**2).sum()), estimated_size + float((pairs.Jh**2).sum())
    error = 1 - ratio(both**2, true_size * estimated_size)
    return float(error.clip(min=0))


@np.errstate(all="ignore")
def displacement_error(predicted: ArrayLike, true_displacement: ArrayLike) -> float:
    """Relative RMS error of predicted displacements over a motion, ``sqrt(mean |d - J dq|^2 / mean |J dq|^2)``.

    The headline for an estimator that predicts displacements and has a Jacobian only by differentiation.

    Args:
        predicted: Predicted displacements of the hand image d, (*samples, m) [unit].
        true_displacement: The true ones, J dq or the change of the true image, of the same shape.

    Returns:
        Dimensionless, 1 for a prediction of zero. Rows not finite in either are left out; NaN when none is left or
        nothing truly moves.

    Raises:
        InvalidArray: Not two float arrays of one shape.
    """
    d, truth = as_pair(predicted, true_displacement, ("predicted", "true_displacement"), ndim=1)
    finite = np.isfinite(d).all(-1) & np.isfinite(truth).all(-1)
    return float(np.sqrt(ratio(((d[finite] - truth[finite]) ** 2).sum(), (truth[finite] ** 2).sum())))
