"""Why a learned Jacobian is wrong: by one scale, along motion it never saw, or in what changes with posture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bodyimage_kin._arrays import ArrayLike, Floats, as_float_array, as_pair
from bodyimage_kin._shown import Shown
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.metrics._whitening import Metric, metric_root, power_of_two
from bodyimage_kin.metrics.excitation import Excitation

__all__ = ["Attribution", "attribute"]


@dataclass(frozen=True)
class Attribution(Shown):
    """The squared pooled relative error as a sum of four orthogonal parts, each nonnegative and over |J|^2.

    A scale is what a monocular learner cannot know on a plane it never saw. It is not all that the first part holds: an
    error orthogonal to J shows up in it too (-J has 4, an orthogonal Jacobian of the same size has 1).
    ``scale_along_truth`` is the other projection of the error, under which only what lies along J counts; it is not one
    of the four, and what it leaves is not split further.

    Attributes:
        scale: ``(1 - s)^2 |Jh|^2``, the error along the estimate: what the best single scale takes away.
        mean_excited: ``|mean(s Jh - J) P|^2``: a constant error along directions that the training motion excited.
        mean_unexcited: ``|mean(s Jh - J) (I - P)|^2``: the same along those it did not; 0 where nothing says which.
        variation: ``mean |dev(s Jh - J)|^2``: what changes with posture, and no constant Jacobian can follow.
        best_scale: s = <Jh, J> / |Jh|^2; 0 for a zero estimate.
        scale_along_truth: ``(1 - s')^2``, the error along the truth, with s' = <Jh, J> / |J|^2.
    """

    scale: float
    mean_excited: float
    mean_unexcited: float
    variation: float
    best_scale: float
    scale_along_truth: float

    @property
    def total(self) -> float:
        """The sum of the parts, ``pooled_relative_error(...) ** 2``."""
        return self.scale + self.mean_excited + self.mean_unexcited + self.variation


@np.errstate(all="ignore")
def attribute(
    true: ArrayLike,
    estimated: ArrayLike,
    metric: Metric = "identity",
    excited: Excitation | ArrayLike | None = None,
) -> Attribution:
    """Attribute the error of any learned Jacobian over a set of postures, exactly.

    With ``<A, B> = mean of tr(A W B')`` over postures, s makes ``s Jh - J`` orthogonal to Jh, so the scale splits off
    by Pythagoras; mean and deviation over postures, and P and I - P, are orthogonal as well.

    Args:
        true: (*batch, m, p) [unit/rad].
        estimated: The same shape; for a displacement f(dq) the caller chooses which of its Jacobians.
        metric: W, ``"identity"`` (the default) or (p, p), such as :attr:`Excitation.motion_metric`.
        excited: Which motions training excited: an :class:`Excitation`, or P itself, (p, p), an orthogonal projector in
            the whitened space. None: nothing is known of it and the mean is not split; all of it is ``mean_excited``.

    Returns:
        The parts, whatever the scale of either Jacobian; infinite where the squared error is beyond floats. Postures
        with a non-finite entry are left out; everything is NaN when none is left or the true Jacobians vanish. A zero
        estimate has no scale: s is set to 0, the part is 0, the other parts sum to 1.

    Raises:
        InvalidArray: Shapes that differ, a metric that is none, or no orthogonal projector.
    """
    J, Jh = as_pair(true, estimated, ("true", "estimated"), ndim=2)
    P = _projector(excited, metric, J.shape[-1])
    finite = np.isfinite(J).all((-1, -2)) & np.isfinite(Jh).all((-1, -2))
    J, true_size, true_power = _whitened(J[finite], metric)
    Jh, estimated_size, estimated_power = _whitened(Jh[finite], metric)
    if not true_size > 0:
        return Attribution(*[float("nan")] * 6)
    # Both have entries near one now, whose squares neither overflow nor vanish: the estimate proper is `ratio` times
    # this one over the truth. Powers of two lose no digit.
    ratio = np.ldexp(1.0, estimated_power - true_power)
    both = np.vdot(Jh, J)
    s = both / estimated_size if estimated_size > 0 else np.float64(0)
    residual = s * Jh - J
    mean = residual.mean(0)
    deviation = residual - mean
    along = mean @ P
    best_scale = np.ldexp(s, true_power - estimated_power)
    # (1 - s)^2 of the Jacobians as they came; of an estimate so small that this has no float, of those near one.
    squared = np.ldexp(np.float_power(1 - best_scale, 2), 2 * (estimated_power - true_power))
    squared = squared if np.isfinite(best_scale**2) else (ratio - s) ** 2
    return Attribution(
        scale=float(squared * estimated_size / true_size) if estimated_size > 0 else 0.0,
        mean_excited=float((along**2).sum()) * len(J) / true_size,
        mean_unexcited=float(((mean - along) ** 2).sum()) * len(J) / true_size,
        variation=float(np.vdot(deviation, deviation)) / true_size,
        best_scale=float(best_scale),
        scale_along_truth=float((1 - (ratio * both if both else 0) / true_size) ** 2),
    )


def _whitened(J: Floats, metric: Metric) -> tuple[Float[np.ndarray, "postures m p"], float, int]:
    """``J W^1/2`` over a power of two that makes its largest entry about one, its squared size, and the exponent."""
    *_, m, p = J.shape
    J, power = power_of_two(J)
    root = metric_root(metric, p)
    if root is not None:
        J, more = power_of_two(J.reshape(-1, p) @ root)
        power += more
    J = J.reshape(-1, m, p)
    return J, float(np.vdot(J, J)), power


def _projector(excited: Excitation | ArrayLike | None, metric: Metric, p: int) -> Float[np.ndarray, "p p"]:
    if excited is None:
        return np.eye(p)
    P = (
        excited.projector(metric=metric)
        if isinstance(excited, Excitation)
        else as_float_array(excited, "excited", ndim=2)
    )
    if P.shape != (p, p) or not (np.abs(P - P.T).max() < 1e-9 and np.abs(P @ P - P).max() < 1e-9):
        raise InvalidArray(
            f"excited must be an Excitation of {p} joints, or an orthogonal projector, symmetric, ({p}, {p}) and its "
            "own square"
        )
    return P
