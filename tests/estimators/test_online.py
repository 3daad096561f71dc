"""Laws of the Jacobians that are learned step by step."""

import numpy as np
import pytest
from experiences import taught

from bodyimage_kin.estimators import Broyden, Kalman, RecursiveLeastSquares, Ridge

J = np.array([[0.3, -0.1, 0.0], [0.2, 0.5, -0.4]])
OTHER = np.array([[-0.3, 0.2, 0.1], [0.1, 0.1, 0.6]])


def motion(count, seed=0):
    return 0.1 * np.random.default_rng(seed).standard_normal((count, 3))


def fit(spec, dq, dr):
    return spec.fit(taught(dq, dr)).matrix.numpy()


@pytest.mark.parametrize("spec", [Broyden(), RecursiveLeastSquares(), Kalman(spread=1.0, image_noise=1e-6)])
def test_a_constant_jacobian_is_found(spec):
    dq = motion(300)
    np.testing.assert_allclose(fit(spec, dq, dq @ J.T), J, atol=1e-4)


@pytest.mark.parametrize("spec", [Broyden(), RecursiveLeastSquares(0.9), Kalman(drift=0.1, spread=1.0)])
def test_what_was_is_forgotten(spec):
    dq = motion(600)
    dr = np.where(np.arange(600)[:, None] < 300, dq @ OTHER.T, dq @ J.T)
    np.testing.assert_allclose(fit(spec, dq, dr), J, atol=1e-2)


def test_broyden_explains_the_last_step_and_keeps_the_rest():
    dq = motion(40)
    dr = motion(40, seed=1)[:, :2]
    before, after = fit(Broyden(1.0), dq[:-1], dr[:-1]), fit(Broyden(1.0), dq, dr)
    np.testing.assert_allclose(after @ dq[-1], dr[-1], atol=1e-14)
    across = np.linalg.svd(dq[-1:])[2][1:]
    np.testing.assert_allclose(after @ across.T, before @ across.T, atol=1e-12)


def test_broyden_leaves_out_steps_that_are_too_small():
    dq = motion(10)
    dq[-1] *= 1e-9
    dr = motion(10, seed=1)[:, :2]
    np.testing.assert_array_equal(fit(Broyden(), dq, dr), fit(Broyden(), dq[:-1], dr[:-1]))


def test_recursive_least_squares_is_least_squares():
    dq, noise = motion(80), motion(80, seed=1)[:, :2]
    dr = dq @ J.T + 0.3 * noise
    ridge = Ridge(1.0 / (100.0 * len(dq))).fit(taught(dq, dr)).matrix.numpy()
    np.testing.assert_allclose(fit(RecursiveLeastSquares(1.0, confidence=100.0), dq, dr), ridge, rtol=1e-9, atol=1e-12)
    weights = np.sqrt(0.95 ** np.arange(79, -1, -1.0))[:, None]
    faded = np.linalg.solve(
        (weights * dq).T @ (weights * dq) + 0.95**80 / 1e3 * np.eye(3), (weights * dq).T @ (weights * dr)
    ).T
    np.testing.assert_allclose(fit(RecursiveLeastSquares(0.95, confidence=1e3), dq, dr), faded, rtol=1e-9, atol=1e-12)


@pytest.mark.filterwarnings("ignore::bodyimage_kin.errors.DataWarning")  # it is about a joint at rest
def test_recursive_least_squares_survives_joints_that_rest():
    dq = motion(5000)
    dq[:, 2] = 0.0
    found = fit(RecursiveLeastSquares(0.5), dq, dq @ J.T)
    np.testing.assert_allclose(found, J * [1.0, 1.0, 0.0], atol=1e-6)


def test_a_kalman_filter_without_drift_is_bayesian_regression():
    dq = motion(80)
    dr = dq @ J.T + 0.3 * motion(80, seed=1)[:, :2]
    ridge = Ridge((0.02 / 0.5) ** 2 / len(dq)).fit(taught(dq, dr)).matrix.numpy()
    np.testing.assert_allclose(fit(Kalman(drift=0.0, image_noise=0.02, spread=0.5), dq, dr), ridge, rtol=1e-8)
