"""What can be said of scores over recordings: intervals, paired comparisons, and what many of them are worth.

The unit of resampling is the recording, never the time step; what differs within a recording (first weights) is
averaged first. Estimators are paired by seed, for they learned from the same recordings. Embodiments are a fixed
factor: strata, each resampled within itself and all of one weight.

Intervals are bias-corrected and accelerated bootstraps (Efron 1987), p-values come from flipping the signs of paired
log-ratios, and are adjusted over the comparisons that are made together (Holm 1979).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy.stats
from jaxtyping import Float

from bodyimage_kin.errors import InvalidArray, InvalidConfig, UnknownName

__all__ = ["PUBLISHED", "Comparison", "Interval", "Scores", "compare", "holm", "interval", "sign_flip"]

Scores: TypeAlias = Any
"""(recordings,) or (recordings, weights) floats; or stratum -> such, where there are several."""
PUBLISHED = 30
"""Recordings that an interval needs before it is fit to be published."""
_RESAMPLES = 9999
_FLIPS = 99_999
"""More, for the least p that so many can give is multiplied by the number of comparisons."""


@dataclass(frozen=True)
class Interval:
    """A mean over recordings and its interval.

    Attributes:
        estimate: The mean; of several strata, the mean of their means.
        lower: NaN with fewer than three recordings in a stratum.
        upper: Likewise.
        recordings: Number of recordings.
    """

    estimate: float
    lower: float
    upper: float
    recordings: int

    @property
    def publishable(self) -> bool:
        """Whether enough recordings stand behind it (:data:`PUBLISHED`)."""
        return self.recordings >= PUBLISHED and math.isfinite(self.lower)


@dataclass(frozen=True)
class Comparison:
    """One estimator against a baseline, on the same recordings.

    Attributes:
        ratio: Geometric mean of score over the baseline's score, and its interval; below one: a smaller score.
        p: Two-sided, of no difference.
        p_holm: The same, adjusted over the comparisons made together; p itself for one alone.
    """

    ratio: Interval
    p: float
    p_holm: float


def interval(scores: Scores, *, level: float | int = 0.95, resamples: int = _RESAMPLES, seed: int = 0) -> Interval:
    """The mean over recordings with its BCa bootstrap interval.

    Args:
        scores: One row a recording; further axes are averaged first. Rows that are not finite are left out.
        level: Of confidence.
        resamples: Number of bootstrap samples.
        seed: Of the resampling.

    Raises:
        InvalidArray: No array of numbers.
        InvalidConfig: A level outside 0 to 1, or no resamples.
    """
    if not 0 < level < 1 or resamples < 1:
        raise InvalidConfig(f"level={level!r}, resamples={resamples!r}: give a level between 0 and 1, and resamples")
    strata = [one[np.isfinite(one)] for one in _strata(scores)]
    count = sum(map(len, strata))
    if any(len(one) == 0 for one in strata):
        return Interval(float("nan"), float("nan"), float("nan"), count)
    estimate = float(np.mean([one.mean() for one in strata]))
    if any(len(one) < 3 for one in strata):
        return Interval(estimate, float("nan"), float("nan"), count)
    if all(np.ptp(one) <= 1e-12 * max(1e-300, float(np.abs(one).max())) for one in strata):
        return Interval(estimate, estimate, estimate, count)

    def mean(*samples: np.ndarray, axis: int = -1) -> Any:
        return np.mean([sample.mean(axis=axis) for sample in samples], axis=0)

    found = scipy.stats.bootstrap(
        strata,
        mean,
        n_resamples=resamples,
        confidence_level=level,
        method="BCa",
        vectorized=True,
        batch=max(1, 10**6 // count),
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return Interval(estimate, float(found.low), float(found.high), count)


def sign_flip(differences: Scores, *, resamples: int = _FLIPS, seed: int = 0) -> float:
    """Two-sided p of paired differences being as likely of either sign: the sign-flip permutation test.

    Args:
        differences: One a recording, such as log-ratios; as in :func:`interval`. Zero differences stay zero.
        resamples: All flips are tried where there are no more than this, else so many at random.
        seed: Of random flips.

    Returns:
        NaN without any finite difference.

    Raises:
        InvalidArray: No array of numbers.
    """
    strata = [one[np.isfinite(one)] for one in _strata(differences)]
    values = np.concatenate(strata)
    if any(len(one) == 0 for one in strata):
        return float("nan")
    # Each stratum weighs the same, whatever the number of its recordings.
    values = np.concatenate([one / len(one) for one in strata])
    # Of one difference alone, either sign is as far from zero.
    if not values.any() or len(values) == 1:
        return 1.0

    def total(sample: np.ndarray, axis: int = -1) -> Any:
        return sample.sum(axis=axis)

    found = scipy.stats.permutation_test(
        (values,),
        total,
        permutation_type="samples",
        vectorized=True,
        n_resamples=resamples,
        batch=max(1, 10**6 // len(values)),
        rng=np.random.default_rng(seed),
    )
    return float(found.pvalue)


def holm(p: Scores) -> Float[np.ndarray, "comparisons"]:
    """P-values adjusted over comparisons made together, so that the chance of any false one stays below the level.

    Holm's step-down: the k-th smallest of n times n - k + 1, never less than a smaller one's, at most 1. A NaN is no
    comparison and stays NaN.

    Raises:
        InvalidArray: Not a row of numbers between 0 and 1.
    """
    values = _floats(p)
    made = np.isfinite(values)
    if values.ndim != 1 or ((values[made] < 0) | (values[made] > 1)).any():
        raise InvalidArray("p-values must be a row of numbers between 0 and 1")
    adjusted = np.full(values.shape, np.nan)
    order = np.flatnonzero(made)[np.argsort(values[made], kind="stable")]
    factors = np.arange(len(order), 0, -1)
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(values[order] * factors)) if len(order) else []
    return adjusted


def compare(
    scores: Mapping[str, Scores], baseline: str, *, level: float | int = 0.95, seed: int = 0
) -> dict[str, Comparison]:
    """Every estimator against one of them, by paired log-ratios of positive scores.

    Args:
        scores: Estimator -> scores of the same recordings in the same order, as in :func:`interval`. Recordings in
            which either failed (not finite) are left out of that pair.
        baseline: Name of the estimator they are held against.
        level: Of confidence.
        seed: Of resampling.

    Returns:
        Estimator -> comparison, the baseline's own left out. A recording with a score that is not positive has no ratio
        and is left out as well.

    Raises:
        UnknownName: No such baseline.
        InvalidArray: Scores of different recordings.
    """
    if baseline not in scores:
        raise UnknownName("estimator to compare with", baseline, scores)
    others = [name for name in scores if name != baseline]
    ratios = {name: _log_ratios(scores[name], scores[baseline], (name, baseline)) for name in others}
    p = [sign_flip(ratios[name], seed=seed) for name in others]
    found = {}
    for name, one, adjusted in zip(others, p, holm(p), strict=True):
        log = interval(ratios[name], level=level, seed=seed)
        estimate, lower, upper = (float(np.exp(end)) for end in (log.estimate, log.lower, log.upper))
        ratio = Interval(estimate, lower, upper, log.recordings)
        found[name] = Comparison(ratio, one, float(adjusted))
    return found


# Inner ---------------------------------------------------------------------------------------------------------------


def _floats(values: Scores) -> Float[np.ndarray, "..."]:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as problem:
        raise InvalidArray(f"scores are no array of numbers ({problem})") from None


def _strata(scores: Scores) -> list[Float[np.ndarray, "recordings"]]:
    """One row of recordings a stratum, what varies within a recording averaged."""
    found = []
    for values in scores.values() if isinstance(scores, Mapping) else [scores]:
        rows = _floats(values)
        if rows.ndim == 0:
            raise InvalidArray("scores must be (recordings,) or (recordings, weights); this is a single number")
        found.append(rows.reshape(len(rows), -1).mean(1) if rows.ndim > 1 else rows)
    return found


def _log_ratios(scores: Scores, baseline: Scores, names: tuple[str, str]) -> dict[str, np.ndarray]:
    """Stratum -> log-ratio of each recording; NaN where either has none."""
    ones, others = _strata(scores), _strata(baseline)
    if [len(one) for one in ones] != [len(other) for other in others]:
        raise InvalidArray(f"scores of {names[0]!r} and {names[1]!r} are not of the same recordings")
    found = {}
    for index, (one, other) in enumerate(zip(ones, others, strict=True)):
        positive = (one > 0) & (other > 0)
        found[str(index)] = np.log(np.where(positive, one, np.nan)) - np.log(np.where(positive, other, np.nan))
    return found
