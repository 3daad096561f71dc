"""What the evidence cannot tell of a body, and how well it tells the rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from bodyimage_kin.estimators.map_fit import Fit
from bodyimage_kin.estimators.parametric import Parameter

__all__ = ["observability_indices", "unobservable"]

UNTOLD = 0.9
"""A direction whose posterior is wider than this share of its prior was told by the prior alone."""
_TOLD = 1e-9
"""Share of the largest singular value below which a direction is not told at all."""
_NAMED = 0.5
"""Share of the largest component of a direction from which a parameter is named."""
_MOST_NAMED = 3


def unobservable(fit: Fit, parameters: Sequence[Parameter]) -> tuple[str, ...]:
    """Directions of the parameters that the evidence does not tell, in words, the least told first.

    They are eigenvectors of the posterior covariance in units of the prior (of radians and metres where there is
    none), whose standard deviation is above :data:`UNTOLD`. A direction that mixes several parameters names those that
    have most of it: only what they share is not told.

    Args:
        fit: The fit.
        parameters: Of all its numbers.
    """
    free = np.flatnonzero(fit.free)
    if not len(free):
        return ()
    scale = np.where(np.isfinite(fit.sd), fit.sd, 1.0)[free]
    information = fit.information[np.ix_(free, free)] * np.outer(scale, scale)
    precision = information + np.diag(np.isfinite(fit.sd[free]).astype(float))
    values, vectors = np.linalg.eigh(precision)
    found = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value > 0 and value**-0.5 <= UNTOLD:
            break
        size = np.abs(vector)
        order = [index for index in np.argsort(-size, kind="stable") if size[index] >= _NAMED * size.max()]
        named = [parameters[free[index]].name for index in order[:_MOST_NAMED]]
        found.append(" with ".join(named) + (" and others" if len(order) > _MOST_NAMED else ""))
    return tuple(found)


def observability_indices(fit: Fit) -> dict[str, float]:
    """O1 to O5 of the evidence (Joubair and Bonev 2013), of its Jacobian in units of prior and noise.

    With singular values s_1 >= ... >= s_L of the scaled Jacobian of N observed coordinates and L free parameters:
    O1 = (s_1 ... s_L)^(1/L) / sqrt(N), O2 = s_L / s_1, O3 = s_L, O4 = s_L^2 / s_1, O5 = 1 / sum 1/s_i. All are larger
    the better the evidence tells the parameters. Directions that it does not tell at all (a slide of an origin along
    its own axis) would make all of them zero: L counts those that it tells, ``told`` of them.

    Args:
        fit: The fit.
    """
    free = np.flatnonzero(fit.free)
    scale = np.where(np.isfinite(fit.sd), fit.sd, 1.0)[free]
    rows = [
        (slope[:, :, free] / width * scale).reshape(-1, len(free))
        for slope, width in zip(fit.slopes, fit.sigma, strict=True)
    ]
    jacobian = np.concatenate(rows) if rows else np.zeros((0, len(free)))
    if not len(free) or not jacobian.size:
        return dict.fromkeys(("told", "O1", "O2", "O3", "O4", "O5"), 0.0)
    values: Float[np.ndarray, "free"] = np.linalg.svd(jacobian, compute_uv=False)
    values = values[values > _TOLD * values[0]]
    first, last = float(values[0]), float(values[-1])
    return {
        "told": float(len(values)),
        "O1": float(np.exp(np.log(values).mean())) / len(jacobian) ** 0.5,
        "O2": last / first,
        "O3": last,
        "O4": last**2 / first,
        "O5": 1.0 / float((1.0 / values).sum()),
    }
