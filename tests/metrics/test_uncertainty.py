"""Laws of scores of uncertainty."""

import numpy as np
import pytest
import scipy.integrate
import scipy.stats

from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidArray, InvalidConfig

RNG = np.random.default_rng(0)


def predictions(count, d=3, seed=0, inflated=1.0):
    """Truths drawn from the predicted distributions, whose covariances are then said to be larger than they are."""
    rng = np.random.default_rng(seed)
    mean = rng.normal(size=(count, d))
    root = rng.normal(size=(count, d, d)) * rng.uniform(0.1, 3.0, (count, 1, 1))
    true = mean + (root @ rng.normal(size=(count, d, 1)))[..., 0]
    return true, mean, inflated**2 * root @ root.swapaxes(-1, -2)


def test_negative_log_likelihood_is_that_of_the_density():
    true, mean, covariance = predictions(20)
    expected = [
        -scipy.stats.multivariate_normal(m, S).logpdf(y) for y, m, S in zip(true, mean, covariance, strict=True)
    ]
    np.testing.assert_allclose(metrics.negative_log_likelihood(true, mean, covariance), expected)
    batch = [a.reshape(4, 5, *a.shape[1:]) for a in (true, mean, covariance)]
    np.testing.assert_allclose(metrics.negative_log_likelihood(*batch), np.reshape(expected, (4, 5)))


def test_negative_log_likelihood_without_doubt():
    S = np.diag([1.0, 0.0])
    true = [[0.0, 0.0], [0.0, 1.0], [2.0, 0.0]]
    found = metrics.negative_log_likelihood(true, np.zeros((3, 2)), np.stack([S, S, S]))
    np.testing.assert_array_equal(found, [-np.inf, np.inf, -np.inf])
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(2, 2)))[0]
    turned = metrics.negative_log_likelihood(true @ turn.T, np.zeros((3, 2)), np.stack([turn @ S @ turn.T] * 3))
    np.testing.assert_array_equal(turned, found)


@pytest.mark.parametrize(("mean", "sd"), [(0.0, 1.0), (2.0, 0.3), (-1.0, 5.0)])
def test_crps_is_the_integral_that_defines_it(mean, sd):
    for true in (-3.0, 0.2, 2.0):
        below = scipy.integrate.quad(lambda x: scipy.stats.norm.cdf(x, mean, sd) ** 2, -60, true, limit=500)[0]
        above = scipy.integrate.quad(lambda x: scipy.stats.norm.sf(x, mean, sd) ** 2, true, 60, limit=500)[0]
        assert metrics.crps(true, mean, sd) == pytest.approx(below + above, rel=1e-6)


def test_crps_of_a_certain_prediction_is_its_absolute_error():
    np.testing.assert_allclose(metrics.crps([1.0, -2.0], [0.5, 0.0], [0.0, 0.0]), [0.5, 2.0])
    np.testing.assert_allclose(metrics.crps([1.0, -2.0], [0.5, 0.0], [1e-12, 1e-12]), [0.5, 2.0])


def test_crps_of_draws_is_that_of_their_distribution_however_few():
    true, mean, sd = RNG.normal(size=(3, 4000)) * [[1], [1], [0.5]]
    sd = np.abs(sd) + 0.2
    expected = metrics.crps(true, mean, sd)
    for count in (2, 5, 50):
        draws = mean + sd * RNG.normal(size=(count, 4000))
        assert metrics.crps_of_draws(true, draws).mean() == pytest.approx(expected.mean(), rel=0.03)
    x, y = RNG.normal(size=(6, 3)), RNG.normal(size=3)
    pairs = [np.abs(x[i] - x[j]) for i in range(6) for j in range(6) if i != j]
    np.testing.assert_allclose(metrics.crps_of_draws(y, x), np.abs(x - y).mean(0) - np.mean(pairs, axis=0) / 2)


