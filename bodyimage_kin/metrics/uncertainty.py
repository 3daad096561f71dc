"""Whether a learner knows how wrong it is: scores of predicted distributions against what is true or was observed.

What is predicted is a vector of d numbers (an image, a displacement, the entries of a Jacobian, a taxel's place) with a
mean and a covariance, or as draws of it. Everything is in the unit of that vector, ``[unit]``.

A score of one prediction that is not finite is NaN; scores over predictions leave such ones out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.stats
from jaxtyping import Float

from bodyimage_kin._arrays import ArrayLike, Floats, as_float_array, as_pair
from bodyimage_kin._checks import number, numbers_of
from bodyimage_kin._shown import Shown
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.metrics._whitening import ratio

__all__ = [
    "Coverage",
    "Sparsification",
    "coverage",
    "crps",
    "crps_of_draws",
    "negative_log_likelihood",
    "sharpness",
    "sparsification",
    "uncertainty_scores",
]

_EPS = float(np.finfo(np.float64).eps)


def negative_log_likelihood(true: ArrayLike, mean: ArrayLike, covariance: ArrayLike) -> Float[np.ndarray, "*batch"]:
    """How surprising the truth is under a predicted normal distribution.

    ``(e' S^-1 e + log det S + d log 2 pi) / 2`` with ``e = true - mean``; Gneiting and Raftery, "Strictly proper
    scoring rules, prediction, and estimation" (2007).

    Args:
        true: (*batch, d) [unit].
        mean: The same shape.
        covariance: S, (*batch, d, d) [unit^2], positive semidefinite.

    Returns:
        In nats; it depends on the unit (a thousandfold unit takes ``d log 1000`` off). Where a direction is predicted
        without doubt, infinite if the truth is off along it, minus infinite if not.

    Raises:
        InvalidArray: Shapes that do not fit together, or a covariance that is none.
    """
    e, values, vectors = _errors(true, mean, covariance)
    squared = _mahalanobis_squared(e, values, vectors)
    with np.errstate(divide="ignore"):
        size = np.log(values).sum(-1)
    found = (squared + np.where(np.isinf(squared), 0, size) + e.shape[-1] * np.log(2 * np.pi)) / 2
    return np.asarray(found)


def crps(true: ArrayLike, mean: ArrayLike, sd: ArrayLike) -> Float[np.ndarray, "*batch"]:
    """Continuous ranked probability score of normal predictions, number by number.

    The integral over x of ``(F(x) - [x >= true])^2``: an absolute error for whole distributions. Closed form of
    Gneiting and Raftery (2007), equation 21.

    Args:
        true: Of any shape [unit].
        mean: The same shape.
        sd: Predicted standard deviation, of the same shape [unit]; 0 gives the absolute error.

    Returns:
        The same shape [unit], not negative.

    Raises:
        InvalidArray: Shapes that differ, or a standard deviation that is negative.
    """
    y, mu = as_pair(true, mean, ("true", "mean"))
    y, sigma = as_pair(y, sd, ("true", "sd"))
    if (sigma < 0).any():
        raise InvalidArray("sd has negative entries; give standard deviations")
    z = (y - mu) / np.where(sigma > 0, sigma, 1)
    certain = np.abs(y - mu)
    spread = z * (2 * scipy.stats.norm.cdf(z) - 1) + 2 * scipy.stats.norm.pdf(z) - 1 / np.sqrt(np.pi)
    return np.asarray(np.where(sigma == 0, certain, sigma * spread))


def crps_of_draws(true: ArrayLike, draws: ArrayLike) -> Float[np.ndarray, "*batch"]:
    """Continuous ranked probability score of predictions given as draws, number by number.

    ``mean |x_i - true| - mean |x_i - x_j| / 2`` over pairs of different draws, which has the mean of the score of the
    distribution itself however few they are: Ferro, "Fair scores for ensemble forecasts" (2014).

    Args:
        true: Of any shape [unit].
        draws: (draws, ...) [unit], at least two, each of the shape of the truth.

    Returns:
        The shape of the truth [unit]; with few draws some are negative.

    Raises:
        InvalidArray: Shapes that do not fit, or a single draw.
    """
    y, x = as_float_array(true, "true"), as_float_array(draws, "draws", ndim=1)
    if x.shape[1:] != y.shape or len(x) < 2:
        raise InvalidArray(f"draws have shape {x.shape} and true {y.shape}; give at least two draws (draws, *shape)")
    count = len(x)
    # Sorted, the sum over all pairs of |x_i - x_j| is one over ranks.
    weights = (2 * np.arange(count) - count + 1).reshape(-1, *[1] * y.ndim)
    apart = 2 * (weights * np.sort(x, axis=0)).sum(0) / (count * (count - 1))
    return np.asarray(np.abs(x - y).mean(0) - apart / 2)


@dataclass(frozen=True, eq=False)
class Coverage(Shown):
    """How often the truth lies within the region that is predicted to hold it.

    Attributes:
        levels: (levels,) what a sound prediction has.
        share: (levels,) what was found.
        lower: (levels,) of the interval of the share (Clopper and Pearson 1934).
        upper: (levels,) likewise.
        count: Predictions.
        confidence: Of the interval.
    """

    levels: Float[np.ndarray, "levels"]
    share: Float[np.ndarray, "levels"]
    lower: Float[np.ndarray, "levels"]
    upper: Float[np.ndarray, "levels"]
    count: int
    confidence: float


def coverage(
    true: ArrayLike,
    mean: ArrayLike,
    covariance: ArrayLike,
    levels: Sequence[float | int] = (0.5, 0.9, 0.95),
    confidence: float | int = 0.95,
) -> Coverage:
    """Share of truths within the predicted regions, ellipsoids of a normal distribution.

    The interval is exact for independent predictions. Neighbouring postures or taxels are none: resample blocks of them
    for an interval to publish.

    Args:
        true: (*batch, d) [unit].
        mean: The same shape.
        covariance: (*batch, d, d) [unit^2], positive semidefinite.
        levels: What the regions are meant to hold.
        confidence: Of the intervals.

    Returns:
        One share a level; NaN where no prediction is finite.

    Raises:
        InvalidArray: Shapes that do not fit together, or a covariance that is none.
        InvalidConfig: Levels or a confidence that are not between 0 and 1.
    """
    asked = np.array(numbers_of("levels", levels, above=0.0, below=1.0))
    sure = number("confidence", confidence, above=0.0, below=1.0)
    e, values, vectors = _errors(true, mean, covariance)
    squared = _mahalanobis_squared(e, values, vectors).ravel()
    squared = squared[~np.isnan(squared)]
    n, within = len(squared), (squared <= scipy.stats.chi2.ppf(asked, e.shape[-1])[:, None]).sum(1)
    nothing = np.full(len(asked), np.nan)
    if n == 0:
        return Coverage(asked, nothing, nothing, nothing, 0, sure)
    ends = [scipy.stats.binomtest(int(k), n).proportion_ci(sure, "exact") for k in within]
    lower, upper = np.array([(end.low, end.high) for end in ends]).reshape(-1, 2).T
    return Coverage(asked, within / n, lower, upper, n, sure)


def sharpness(covariance: ArrayLike) -> float:
    """Root of the mean squared error that is predicted, ``sqrt(mean tr S)``: how much a learner claims to know.

    Args:
        covariance: (*batch, d, d) [unit^2].

    Returns:
        To hold against the error that is made [unit]. Predictions that are not finite are left out; NaN when none is
        left.

    Raises:
        InvalidArray: Not an array of square matrices, or variances that are negative.
    """
    S = _square(covariance)
    variance = np.diagonal(S, axis1=-2, axis2=-1)[np.isfinite(S).all((-1, -2))]
    if (variance < 0).any():
        raise InvalidArray("covariance has negative variances")
    return float(np.sqrt(variance.sum(-1).mean())) if len(variance) else float("nan")


@dataclass(frozen=True, eq=False)
class Sparsification(Shown):
    """The error that is left when the predictions that are most in doubt are taken away.

    Attributes:
        kept: (predictions,) share that is left, from 1 down.
        error: (predictions,) root of the mean squared error of the rest [unit].
        best: (predictions,) the same when those with the largest errors are taken away: what perfect doubt would do.
        gain: Area between the curve and the error of all, over the same of the best: 1 of doubt that ranks errors
            perfectly, 0 of doubt at random, less of misplaced doubt.
    """

    kept: Float[np.ndarray, "predictions"]
    error: Float[np.ndarray, "predictions"]
    best: Float[np.ndarray, "predictions"]
    gain: float


def sparsification(error: ArrayLike, doubt: ArrayLike) -> Sparsification:
    """Whether large errors are where a learner doubts: the sparsification curve, and its best.

    See Ilg et al., "Uncertainty estimates and multi-hypotheses networks for optical flow" (2018). Predictions of equal
    doubt share their mean squared error.

    Args:
        error: Size of each prediction's error, (*batch) [unit].
        doubt: Predicted size of it, of the same shape, in any unit: only its order counts.

    Raises:
        InvalidArray: Not two arrays of numbers of one shape, or errors that are negative.
    """
    size, order = as_pair(error, doubt, ("error", "doubt"))
    known = np.isfinite(size) & ~np.isnan(order)
    squared, order = size[known].ravel() ** 2, order[known].ravel()
    if (size[known] < 0).any():
        raise InvalidArray("error has negative entries; give sizes of errors")
    if len(squared) == 0:
        nothing = np.empty(0)
        return Sparsification(nothing, nothing, nothing, float("nan"))
    _, group, count = np.unique(order, return_inverse=True, return_counts=True)
    shared = (np.bincount(group, squared) / count)[group]
    curves = []
    for values in (shared[np.argsort(order, kind="stable")], np.sort(squared)):
        # The first k have the least doubt; of all k, from all predictions down to one.
        curves.append(np.sqrt(np.cumsum(values) / np.arange(1, len(values) + 1))[::-1])
    whole = curves[0][0]
    gain = float(ratio((whole - curves[0]).sum(), (whole - curves[1]).sum()))
    return Sparsification(np.arange(len(squared), 0, -1) / len(squared), curves[0], curves[1], gain)


def uncertainty_scores(true: ArrayLike, mean: ArrayLike, covariance: ArrayLike) -> dict[str, float]:
    """Every score of predicted normal distributions that says something the others do not.

    Args:
        true: (*batch, d) [unit].
        mean: The same shape.
        covariance: (*batch, d, d) [unit^2], positive semidefinite.

    Returns:
        ``error`` (root mean square) beside ``sharpness``, the error that was predicted [unit];
        ``negative_log_likelihood`` (mean, nats), ``crps`` (mean over predictions and numbers [unit]), ``coverage_50``,
        ``coverage_90``, ``coverage_95`` and ``sparsification_gain``. NaN where no prediction is finite.

    Raises:
        InvalidArray: Shapes that do not fit together, or a covariance that is none.
    """
    y, mu = as_pair(true, mean, ("true", "mean"), ndim=1)
    S = _square(covariance)
    surprise = negative_log_likelihood(y, mu, S).ravel()
    known = ~np.isnan(surprise)
    d = y.shape[-1]
    y, mu, S = y.reshape(-1, d)[known], mu.reshape(-1, d)[known], S.reshape(-1, d, d)[known]
    variance = np.diagonal(S, axis1=-2, axis2=-1).clip(min=0)
    size = np.linalg.norm(y - mu, axis=-1)
    held = coverage(y, mu, S)
    mean_of = {
        "error": np.sqrt((size**2).mean()) if len(size) else np.nan,
        "sharpness": sharpness(S),
        "negative_log_likelihood": surprise[known].mean() if len(size) else np.nan,
        "crps": crps(y, mu, np.sqrt(variance)).mean() if len(size) else np.nan,
        **{f"coverage_{100 * level:.0f}": share for level, share in zip(held.levels, held.share, strict=True)},
        "sparsification_gain": sparsification(size, variance.sum(-1)).gain,
    }
    return {name: float(value) for name, value in mean_of.items()}


# Inner ---------------------------------------------------------------------------------------------------------------


def _square(covariance: ArrayLike) -> Floats:
    S = as_float_array(covariance, "covariance", ndim=2)
    if S.shape[-1] != S.shape[-2]:
        raise InvalidArray(f"covariance has shape {S.shape}; give (*batch, d, d)")
    return S


def _errors(true: ArrayLike, mean: ArrayLike, covariance: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Errors (*batch, d), NaN where anything is not finite; eigenvalues and eigenvectors of their covariances."""
    y, mu = as_pair(true, mean, ("true", "mean"), ndim=1)
    S = _square(covariance)
    if S.shape != (*y.shape, y.shape[-1]):
        raise InvalidArray(f"covariance has shape {S.shape}; true {y.shape} needs {(*y.shape, y.shape[-1])}")
    known = np.isfinite(y).all(-1) & np.isfinite(mu).all(-1) & np.isfinite(S).all((-1, -2))
    S = np.where(known[..., None, None], S, np.eye(y.shape[-1]))
    scale = np.abs(S).max((-1, -2), initial=0)
    if (np.abs(S - S.swapaxes(-1, -2)).max((-1, -2), initial=0) > 1e-9 * scale).any():
        raise InvalidArray("covariance must be symmetric")
    values, vectors = np.linalg.eigh((S + S.swapaxes(-1, -2)) / 2)
    if (values.min(-1, initial=np.inf) < -1e-9 * scale).any():
        raise InvalidArray(f"covariance must be positive semidefinite; its least eigenvalue is {values.min():.3g}")
    # Zero to rounding is zero: a direction predicted without doubt.
    values = np.where(values > y.shape[-1] * _EPS * values[..., -1:], values, 0)
    return np.where(known[..., None], y - mu, np.nan), values, vectors


def _mahalanobis_squared(e: Floats, values: Floats, vectors: Floats) -> Float[np.ndarray, "*batch"]:
    """``e' S^-1 e``; infinite where the error has a part along a direction predicted without doubt."""
    along = (vectors.swapaxes(-1, -2) @ np.nan_to_num(e)[..., None])[..., 0] ** 2
    none = along <= _EPS * np.maximum(values[..., -1:], along.max(-1, keepdims=True, initial=0) * _EPS)
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = np.where(values > 0, along / values, np.where(none, 0, np.inf))
    return np.where(np.isnan(e).any(-1), np.nan, parts.sum(-1))
