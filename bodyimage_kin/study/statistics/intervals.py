"""Intervals: of a mean over recordings, and of any statistic of any units."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy.stats
from jaxtyping import Float

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin.errors import InvalidArray, InvalidConfig, UnknownName

__all__ = [
    "FEWEST",
    "NEEDED",
    "PUBLISHED",
    "Interval",
    "Scores",
    "interval",
    "ratio_of_sums",
    "resampled",
    "resampled_together",
    "row",
    "strata",
]

Scores: TypeAlias = Any
"""(recordings,) or (recordings, weights) floats; or stratum -> such, where there are several."""
NEEDED: Mapping[str, int] = {"recordings": 30, "bodies": 20, "conditions": 20, "families": 20, "blocks": 20}
"""Unit of resampling -> how many of it an interval needs before it is fit to be published; with fewer there are
values."""
PUBLISHED = NEEDED["recordings"]
FEWEST = 8
"""Units below which there is no interval: a bootstrap of three has nothing but their least and their largest."""


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


def interval(scores: Scores, *, level: float | int = 0.95, resamples: int = 9999, seed: int = 0) -> Interval:
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
    _check(level, resamples)
    rows = [one[np.isfinite(one)] for one in strata(scores)]
    count = sum(map(len, rows))
    if any(len(one) == 0 for one in rows):
        return Interval(float("nan"), float("nan"), float("nan"), count)
    estimate = float(np.mean([one.mean() for one in rows]))
    if any(len(one) < FEWEST for one in rows):
        return Interval(estimate, float("nan"), float("nan"), count)
    if all(np.ptp(one) <= 1e-12 * max(1e-300, float(np.abs(one).max())) for one in rows):
        return Interval(estimate, estimate, estimate, count)

    def mean(*samples: np.ndarray, axis: int = -1) -> Any:
        return np.mean([sample.mean(axis=axis) for sample in samples], axis=0)

    found = scipy.stats.bootstrap(
        rows,
        mean,
        n_resamples=resamples,
        confidence_level=level,
        method="BCa",
        vectorized=True,
        batch=max(1, 10**6 // count),
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return Interval(estimate, float(found.low), float(found.high), count)


def ratio_of_sums(
    wrong: ArrayLike, size: ArrayLike, unit: str = "blocks", *, resamples: int = 9999, seed: int = 0
) -> Interval:
    """The root of the ratio of two sums over units, such as squared errors over squared sizes, with its BCa interval.

    Args:
        wrong: What each unit adds above.
        size: What it adds below; units are drawn anew with both.
        unit: What they are, one of :data:`NEEDED`.
        resamples: Number of bootstrap samples.
        seed: Of the resampling.

    Raises:
        InvalidArray: No rows of numbers.
    """

    def relative(top: np.ndarray, bottom: np.ndarray, axis: int = -1) -> np.ndarray:
        return np.asarray(np.sqrt(top.sum(axis) / bottom.sum(axis)))

    sums = row(wrong), row(size)
    rng = np.random.default_rng(seed)
    ends = scipy.stats.bootstrap(
        sums, relative, paired=True, vectorized=True, n_resamples=resamples, method="BCa", rng=rng
    ).confidence_interval
    return Interval(float(relative(*sums)), float(ends.low), float(ends.high), len(sums[0]), unit)


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
        statistic: Of places of units, (count,) whole numbers; whatever it fits, it fits to those alone. NaN: none.
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
    _check(level, resamples)
    (found,) = resampled_together(
        lambda drawn: (statistic(drawn),), units, unit, level=level, resamples=resamples, seed=seed
    )
    return found


def resampled_together(
    statistics: Callable[[np.ndarray], Sequence[float]],
    units: int,
    unit: str,
    *,
    level: float | int = 0.95,
    resamples: int = 2000,
    seed: int = 0,
) -> list[Interval]:
    """Several statistics of the same draws; arguments as of :func:`resampled`, and none drawn: no intervals."""
    if unit not in NEEDED:
        raise UnknownName("unit of resampling", unit, NEEDED)
    rng = np.random.default_rng(seed)
    count = resamples if units >= NEEDED[unit] else 0
    estimates = statistics(np.arange(units))
    drawn = np.array([statistics(rng.integers(units, size=units)) for _ in range(count)])
    found = []
    for index, estimate in enumerate(estimates):
        again = drawn[:, index] if count else drawn
        again = again[np.isfinite(again)]
        ends = np.quantile(again, [(1 - level) / 2, (1 + level) / 2]) if len(again) else (np.nan, np.nan)
        found.append(Interval(float(estimate), float(ends[0]), float(ends[1]), units, unit))
    return found


def row(values: ArrayLike) -> Float[np.ndarray, "units"]:
    """Numbers, one a unit.

    Raises:
        InvalidArray: No row of numbers.
    """
    found = _floats(values)
    if found.ndim != 1:
        raise InvalidArray(f"scores have shape {found.shape}; give a row, one a unit")
    return found


def strata(scores: Scores) -> list[Float[np.ndarray, "recordings"]]:
    """One row of recordings a stratum, what varies within a recording averaged.

    Raises:
        InvalidArray: No array of numbers.
    """
    found = []
    for values in scores.values() if isinstance(scores, Mapping) else [scores]:
        rows = _floats(values)
        if rows.ndim == 0:
            raise InvalidArray("scores must be (recordings,) or (recordings, weights); this is a single number")
        found.append(rows.reshape(len(rows), -1).mean(1) if rows.ndim > 1 else rows)
    return found


# Inner ---------------------------------------------------------------------------------------------------------------


def _check(level: float | int, resamples: int) -> None:
    if not 0 < level < 1 or resamples < 1:
        raise InvalidConfig(f"level={level!r}, resamples={resamples!r}: give a level between 0 and 1, and resamples")


def _floats(values: Scores) -> Float[np.ndarray, "..."]:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as problem:
        raise InvalidArray(f"scores are no array of numbers ({problem})") from None
