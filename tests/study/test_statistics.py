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
    assert other.units == 8
    np.testing.assert_allclose(
        [other.estimate, other.lower, other.upper], [one.estimate, one.lower, one.upper], atol=0.01
    )


def test_a_recording_that_failed_is_left_out():
    sample = np.array([1.0, 2.0, 4.0, 7.0, 7.5, 8.0, 9.0, 9.5])
    assert statistics.interval([*sample, np.nan]) == statistics.interval(sample)


def test_strata_weigh_the_same_and_their_difference_does_not_widen_the_interval():
    rng = np.random.default_rng(3)
    small, large = rng.normal(0.0, 0.1, 40), rng.normal(10.0, 0.1, 20)
    found = statistics.interval({"small": small, "large": large})
    assert found.estimate == pytest.approx((small.mean() + large.mean()) / 2)
    assert found.upper - found.lower < 0.1


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_too_few_recordings_have_no_interval(count):
    found = statistics.interval(np.arange(count, dtype=float))
    assert np.isnan([found.lower, found.upper]).all()
    assert not found.publishable


def test_an_interval_is_published_from_thirty_recordings_on():
    sample = np.random.default_rng(4).random(30)
    assert statistics.interval(sample).publishable
    assert not statistics.interval(sample[:29]).publishable


def test_equal_scores_have_an_interval_of_no_width():
    found = statistics.interval(np.full(8, 0.25))
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
    assert found["half"].ratio.units == 2
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


# Where means do not exist --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [8, 10, 30, 41])
def test_the_interval_of_a_median_covers_at_least_as_often_as_it_says_and_not_much_more(count):
    # Cauchy: no mean exists, and no bootstrap of one would cover.
    samples = 1.0 + np.random.default_rng(8).standard_cauchy((3000, count))
    covered = np.mean([one.lower <= 1.0 <= one.upper for one in map(statistics.spread, samples)])
    assert 0.94 < covered <= (0.995 if count < 30 else 0.985)


def test_a_pole_moves_no_part_of_a_spread_but_the_share_above_one():
    values = np.linspace(0.1, 0.9, 41)
    with_pole = np.append(values[:-1], np.inf)
    calm, wild = statistics.spread(values), statistics.spread(with_pole)
    assert (wild.median, wild.lower, wild.upper) == pytest.approx((calm.median, calm.lower, calm.upper))
    assert (calm.above_one, wild.above_one) == (0.0, pytest.approx(1 / 41))
    assert statistics.spread([*values, np.nan]) == calm


def test_of_seven_units_a_median_has_no_interval_and_of_none_there_is_nothing():
    few = statistics.spread(np.arange(7.0))
    assert (few.median, few.units) == (3.0, 7)
    assert np.isnan([few.lower, few.upper]).all()
    assert statistics.spread([np.nan]).units == 0
    with pytest.raises(InvalidArray, match="one a unit"):
        statistics.spread([[1.0]])


def test_ranks_are_of_pairs_on_the_same_units_and_no_pole_moves_them():
    rng = np.random.default_rng(9)
    difficulty = np.exp(2.0 * rng.standard_normal(30))
    better = 0.9 * difficulty * np.exp(0.03 * rng.standard_normal(30))
    better[3], alike = 1e9, difficulty * np.exp(0.5 * rng.standard_normal(30))
    found = statistics.ranked({"worse": difficulty, "better": better, "alike": alike})
    pair = found.get(("better", "worse")) or found["worse", "better"]
    first_is_better = ("better", "worse") in found
    assert (pair.ratio if first_is_better else 1 / pair.ratio) == pytest.approx(0.9, abs=0.03)
    assert pair.p_holm < 1e-4
    assert len(found) == 3
    assert max(one.p_holm for one in found.values()) > 0.05
    assert all(one.p_holm >= one.p for one in found.values())


# Of what varies ------------------------------------------------------------------------------------------------------


def test_near_copies_of_one_estimator_count_once():
    rng = np.random.default_rng(10)
    x, y = rng.random(6) + 0.1, rng.random(6) + 0.1
    copies = [0, 1, 2, 3, 4, 5, 5, 5, 5]
    names = [f"family{n}" for n in copies]
    alone, among = statistics.correlation(x, y), statistics.correlation(x[copies], y[copies], names)
    assert among.units == 6
    assert among.estimate == pytest.approx(alone.estimate)
    assert statistics.correlation(x[copies], y[copies]).estimate != pytest.approx(alone.estimate)


def test_few_families_have_a_value_and_no_interval():
    values = np.arange(1.0, 20.0)
    few, many = statistics.correlation(values, values), statistics.correlation([*values, 20.0], [*values, 20.0])
    assert (few.estimate, many.estimate) == (pytest.approx(1.0), pytest.approx(1.0))
    assert np.isnan(few.lower)
    assert not few.publishable
    assert many.lower == pytest.approx(1.0)
    assert many.publishable


def test_what_is_fitted_is_fitted_again_to_the_units_that_were_drawn():
    drawn = []
    found = statistics.resampled(
        lambda units: drawn.append(units) or float(units.mean()), 25, "conditions", resamples=50
    )
    assert (len(drawn), found.units, found.unit) == (51, 25, "conditions")
    assert all(len(units) == 25 for units in drawn)
    assert found.lower < found.estimate < found.upper
    with pytest.raises(UnknownName, match="no unit of resampling 'bodys'; did you mean 'bodies'"):
        statistics.resampled(lambda units: 0.0, 25, "bodys")


def test_a_ratio_of_sums_weighs_units_by_their_size_and_knows_no_unit_of_measure():
    rng = np.random.default_rng(11)
    size = rng.exponential(size=25)
    wrong = size * 0.09 * rng.lognormal(sigma=0.3, size=25)
    found = statistics.ratio_of_sums(wrong, size, resamples=500)
    assert found.estimate == pytest.approx(np.sqrt(wrong.sum() / size.sum()))
    assert found.lower < found.estimate < found.upper
    scaled = statistics.ratio_of_sums(100.0 * wrong, 100.0 * size, resamples=500)
    assert [scaled.lower, scaled.upper] == pytest.approx([found.lower, found.upper])
    # A unit in which nothing moved and nothing was wrong says nothing.
    silent = statistics.ratio_of_sums([*wrong, 0.0], [*size, 0.0], resamples=500)
    assert silent.estimate == pytest.approx(found.estimate)