def test_coverage_of_sound_predictions_is_what_they_say():
    found = metrics.coverage(*predictions(4000))
    np.testing.assert_array_equal(found.levels, [0.5, 0.9, 0.95])
    np.testing.assert_allclose(found.share, found.levels, atol=0.02)
    assert ((found.lower < found.levels) & (found.levels < found.upper)).all()
    assert (found.count, found.confidence) == (4000, 0.95)
    boastful, timid = (metrics.coverage(*predictions(4000, inflated=factor)) for factor in (0.5, 2.0))
    assert (boastful.upper < found.levels).all()
    assert (timid.lower > found.levels).all()


def test_the_interval_of_a_coverage_is_that_of_clopper_and_pearson():
    # One number each, 18 of 20 within two standard deviations: 0.683 to 0.988, as tables have it.
    true = np.r_[np.zeros(18), 9.0, 9.0][:, None]
    level = scipy.stats.chi2.cdf(4.0, 1)
    found = metrics.coverage(true, np.zeros((20, 1)), np.ones((20, 1, 1)), levels=[level])
    assert found.share == pytest.approx(0.9)
    assert (found.lower[0], found.upper[0]) == pytest.approx((0.6830, 0.9877), abs=1e-4)
    wide = metrics.coverage(true, np.zeros((20, 1)), np.ones((20, 1, 1)), levels=[level], confidence=0.99)
    assert wide.lower[0] < found.lower[0]
    everything = metrics.coverage(true[:18], true[:18], np.ones((18, 1, 1)))
    np.testing.assert_array_equal(everything.upper, 1)
    assert everything.lower[0] == pytest.approx(0.025 ** (1 / 18))


def test_coverage_is_of_ellipsoids_in_any_number_of_directions():
    for d in (1, 2, 6):
        found = metrics.coverage(*predictions(3000, d, seed=d), levels=(0.3, 0.7))
        np.testing.assert_allclose(found.share, [0.3, 0.7], atol=0.03)
    S = np.diag([1.0, 0.0])
    true = np.array([[0.1, 0.0], [0.1, 0.1]])
    assert metrics.coverage(true, 0 * true, np.stack([S, S])).share[0] == 0.5, "certain and wrong is not covered"


def test_sharpness_is_the_error_that_is_predicted():
    true, mean, covariance = predictions(20_000, 2)
    error = np.sqrt(((true - mean) ** 2).sum(-1).mean())
    assert metrics.sharpness(covariance) == pytest.approx(error, rel=0.03)
    assert metrics.sharpness(4 * covariance) == pytest.approx(2 * metrics.sharpness(covariance))
    assert metrics.sharpness([[9.0, 0.0], [0.0, 16.0]]) == 5


def test_doubt_that_ranks_errors_takes_the_large_ones_away_first():
    error = np.array([3.0, 1.0, 2.0, 4.0])
    found = metrics.sparsification(error, error**3)
    np.testing.assert_array_equal(found.kept, [1, 0.75, 0.5, 0.25])
    np.testing.assert_allclose(found.error**2, [30 / 4, 14 / 3, 5 / 2, 1])
    np.testing.assert_array_equal(found.best, found.error)
    assert found.gain == 1
    against = metrics.sparsification(error, -error)
    np.testing.assert_allclose(against.error**2, [30 / 4, 29 / 3, 25 / 2, 16])
    np.testing.assert_array_equal(against.best, found.best)
    assert against.gain < 0


def test_doubt_that_tells_nothing_gains_nothing():
    error = np.abs(RNG.normal(size=500))
    same = metrics.sparsification(error, np.ones(500))
    np.testing.assert_allclose(same.error, same.error[0])
    assert same.gain == pytest.approx(0)
    at_random = [metrics.sparsification(error, RNG.uniform(size=500)).gain for _ in range(50)]
    assert np.mean(at_random) == pytest.approx(0, abs=0.03)
    assert np.isnan(metrics.sparsification(np.ones(9), RNG.uniform(size=9)).gain), "equal errors cannot be ranked"


def test_only_the_order_of_doubt_counts():
    error, doubt = np.abs(RNG.normal(size=(2, 300)))
    one, other = metrics.sparsification(error, doubt), metrics.sparsification(1e3 * error, np.log(doubt))
    np.testing.assert_allclose(1e3 * one.error, other.error)
    assert one.gain == pytest.approx(other.gain)


