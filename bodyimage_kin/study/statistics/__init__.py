"""What can be said of scores: intervals, paired comparisons, correlations, and what many of them are worth.

The unit of resampling is what varies in the claim: recordings, bodies, conditions, families of estimators; never the
time step. What differs within a recording (first weights) is averaged first. Estimators are paired by seed, for they
learned from the same recordings. Embodiments are a fixed factor: strata, each resampled within itself and all of one
weight.

Intervals are bias-corrected and accelerated bootstraps (Efron 1987), p-values come from flipping the signs of paired
log-ratios, and are adjusted over the comparisons that are made together (Holm 1979).
"""

from bodyimage_kin._holm import holm
from bodyimage_kin.study.statistics.comparisons import Comparison, compare, sign_flip
from bodyimage_kin.study.statistics.intervals import (
    FEWEST,
    NEEDED,
    PUBLISHED,
    Interval,
    Scores,
    interval,
    ratio_of_sums,
    resampled,
    resampled_together,
)
from bodyimage_kin.study.statistics.medians import Pair, Spread, correlation, ranked, spread

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
    "ratio_of_sums",
    "resampled",
    "resampled_together",
    "sign_flip",
    "spread",
]
