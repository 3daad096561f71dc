"""One estimator against another on the same recordings: paired ratios, and how likely chance alone made them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.stats

from bodyimage_kin._holm import holm
from bodyimage_kin.errors import InvalidArray, UnknownName
from bodyimage_kin.study.statistics.intervals import Interval, Scores, interval, strata

__all__ = ["Comparison", "compare", "sign_flip"]

_FLIPS = 99_999
"""More than for an interval: the least p that so many can give is multiplied by the number of comparisons."""


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


def sign_flip(differences: Scores, *, seed: int = 0) -> float:
    """Two-sided p of paired differences being as likely of either sign: the sign-flip permutation test.

    All flips are tried where they are no more than 99,999, else so many at random.

    Args:
        differences: One a recording, such as log-ratios; as in :func:`interval`. Zero differences stay zero.
        seed: Of random flips.

    Returns:
        NaN without any finite difference.

    Raises:
        InvalidArray: No array of numbers.
    """
    rows = [one[np.isfinite(one)] for one in strata(differences)]
    values = np.concatenate(rows)
    if any(len(one) == 0 for one in rows):
        return float("nan")
    # Each stratum weighs the same, whatever the number of its recordings.
    values = np.concatenate([one / len(one) for one in rows])
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
        n_resamples=_FLIPS,
        batch=max(1, 10**6 // len(values)),
        rng=np.random.default_rng(seed),
    )
    return float(found.pvalue)


def compare(scores: Mapping[str, Scores], baseline: str, *, seed: int = 0) -> dict[str, Comparison]:
    """Every estimator against one of them, by paired log-ratios of positive scores; intervals are of 95 %.

    Args:
        scores: Estimator -> scores of the same recordings in the same order, as in :func:`interval`. Recordings in
            which either failed (not finite) are left out of that pair.
        baseline: Name of the estimator they are held against.
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
        log = interval(ratios[name], seed=seed)
        estimate, lower, upper = (float(np.exp(end)) for end in (log.estimate, log.lower, log.upper))
        ratio = Interval(estimate, lower, upper, log.units)
        found[name] = Comparison(ratio, one, float(adjusted))
    return found


# Inner ---------------------------------------------------------------------------------------------------------------


def _log_ratios(scores: Scores, baseline: Scores, names: tuple[str, str]) -> dict[str, np.ndarray]:
    """Stratum -> log-ratio of each recording; NaN where either has none."""
    ones, others = strata(scores), strata(baseline)
    if [len(one) for one in ones] != [len(other) for other in others]:
        raise InvalidArray(f"scores of {names[0]!r} and {names[1]!r} are not of the same recordings")
    found = {}
    for index, (one, other) in enumerate(zip(ones, others, strict=True)):
        positive = (one > 0) & (other > 0)
        found[str(index)] = np.log(np.where(positive, one, np.nan)) - np.log(np.where(positive, other, np.nan))
    return found