def test_all_scores_at_once_are_those_one_by_one():
    true, mean, covariance = predictions(200)
    found = metrics.uncertainty_scores(true, mean, covariance)
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    size = np.linalg.norm(true - mean, axis=-1)
    assert found == pytest.approx(
        {
            "error": np.sqrt((size**2).mean()),
            "sharpness": metrics.sharpness(covariance),
            "negative_log_likelihood": metrics.negative_log_likelihood(true, mean, covariance).mean(),
            "crps": metrics.crps(true, mean, sd).mean(),
            **dict(
                zip(
                    ("coverage_50", "coverage_90", "coverage_95"),
                    metrics.coverage(true, mean, covariance).share,
                    strict=True,
                )
            ),
            "sparsification_gain": metrics.sparsification(size, (sd**2).sum(-1)).gain,
        }
    )
    # Doubt that fits is better than too much and than too little, by every proper score.
    for factor in (0.5, 2.0):
        worse = metrics.uncertainty_scores(*predictions(2000, inflated=factor))
        best = metrics.uncertainty_scores(*predictions(2000))
        assert worse["error"] == best["error"]
        assert worse["crps"] > best["crps"]
        assert worse["negative_log_likelihood"] > best["negative_log_likelihood"]


def test_predictions_that_are_not_finite_are_left_out():
    true, mean, covariance = predictions(30)
    whole = metrics.uncertainty_scores(true[3:], mean[3:], covariance[3:])
    true[0], mean[1, 0], covariance[2, 1, 1] = np.nan, np.inf, np.nan
    assert metrics.uncertainty_scores(true, mean, covariance) == whole
    surprise = metrics.negative_log_likelihood(true, mean, covariance)
    np.testing.assert_array_equal(np.isnan(surprise), np.arange(30) < 3)
    nothing = metrics.uncertainty_scores(np.nan * true, mean, covariance)
    assert np.isnan(list(nothing.values())).all()
    assert np.isnan(metrics.sharpness(np.full((3, 2, 2), np.nan)))
    assert np.isnan(metrics.sparsification([np.nan], [1.0]).gain)


@pytest.mark.parametrize(
    ("ask", "error", "message"),
    [
        (
            lambda: metrics.negative_log_likelihood(np.ones(2), np.ones(2), np.ones((3, 3))),
            InvalidArray,
            r"needs \(2, 2\)",
        ),
        (lambda: metrics.negative_log_likelihood(np.ones(2), np.ones(2), np.ones((2, 3))), InvalidArray, "covariance"),
        (lambda: metrics.coverage(np.ones(2), np.ones(2), np.diag([1.0, -1.0])), InvalidArray, "semidefinite"),
        (lambda: metrics.coverage(np.ones(2), np.ones(2), [[1.0, 2.0], [0.0, 5.0]]), InvalidArray, "symmetric"),
        (
            lambda: metrics.coverage(np.ones(2), np.ones(2), np.eye(2), levels=[95.0]),
            InvalidConfig,
            r"levels\[0\]=95.0",
        ),
        (lambda: metrics.coverage(np.ones(2), np.ones(2), np.eye(2), confidence=1.0), InvalidConfig, "confidence=1.0"),
        (lambda: metrics.crps([1.0], [1.0], [-1.0]), InvalidArray, "negative"),
        (lambda: metrics.crps([1.0], [1.0, 2.0], [1.0]), InvalidArray, "same"),
        (lambda: metrics.crps_of_draws(np.ones(3), np.ones((1, 3))), InvalidArray, "at least two draws"),
        (lambda: metrics.sparsification([-1.0], [1.0]), InvalidArray, "negative"),
        (lambda: metrics.sharpness(-np.eye(2)), InvalidArray, "negative variances"),
    ],
)
def test_bad_inputs_are_named(ask, error, message):
    with pytest.raises(error, match=message):
        ask()
