"""Laws of the constant Jacobian and of the analytic one."""

import numpy as np
import pytest
import torch
from experiences import taught

import bodyimage_kin as bk
from bodyimage_kin.estimators import Analytic, LeastSquares, pairs

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("m", [2, 3])
def test_a_constant_jacobian_is_recovered(m):
    true, dq = RNG.normal(size=(m, 4)), RNG.normal(size=(30, 4))
    learned = LeastSquares().fit(taught(dq, dq @ true.T, m))
    np.testing.assert_allclose(learned.matrix.numpy(), true, atol=1e-13)
    assert (learned.m, learned.p) == (m, 4)
    q = torch.from_numpy(RNG.normal(size=(3, 4)))
    torch.testing.assert_close(learned.displacement(q, q), q @ learned.matrix.T)
    assert torch.equal(learned.jacobian(q), learned.matrix.expand(3, m, 4))


def test_it_is_numpys_least_squares_and_the_pseudoinverse(circle):
    data = pairs(bk.experience(circle))
    matrix = LeastSquares().fit(bk.experience(circle)).matrix.numpy()
    dq, dr = data.dq.numpy(), data.dr.numpy()
    np.testing.assert_allclose(matrix, np.linalg.lstsq(dq, dr, rcond=None)[0].T, atol=1e-12)
    np.testing.assert_allclose(matrix, (np.linalg.pinv(dq) @ dr).T, atol=1e-12)
    # The residual teaches nothing more.
    np.testing.assert_allclose((dr - dq @ matrix.T).T @ dq, 0.0, atol=1e-14)


@pytest.mark.filterwarnings("ignore::bodyimage_kin.errors.DataWarning")  # fewer steps than joints, on purpose
def test_of_all_that_fit_it_is_the_smallest():
    # Fewer motions than joints: what was never moved is thought to move nothing.
    true, dq = RNG.normal(size=(2, 5)), RNG.normal(size=(3, 5))
    matrix = LeastSquares().fit(taught(dq, dq @ true.T)).matrix.numpy()
    np.testing.assert_allclose(matrix, (np.linalg.pinv(dq) @ dq @ true.T).T, atol=1e-12)
    still = np.linalg.svd(dq)[2][3:]
    np.testing.assert_allclose(matrix @ still.T, 0.0, atol=1e-13)


def test_the_analytic_one_is_the_body(body, circle):
    learned = Analytic(body).fit(bk.experience(circle), seed=9)
    q = torch.from_numpy(circle.true_q.values[0, :4])
    assert torch.equal(learned.jacobian(q), body.hand_image_jacobian(q))
    dq = 0.01 * torch.ones_like(q)
    torch.testing.assert_close(learned.displacement(q, dq), (body.hand_image_jacobian(q) @ dq[..., None])[..., 0])
    assert (learned.p, learned.m) == (body.p, body.m)
    # To first order it is how the image moves.
    moved = body.hand_image(q + 1e-4 * dq) - body.hand_image(q)
    torch.testing.assert_close(learned.displacement(q, 1e-4 * dq), moved, atol=1e-10, rtol=0)
