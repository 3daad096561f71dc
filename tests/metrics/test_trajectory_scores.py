"""Laws of the trajectory scores."""

import numpy as np
import pytest

from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidArray

TRUE = np.array([[0.0, 1.0], [1.0, -1.0], [2.0, 1.0]])


def test_correlation_ignores_scale_and_offset_but_not_sign():
    np.testing.assert_allclose(metrics.velocity_correlation(TRUE, 3 * TRUE * [1, -1] + 0.5), [1, -1])


def test_correlation_by_hand():
    estimated = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 2.0]])
    # x: (-1, 0, 1) against (-1/3, 2/3, -1/3): no covariance. y: (2, -4, 2)/3 against (-1, 0, 1): none either.
    np.testing.assert_allclose(metrics.velocity_correlation(TRUE, estimated), [0, 0], atol=1e-15)
    # (0, 1, 2) against (0, 1, 0.5): covariance 0.5, squares 2 and 0.5.
    assert metrics.velocity_correlation([[0.0], [1.0], [2.0]], [[0.0], [1.0], [0.5]])[0] == pytest.approx(0.5)


def test_nrmse_is_rms_error_over_the_true_range():
    np.testing.assert_allclose(metrics.velocity_nrmse(TRUE, TRUE + np.array([0.2, 0.2])), [0.1, 0.1])
    np.testing.assert_allclose(metrics.velocity_nrmse([[0.0], [2.0]], [[1.0], [2.0]]), [np.sqrt(0.5) / 2])


def test_rmse_is_a_distance():
    assert metrics.trajectory_rmse(TRUE, TRUE + np.array([0.3, 0.4])) == pytest.approx(0.5)


@pytest.mark.parametrize("score", [metrics.velocity_correlation, metrics.velocity_nrmse, metrics.trajectory_rmse])
def test_samples_unseen_in_either_are_left_out(score):
    rng = np.random.default_rng(0)
    true, estimated = rng.normal(size=(2, 6, 10, 3))
    flat = score(true.reshape(-1, 3)[2:], estimated.reshape(-1, 3)[2:])
    true[0, 0, 1], estimated[0, 1, 2] = np.nan, np.inf
    np.testing.assert_allclose(score(true, estimated), flat)


@pytest.mark.parametrize("score", [metrics.velocity_correlation, metrics.velocity_nrmse, metrics.trajectory_rmse])
def test_nothing_seen_is_undefined(score):
    assert np.isnan(score(TRUE, TRUE * np.nan)).all()
    assert np.isnan(score(TRUE[:0], TRUE[:0])).all()


def test_constant_velocity_has_no_correlation_and_no_range():
    still = np.full((7, 1), 0.1)
    assert np.isnan(metrics.velocity_correlation(still, np.arange(7.0)[:, None]))
    assert np.isnan(metrics.velocity_correlation(np.arange(7.0)[:, None], still))
    assert np.isnan(metrics.velocity_nrmse(still, still))


def test_curl_by_hand_and_zero_for_a_derivative():
    derivative = np.zeros((1, 2, 2))
    derivative[0, 0, 1] = 3.0  # d_1 J_00
    np.testing.assert_array_equal(metrics.curl(derivative), [[[0, 3], [-3, 0]]])
    hessian = np.random.default_rng(0).normal(size=(4, 2, 5, 5))
    np.testing.assert_array_equal(metrics.curl(hessian + hessian.swapaxes(-1, -2)), np.zeros((4, 2, 5, 5)))


def test_bad_inputs_are_named():
    with pytest.raises(InvalidArray, match=r"true has shape \(3, 2\) but estimated \(2, 2\)"):
        metrics.trajectory_rmse(TRUE, TRUE[:2])
    with pytest.raises(InvalidArray, match="estimated holds bool"):
        metrics.trajectory_rmse(TRUE, TRUE > 0)
    with pytest.raises(InvalidArray, match="jacobian_derivative"):
        metrics.curl(np.zeros((2, 3, 4)))
