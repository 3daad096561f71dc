"""Medians and ranks: what can be said where a mean would be that of a few poles."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy.stats
from jaxtyping import Float, Int

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin._holm import holm
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.study.statistics.intervals import FEWEST, Interval, resampled, row

__all__ = ["Pair", "Spread", "correlation", "ranked", "spread"]

_NAN = float("nan")
_LEVEL = 0.95
"""Of confidence, of a median's interval."""


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


def spread(scores: ArrayLike) -> Spread:
    """Median, quantiles and share above one of a score over units, none of which a pole can move.

    The median's interval (of 95 %) is that between two of the values, by the binomial distribution of how many lie
    below it: no shape is assumed, and none is resampled.

    Args:
        scores: One a unit; NaN is none.

    Raises:
        InvalidArray: Not a row of numbers.
    """
    values = row(scores)
    values = values[~np.isnan(values)]
    if len(values) == 0:
        return Spread(_NAN, _NAN, _NAN, _NAN, _NAN, _NAN, 0)
    low, median, high = np.quantile(values, [0.1, 0.5, 0.9], method="nearest" if np.isinf(values).any() else "linear")
    lower, upper = _median_ends(values)
    return Spread(float(median), lower, upper, float(low), float(high), float((values > 1).mean()), units=len(values))


def ranked(scores: Mapping[str, ArrayLike]) -> dict[tuple[str, str], Pair]:
    """Every two estimators on the same units, the one of the smaller median first.

    Args:
        scores: Estimator -> positive scores, one a unit, in the same order; NaN where there is none.

    Raises:
        InvalidArray: Scores of different units.
    """
    rows = {name: row(values) for name, values in scores.items()}
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
        ratio, lower, upper = np.exp([np.median(log) if len(log) else np.nan, *_median_ends(log)]).tolist()
        found[first, second] = Pair(ratio, lower, upper, wins, int(both.sum()), p, p)
    adjusted = holm([pair.p for pair in found.values()])
    return {key: replace(pair, p_holm=float(p)) for (key, pair), p in zip(found.items(), adjusted, strict=True)}


def correlation(
    x: ArrayLike,
    y: ArrayLike,
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
    a, b = row(x), row(y)
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


# Inner ---------------------------------------------------------------------------------------------------------------


def _median_ends(values: Float[np.ndarray, "units"]) -> tuple[float, float]:
    """The narrowest pair of values, as many from either end, between which the median is this likely to lie."""
    if len(values) < FEWEST:
        return _NAN, _NAN
    k, inside = _left_out(len(values)), np.sort(values)
    return (float(inside[k]), float(inside[-1 - k])) if k >= 0 else (_NAN, _NAN)


def _ranks(places: Int[np.ndarray, "drawn"]) -> Float[np.ndarray, "drawn"]:
    """Ranks about their mean; those of one place share one."""
    occurs = np.bincount(places) if len(places) else np.zeros(0, dtype=np.int64)
    return np.asarray((np.cumsum(occurs) - (occurs - 1) / 2)[places] - (len(places) + 1) / 2)


@lru_cache(maxsize=256)
def _left_out(count: int) -> int:
    """How many values either end leaves out: the median lies beyond when no more of all values lie beyond it."""
    k = int(scipy.stats.binom.ppf((1 - _LEVEL) / 2, count, 0.5))
    return k if 2 * scipy.stats.binom.cdf(k, count, 0.5) <= 1 - _LEVEL else k - 1
