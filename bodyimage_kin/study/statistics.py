"""What can be said of scores: intervals, paired comparisons, correlations, and what many of them are worth.

The unit of resampling is what varies in the claim: recordings, bodies, conditions, families of estimators; never the
time step. What differs within a recording (first weights) is averaged first. Estimators are paired by seed, for they
learned from the same recordings. Embodiments are a fixed factor: strata, each resampled within itself and all of one
weight.

Intervals are bias-corrected and accelerated bootstraps (Efron 1987), p-values come from flipping the signs of paired
log-ratios, and are adjusted over the comparisons that are made together (Holm 1979).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
import scipy.stats
from jaxtyping import Float, Int

from bodyimage_kin._holm import holm
from bodyimage_kin.errors import InvalidArray, InvalidConfig, UnknownName

__all__ = [
    "FEWEST",
    "NEEDED",
    "PUBLISHED",
    "Comparison",
    "Interval",
    "Pair",
    "Scores",
    "Spread",
    "compare",
    "correlation",
    "holm",
    "interval",
    "ranked",
    "resampled",
    "sign_flip",
    "spread",
]

Scores: TypeAlias = Any
"""(recordings,) or (recordings, weights) floats; or stratum -> such, where there are several."""
NEEDED: Mapping[str, int] = {"recordings": 30, "bodies": 20, "conditions": 20, "families": 20, "blocks": 20}
"""Unit of resampling -> how many of it an interval needs before it is fit to be published; with fewer there are
values."""
PUBLISHED = NEEDED["recordings"]
FEWEST = 8
"""Units below which there is no interval: a bootstrap of three has nothing but their least and their largest."""
_NAN = float("nan")
_RESAMPLES = 9999
_FLIPS = 99_999
"""More, for the least p that so many can give is multiplied by the number of comparisons."""


@dataclass(frozen=True)
class Interval:
    """An estimate, usually a mean over recordings, and its interval.

    Attributes:
        estimate: The mean; of several strata, the mean of their means.
        lower: NaN with fewer than :data:`FEWEST` units in a stratum.
        upper: Likewise.
        units: Number of units.
        unit: What was resampled, one of :data:`NEEDED`.
    """

    estimate: float
    lower: float
    upper: float
    units: int
    unit: str = "recordings"

    @property
    def publishable(self) -> bool:
        """Whether enough units stand behind it (:data:`NEEDED`)."""
        return self.units >= NEEDED[self.unit] and math.isfinite(self.lower)


@dataclass(frozen=True)
class Spread:
    """How a positive score is spread over units: what can be said where a mean would be that of a few poles.

    Attributes:
        median: Over the units.
        lower: End of the median's interval, between two of the values; NaN with fewer than :data:`FEWEST` units.
        upper: Likewise.
        low: The tenth percentile of the units.
        high: The ninetieth.
        above_one: Share of units above 1, the relative error of a Jacobian of zeros.
        units: How many have a score; one that is infinite has.
    """

    median: float
    lower: float
    upper: float
    low: float
    high: float
    above_one: float
    units: int


@dataclass(frozen=True)
class Pair:
    """Two estimators on the same units.

    Attributes:
        ratio: Median over units of the first's score over the second's; below one: the first scores less.
        lower: End of its interval, as in :class:`Spread`.
        upper: Likewise.
        wins: Number of units on which the first scores less.
        units: Number of units on which both have a score.
        p: Two-sided, of either being as likely to score less: the sign test, which no pole can move.
        p_holm: The same, adjusted over all pairs that were made together.
    """

    ratio: float
    lower: float
    upper: float
    wins: int
    units: int
    p: float
    p_holm: float


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
    if any(len(one) < FEWEST for one in strata):
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
        ratio = Interval(estimate, lower, upper, log.units)
        found[name] = Comparison(ratio, one, float(adjusted))
    return found


def spread(scores: Any, *, level: float | int = 0.95) -> Spread:
    """Median, quantiles and share above one of a score over units, none of which a pole can move.

    The median's interval is that between two of the values, by the binomial distribution of how many lie below it: no
    shape is assumed, and none is resampled.

    Args:
        scores: One a unit; NaN is none.
        level: Of confidence.

    Raises:
        InvalidArray: Not a row of numbers.
        InvalidConfig: A level outside 0 to 1.
    """
    values = _row(scores)
    values = values[~np.isnan(values)]
    if len(values) == 0:
        return Spread(_NAN, _NAN, _NAN, _NAN, _NAN, _NAN, 0)
    low, median, high = np.quantile(values, [0.1, 0.5, 0.9], method="nearest" if np.isinf(values).any() else "linear")
    lower, upper = _median_ends(values, level)
    return Spread(float(median), lower, upper, float(low), float(high), float((values > 1).mean()), units=len(values))


def ranked(scores: Mapping[str, Any], *, level: float | int = 0.95) -> dict[tuple[str, str], Pair]:
    """Every two estimators on the same units, the one of the smaller median first.

    Args:
        scores: Estimator -> positive scores, one a unit, in the same order; NaN where there is none.
        level: Of confidence.

    Raises:
        InvalidArray: Scores of different units.
        InvalidConfig: A level outside 0 to 1.
    """
    rows = {name: _row(values) for name, values in scores.items()}
    if len({len(values) for values in rows.values()}) > 1:
        raise InvalidArray("scores are not of the same units: " + ", ".join(f"{k} {len(v)}" for k, v in rows.items()))
    order = sorted(rows, key=lambda name: spread(rows[name]).median)
    found = {}
    for first, second in itertools.combinations(order, 2):
        one, other = rows[first], rows[second]
        both = ~(np.isnan(one) | np.isnan(other)) & (one > 0) & (other > 0)
        # Two that are both beyond bounds are equal.
        with np.errstate(invalid="ignore"):
            log = np.nan_to_num(np.log(one[both]) - np.log(other[both]), nan=0.0, posinf=np.inf, neginf=-np.inf)
        wins, losses = int((log < 0).sum()), int((log > 0).sum())
        p = float(scipy.stats.binomtest(wins, wins + losses).pvalue) if wins + losses else 1.0
        ratio, lower, upper = np.exp([np.median(log) if len(log) else np.nan, *_median_ends(log, level)]).tolist()
        found[first, second] = Pair(ratio, lower, upper, wins, int(both.sum()), p, p)
    adjusted = holm([pair.p for pair in found.values()])
    return {key: replace(pair, p_holm=float(p)) for (key, pair), p in zip(found.items(), adjusted, strict=True)}


def correlation(
    x: Any,
    y: Any,
    families: Sequence[str] | None = None,
    *,
    level: float | int = 0.95,
    resamples: int = 2000,
    seed: int = 0,
) -> Interval:
    """Spearman's rank correlation over estimators, each family once.

    Near copies of one estimator are one finding, so the ranks of a family are averaged before families are ranked, and
    families are what is resampled.

    Args:
        x: A score, one an estimator, such as its median over recordings; NaN where there is none.
        y: Another.
        families: Family of each estimator; None: each is one of its own.
        level: Of confidence.
        resamples: Number of bootstrap samples.
        seed: Of the resampling.

    Returns:
        With too few families to publish an interval (:data:`NEEDED`) its ends are NaN.

    Raises:
        InvalidArray: Not as many of each.
    """
    a, b = _row(x), _row(y)
    names = list(map(str, range(len(a)))) if families is None else list(families)
    if not len(a) == len(b) == len(names):
        raise InvalidArray(f"{len(a)} and {len(b)} scores of {len(names)} estimators; give one of each")
    there = ~(np.isnan(a) | np.isnan(b))
    label = np.array(names)[there]
    ranked_values = [scipy.stats.rankdata(values[there]) for values in (a, b)]
    # Places of families among each other, equal ones alike.
    of = [
        np.unique([values[label == family].mean() for family in dict.fromkeys(label)], return_inverse=True)[1]
        for values in ranked_values
    ]

    def ranks(drawn: np.ndarray) -> float:
        one, other = (_ranks(places[drawn]) for places in of)
        size = math.sqrt((one @ one) * (other @ other)) if len(drawn) > 2 else 0.0
        return float(one @ other) / size if size > 0 else _NAN

    return resampled(ranks, len(of[0]), "families", level=level, resamples=resamples, seed=seed)


def resampled(
    statistic: Callable[[np.ndarray], float],
    units: int,
    unit: str,
    *,
    level: float | int = 0.95,
    resamples: int = 2000,
    seed: int = 0,
) -> Interval:
    """A statistic of units and its percentile interval, units drawn anew and everything inside computed anew.

    Args:
        statistic: Of places of units, (count,) whole numbers; whatever it fits, it fits to those alone.
        units: How many there are.
        unit: What they are, one of :data:`NEEDED`.
        level: Of confidence.
        resamples: Number of bootstrap samples.
        seed: Of the resampling.

    Returns:
        With too few units to publish an interval its ends are NaN.

    Raises:
        UnknownName: Another unit.
        InvalidConfig: A level outside 0 to 1, or no resamples.
    """
    if unit not in NEEDED:
        raise UnknownName("unit of resampling", unit, NEEDED)
    if not 0 < level < 1 or resamples < 1:
        raise InvalidConfig(f"level={level!r}, resamples={resamples!r}: give a level between 0 and 1, and resamples")
    estimate = float(statistic(np.arange(units)))
    if units < NEEDED[unit]:
        return Interval(estimate, float("nan"), float("nan"), units, unit)
    rng = np.random.default_rng(seed)
    again = np.array([statistic(rng.integers(units, size=units)) for _ in range(resamples)])
    again = again[np.isfinite(again)]
    ends = np.quantile(again, [(1 - level) / 2, (1 + level) / 2]) if len(again) else (np.nan, np.nan)
    return Interval(estimate, float(ends[0]), float(ends[1]), units, unit)


# Inner ---------------------------------------------------------------------------------------------------------------


def _floats(values: Scores) -> Float[np.ndarray, "..."]:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as problem:
        raise InvalidArray(f"scores are no array of numbers ({problem})") from None


def _row(values: Any) -> Float[np.ndarray, "units"]:
    row = _floats(values)
    if row.ndim != 1:
        raise InvalidArray(f"scores have shape {row.shape}; give a row, one a unit")
    return row


def _median_ends(values: Float[np.ndarray, "units"], level: float) -> tuple[float, float]:
    """The narrowest pair of values, as many from either end, between which the median is this likely to lie."""
    if not 0 < level < 1:
        raise InvalidConfig(f"level={level!r}: give a level between 0 and 1")
    if len(values) < FEWEST:
        return float("nan"), float("nan")
    k, inside = _left_out(len(values), float(level)), np.sort(values)
    return (float(inside[k]), float(inside[-1 - k])) if k >= 0 else (_NAN, _NAN)


def _ranks(places: Int[np.ndarray, "drawn"]) -> Float[np.ndarray, "drawn"]:
    """Ranks about their mean; those of one place share one."""
    occurs = np.bincount(places) if len(places) else np.zeros(0, dtype=np.int64)
    return np.asarray((np.cumsum(occurs) - (occurs - 1) / 2)[places] - (len(places) + 1) / 2)


@lru_cache(maxsize=256)
def _left_out(count: int, level: float) -> int:
    """How many values either end leaves out: the median lies beyond when no more of all values lie beyond it."""
    k = int(scipy.stats.binom.ppf((1 - level) / 2, count, 0.5))
    return k if 2 * scipy.stats.binom.cdf(k, count, 0.5) <= 1 - level else k - 1


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
