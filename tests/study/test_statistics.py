"""Statistics over recordings: covered as often as they say, false as seldom as they say, and of the right units."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from bodyimage_kin.errors import InvalidArray, InvalidConfig, UnknownName
from bodyimage_kin.study import statistics


def test_an_interval_covers_the_mean_as_often_as_it_says():
    rng = np.random.default_rng(1)
    # Skewed, as errors are: the mean of a log-normal is exp(1/8).
    samples = np.exp(0.5 * rng.standard_normal((300, 30)))
    found = [statistics.interval(sample, resamples=500) for sample in samples]
    covered = np.mean([one.lower <= np.exp(0.125) <= one.upper for one in found])
    assert 0.88 < covered <= 0.98


def test_first_weights_are_averaged_before_recordings_are_resampled():
    rng = np.random.default_rng(2)
    recordings = rng.standard_normal(8)
    within = rng.standard_normal((8, 50))
    many = recordings[:, None] + within - within.mean(1, keepdims=True)
    one, other = statistics.interval(recordings), statistics.interval(many)
    assert other.recordings == 8
    np.testing.assert_allclose(
        [other.estimate, other.lower, other.upper], [one.estimate, one.lower, one.upper], atol=0.01
    )


def test_a_recording_that_failed_is_left_out():
    sample = np.array([1.0, 2.0, 4.0, 7.0])
    assert statistics.interval([*sample, np.nan]) == statistics.interval(sample)


def test_strata_weigh_the_same_and_their_difference_does_not_widen_the_interval():
    rng = np.random.default_rng(3)
    small, large = rng.normal(0.0, 0.1, 40), rng.normal(10.0, 0.1, 20)
    found = statistics.interval({"small": small, "large": large})
    assert found.estimate == pytest.approx((small.mean() + large.mean()) / 2)
    assert found.upper - found.lower < 0.1


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_recordings_have_no_interval(count):
    found = statistics.interval(np.arange(count, dtype=float))
    assert np.isnan([found.lower, found.upper]).all()
    assert not found.publishable


def test_an_interval_is_published_from_thirty_recordings_on():
    sample = np.random.default_rng(4).random(30)
    assert statistics.interval(sample).publishable
    assert not statistics.interval(sample[:29]).publishable


def test_equal_scores_have_an_interval_of_no_width():
    found = statistics.interval(np.full(5, 0.25))
    assert (found.estimate, found.lower, found.upper) == (0.25, 0.25, 0.25)


def test_flipping_signs_counts_all_flips():
    differences = np.array([0.3, -0.1, 0.5, 0.2, 0.4])
    flips = [abs(np.dot(signs, differences)) for signs in itertools.product((-1, 1), repeat=5)]
    wanted = np.mean(np.array(flips) >= abs(differences.sum()) - 1e-12)
    assert statistics.sign_flip(differences) == pytest.approx(wanted)


def test_strata_weigh_the_same_when_signs_are_flipped():
    strata = {"small": [0.3, 0.1, 0.2, 0.4, -0.1, 0.2], "large": [-0.5, -0.2]}
    weighted = np.concatenate([np.array(one) / len(one) for one in strata.values()])
    flips = [abs(np.dot(signs, weighted)) for signs in itertools.product((-1, 1), repeat=8)]
    wanted = np.mean(np.array(flips) >= abs(weighted.sum()) - 1e-12)
    assert statistics.sign_flip(strata) == pytest.approx(wanted)


def test_no_difference_is_found_as_seldom_as_it_should():
    rng = np.random.default_rng(5)
    p = np.array([statistics.sign_flip(sample) for sample in rng.standard_normal((400, 8))])
    assert np.mean(p <= 0.05) == pytest.approx(0.05, abs=0.03)
    assert statistics.sign_flip(np.zeros(6)) == 1.0
    assert statistics.sign_flip([0.3]) == 1.0
    assert np.isnan(statistics.sign_flip([]))


def test_holm_steps_down():
    np.testing.assert_allclose(statistics.holm([0.01, 0.04, 0.03]), [0.03, 0.06, 0.06])
    np.testing.assert_allclose(statistics.holm([0.5, np.nan, 0.9]), [1.0, np.nan, 1.0])
    assert len(statistics.holm([])) == 0


def test_holm_keeps_any_false_finding_seldom():
    rng = np.random.default_rng(6)
    false = [np.min(statistics.holm(rng.random(10))) <= 0.05 for _ in range(2000)]
    assert np.mean(false) == pytest.approx(0.05, abs=0.02)


def test_a_comparison_is_of_pairs():
    rng = np.random.default_rng(7)
    # Recordings differ a hundredfold, estimators by a tenth: only pairs can tell.
    difficulty = np.exp(2.0 * rng.standard_normal(12))
    better = 0.9 * difficulty * np.exp(0.03 * rng.standard_normal(12))
    found = statistics.compare({"base": difficulty, "better": better, "same": difficulty}, "base")
    assert list(found) == ["better", "same"]
    assert 0.85 < found["better"].ratio.lower < found["better"].ratio.upper < 0.95
    assert found["better"].p == pytest.approx(2 / 2**12)
    assert found["better"].p_holm == pytest.approx(2 * found["better"].p)
    assert found["same"].ratio.estimate == pytest.approx(1.0)
    assert found["same"].p_holm == 1.0


def test_pairs_with_a_failure_or_without_a_ratio_are_left_out():
    found = statistics.compare({"base": [1.0, 2.0, 3.0, 0.0, np.nan], "half": [0.5, np.nan, 1.5, 1.0, 1.0]}, "base")
    assert found["half"].ratio.recordings == 2
    assert found["half"].ratio.estimate == pytest.approx(0.5)


def test_what_is_wrong_is_named():
    with pytest.raises(UnknownName, match="no estimator to compare with 'bsae'; did you mean 'base'"):
        statistics.compare({"base": [1.0]}, "bsae")
    with pytest.raises(InvalidArray, match="not of the same recordings"):
        statistics.compare({"base": [1.0], "other": [1.0, 2.0]}, "base")
    with pytest.raises(InvalidArray, match="single number"):
        statistics.interval(1.0)
    with pytest.raises(InvalidArray, match="between 0 and 1"):
        statistics.holm([1.5])
    with pytest.raises(InvalidConfig, match="level"):
        statistics.interval([1.0, 2.0, 3.0], level=95)
