"""Laws of ridge regression of displacements."""

import numpy as np
import pytest
import torch
from experiences import taught

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.estimators import LeastSquares, Ridge

J = np.array([[0.3, -0.1, 0.0], [0.2, 0.5, -0.4]])
HOME = torch.zeros(3, dtype=torch.float64)


def motion(count=400, spread=(1.0, 1.0, 1.0), seed=0):
    return np.random.default_rng(seed).standard_normal((count, 3)) * spread


def test_without_penalty_it_is_least_squares(circle):
    exp = bk.experience(circle)
    torch.testing.assert_close(Ridge(0.0).fit(exp).matrix, LeastSquares().fit(exp).matrix, rtol=1e-7, atol=1e-9)


def test_a_penalty_of_the_motions_variance_halves_the_jacobian():
    # Columns orthogonal and of variance 0.04 to rounding, so the law is exact.
    dq, _ = np.linalg.qr(motion())
    dq *= 0.2 * np.sqrt(len(dq))
    learned = Ridge(0.04).fit(taught(dq, dq @ J.T))
    np.testing.assert_allclose(learned.matrix, J / 2, atol=1e-12)


def test_the_minimum_is_one():
    dq = motion(50)
    dr = dq @ J.T + 0.1 * motion(50, seed=1)[:, :2]
    exp = taught(dq, dr)
    found = Ridge(0.3).fit(exp).matrix.numpy()

    def cost(matrix):
        return ((dr - dq @ matrix.T) ** 2).sum() / len(dq) + 0.3 * (matrix**2).sum()

    rng = np.random.default_rng(2)
    assert all(cost(found) < cost(found + 1e-3 * rng.standard_normal(J.shape)) for _ in range(20))


def test_the_penalty_chosen_tames_what_noise_alone_excites():
    dq = motion(300, (0.1, 0.1, 1e-3))
    dr = dq @ J.T + 1e-2 * motion(300, seed=1)[:, :2]
    exp = taught(dq, dr)
    error = [np.linalg.norm(spec.fit(exp).matrix.numpy() - J) for spec in (Ridge(), LeastSquares())]
    assert error[0] < 0.7 * error[1]


def test_one_step_is_enough_with_a_penalty_and_too_little_without():
    exp = taught(motion(1), motion(1) @ J.T)
    assert Ridge(1.0).fit(exp).jacobian(HOME).isfinite().all()
    with pytest.raises(InvalidRecording, match="give the estimator its penalty"):
        Ridge().fit(exp)
