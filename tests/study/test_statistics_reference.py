"""Statistics held against values of others: scipy, the definitions written out, and published examples."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import pytest
import scipy.stats

from bodyimage_kin.study import statistics

# Skewed, as errors are: here the percentiles of the bootstrap and BCa differ by a fifth of the interval.
SKEWED = np.exp(1.1 * np.random.default_rng(11).standard_normal(18))
LESS = np.exp(0.6 * np.random.default_rng(12).standard_normal(9))
ENDS = ("lower", "upper")


def drawn_means(strata: Sequence[np.ndarray], count: int, seed: int) -> np.ndarray:
    """Means of bootstrap samples, each stratum drawn from itself."""
    rng = np.random.default_rng(seed)
    return np.mean([one[rng.integers(0, len(one), (count, len(one)))].mean(1) for one in strata], axis=0)


def bca_by_hand(strata: Sequence[np.ndarray], level: float, seed: int) -> tuple[float, float]:
    """Bias-corrected and accelerated, as Efron (1987) defines it, the acceleration from leaving one out."""
    means = drawn_means(strata, 60_000, seed)
    estimate = np.mean([one.mean() for one in strata])
    normal = scipy.stats.norm
    bias = normal.ppf(np.mean(means < estimate) + np.mean(means == estimate) / 2)
    cubes = squares = 0.0
    for index, one in enumerate(strata):
        others = [other.mean() for place, other in enumerate(strata) if place != index]
        left_out = np.array([np.mean([np.delete(one, k).mean(), *others]) for k in range(len(one))])
        influence = (len(one) - 1) * (left_out.mean() - left_out) / len(one)
        cubes, squares = cubes + (influence**3).sum(), squares + (influence**2).sum()
    acceleration = cubes / (6 * squares**1.5)
    ends = []
    for tail in ((1 - level) / 2, (1 + level) / 2):
        z = bias + normal.ppf(tail)
        ends.append(float(np.quantile(means, normal.cdf(bias + z / (1 - acceleration * z)))))
    return ends[0], ends[1]


@pytest.mark.parametrize("level", [0.8, 0.95])
@pytest.mark.parametrize("strata", [[SKEWED], [SKEWED, LESS], [LESS]])
def test_an_interval_is_bias_corrected_and_accelerated(strata: list[np.ndarray], level: float) -> None:
    scores = {str(index): one for index, one in enumerate(strata)} if len(strata) > 1 else strata[0]
    found = statistics.interval(scores, level=level)
    expected = bca_by_hand(strata, level, seed=5)
    percentile = np.quantile(drawn_means(strata, 60_000, seed=5), [(1 - level) / 2, (1 + level) / 2])
    width = expected[1] - expected[0]
    # The noise of ten thousand samples, well below what tells BCa from percentiles.
    for end, value in zip(ENDS, expected, strict=True):
        assert getattr(found, end) == pytest.approx(value, abs=0.03 * width)
    apart = max(abs(value - other) for value, other in zip(expected, percentile, strict=True))
    assert apart > 0.05 * width


@pytest.mark.parametrize("sample", [SKEWED, LESS, np.array([0.1, 0.2, 0.9, 0.15, 0.3, 0.12, 0.5, 0.22])])
def test_an_interval_is_the_one_of_scipy(sample: np.ndarray) -> None:
    found = statistics.interval(sample, level=0.9, resamples=4000, seed=3)
    rng = np.random.default_rng(3)
    wanted = scipy.stats.bootstrap((sample,), np.mean, confidence_level=0.9, n_resamples=4000, method="BCa", rng=rng)
    ends = wanted.confidence_interval
    assert (found.lower, found.upper) == pytest.approx((ends.low, ends.high), rel=1e-12)
    assert found.estimate == pytest.approx(sample.mean(), rel=1e-15)


def test_the_ratio_of_a_comparison_is_geometric_with_its_interval_in_the_logarithm() -> None:
    baseline = np.exp(np.random.default_rng(4).standard_normal(18))
    scores = {"base": baseline, "other": baseline * SKEWED}
    found = statistics.compare(scores, "base")["other"]
    lower, upper = bca_by_hand([np.log(SKEWED)], 0.95, seed=6)
    assert found.ratio.estimate == pytest.approx(scipy.stats.gmean(SKEWED))
    assert np.log([found.ratio.lower, found.ratio.upper]) == pytest.approx([lower, upper], abs=0.03 * (upper - lower))


def closed_testing(p: Sequence[float]) -> list[float]:
    """Adjusted p-values by testing every intersection of hypotheses with Bonferroni: what Holm's steps amount to."""
    sets = [one for size in range(1, len(p) + 1) for one in itertools.combinations(range(len(p)), size)]
    worth = {one: min(1.0, len(one) * min(p[k] for k in one)) for one in sets}
    return [max(worth[one] for one in sets if k in one) for k in range(len(p))]


@pytest.mark.parametrize(
    ("p", "adjusted"),
    [
        # By hand: sorted, times n, n - 1, ... 1, never below the one before.
        ([0.01, 0.02, 0.03, 0.04, 0.05], [0.05, 0.08, 0.09, 0.09, 0.09]),
        ([0.04, 0.01, 0.03, 0.005], [0.06, 0.03, 0.06, 0.02]),
        ([0.2, 0.2, 0.001], [0.4, 0.4, 0.003]),
        ([0.6, 0.7], [1.0, 1.0]),
    ],
)
def test_holm_by_hand(p: list[float], adjusted: list[float]) -> None:
    assert statistics.holm(p) == pytest.approx(adjusted)
    assert closed_testing(p) == pytest.approx(adjusted)


def test_holm_is_closed_testing() -> None:
    for p in np.random.default_rng(8).random((50, 6)) ** 3:
        assert statistics.holm(p) == pytest.approx(closed_testing(p))


def test_flipping_signs_gives_fisher_s_p_of_darwin_s_maize() -> None:
    # Differences of height of fifteen pairs [inch / 8] (Fisher 1935, section 21): 1,726 of 32,768 sums are as far out.
    inches = [49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48]
    assert statistics.sign_flip(inches) == pytest.approx(1726 / 32768)
