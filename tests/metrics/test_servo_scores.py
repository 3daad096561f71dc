"""Laws of the servo scores."""

import numpy as np
import pytest

from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidArray

RNG = np.random.default_rng(0)
TRUE = RNG.normal(size=(4, 3, 2, 5))


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def test_a_perfect_estimate():
    M = metrics.servo_matrix(TRUE, TRUE)
    np.testing.assert_allclose(M, np.broadcast_to(np.eye(2), M.shape), atol=1e-11)
    assert metrics.locally_stable(M).all()
    assert metrics.monotone(M).all()
    np.testing.assert_allclose(metrics.critical_gain(M), 2)


@pytest.mark.parametrize("angle", [0.5, 1.5, 2.0])
def test_a_rotated_estimate_by_hand(angle):
    # M is the rotation back, with eigenvalues exp(+-i angle): stable up to a right angle, with gain 2 cos(angle).
    M = metrics.servo_matrix(TRUE, rotation(angle) @ TRUE)
    np.testing.assert_allclose(M, np.broadcast_to(rotation(-angle), M.shape), atol=1e-11)
    assert (metrics.locally_stable(M) == (angle < np.pi / 2)).all()
    assert (metrics.monotone(M) == (angle < np.pi / 2)).all()
    np.testing.assert_allclose(metrics.critical_gain(M), max(2 * np.cos(angle), 0))


def test_a_timid_estimate_overshoots():
    np.testing.assert_allclose(metrics.critical_gain(metrics.servo_matrix(TRUE, 0.1 * TRUE)), 0.2)


def test_shear_is_stable_but_not_monotone():
    M = np.array([[1.0, 3.0], [0.0, 1.0]])
    assert metrics.locally_stable(M)
    assert not metrics.monotone(M)


def test_below_the_critical_gain_the_error_dies_and_above_it_grows():
    M = np.array([[0.5, 2.0], [-1.0, 1.5]])
    gain = metrics.critical_gain(M)
    radius = [np.abs(np.linalg.eigvals(np.eye(2) - f * gain * M)).max() for f in (0.99, 1.01)]
    assert radius[0] < 1 < radius[1]


def with_eigenvalues(values, seed=0):
    """Real matrices similar to a block diagonal one: complex values stand for a pair, [[re, -im], [im, re]]."""
    size = sum(2 if np.iscomplex(mu) else 1 for mu in values)
    blocks, at = np.zeros((size, size)), 0
    for mu in values:
        wide = 2 if np.iscomplex(mu) else 1
        block = [[mu.real, -mu.imag], [mu.imag, mu.real]] if wide == 2 else [[mu.real]]
        blocks[at : at + wide, at : at + wide] = block
        at += wide
    basis = np.eye(size) + 0.3 * np.random.default_rng(seed).normal(size=(5, size, size))
    return basis @ blocks @ np.linalg.inv(basis)


@pytest.mark.parametrize(
    ("values", "gain"),
    [
        # Of real eigenvalues the largest decides, 2 / mu; of a pair re +- i im, 2 re / (re^2 + im^2).
        ((0.5, 4.0), 0.5),
        ((0.01, 1.0, 8.0), 0.25),
        ((3.0,), 2 / 3),
        ((1.0 + 2.0j,), 0.4),
        ((1.0 + 7.0j, 0.1), 0.04),  # the pair decides
        ((0.5 + 0.5j, 10.0), 0.2),  # the real one decides
        ((2.0 + 1.0j, 1.0 + 3.0j), 0.2),
        ((2.0, 2.0), 1.0),
    ],
)
def test_the_critical_gain_is_that_of_the_eigenvalue_that_goes_first(values, gain):
    M = with_eigenvalues(values)
    np.testing.assert_allclose(metrics.critical_gain(M), gain)
    assert metrics.locally_stable(M).all()
    step = np.eye(M.shape[-1]) - np.array([0.999, 1.001])[:, None, None, None] * gain * M
    below, above = np.abs(np.linalg.eigvals(step)).max(-1)
    assert (below < 1).all()
    assert (above > 1).all()


@pytest.mark.parametrize(
    "values",
    [(-0.1, 5.0), (0.0, 1.0), (0.0, 0.0), (-1.0 + 3.0j, 2.0), (2.0j,), (0.0, 1.0 + 1.0j), (-1.0, -2.0)],
)
def test_one_eigenvalue_on_the_wrong_side_leaves_no_gain(values):
    M = with_eigenvalues(values)
    np.testing.assert_array_equal(metrics.critical_gain(M), 0)
    assert not metrics.locally_stable(M).any()
    assert not metrics.monotone(M).any()


def test_degenerate_matrices():
    shear = np.array([[2.0, 1.0], [0.0, 2.0]])  # one eigenvector for both eigenvalues
    assert metrics.critical_gain(shear) == pytest.approx(1.0)
    assert metrics.locally_stable(shear)
    assert metrics.critical_gain(np.zeros((3, 3))) == 0
    assert metrics.critical_gain([[0.0, 1.0], [0.0, 0.0]]) == 0
    assert metrics.critical_gain([[4]]) == 0.5
    assert metrics.critical_gain(1e-100 * np.eye(2)) == pytest.approx(2e100)


def test_monotone_is_of_the_symmetric_part_alone():
    rng = np.random.default_rng(3)
    for least, holds in ((0.2, True), (-0.2, False)):
        Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn = rng.normal(size=(3, 3))
        M = Q * [least, 1.0, 5.0] @ Q.T + 10 * (turn - turn.T)
        assert metrics.monotone(M) == holds
        # Then the squared error of the slowest direction shrinks or grows at first: d|e|^2/dt = -2 e' M e.
        assert (Q[:, 0] @ M @ Q[:, 0] > 0) == holds


@pytest.mark.parametrize("estimated", [0 * TRUE, TRUE * [[1.0], [0.0]], TRUE[..., :1, :] * [[1.0], [2.0]], -TRUE])
def test_estimates_that_lost_a_direction_or_the_sign_are_unstable(estimated):
    M = metrics.servo_matrix(TRUE, estimated)
    assert not metrics.locally_stable(M).any()
    assert not metrics.monotone(M).any()
    np.testing.assert_array_equal(metrics.critical_gain(M), 0)


@pytest.mark.parametrize("shape", [(1, 1), (1, 3), (2, 2), (3, 7), (4, 2)])
def test_the_matrix_is_the_product_with_the_pseudoinverse(shape):
    true, estimated = np.random.default_rng(1).normal(size=(2, 20, *shape))
    estimated[::2, 0] *= 1e-5  # the badly conditioned ones take another way
    expected = true @ np.linalg.pinv(estimated)
    found = metrics.servo_matrix(true, estimated)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("batch", [(), (0,), (2, 3)])
def test_every_batch_shape(batch):
    M = metrics.servo_matrix(np.ones((*batch, 2, 3)), np.ones((*batch, 2, 3)))
    assert M.shape == (*batch, 2, 2)
    assert metrics.locally_stable(M).shape == metrics.monotone(M).shape == metrics.critical_gain(M).shape == batch


def test_undefined_is_nan_and_never_stable():
    estimated = TRUE.copy()
    estimated[0, 0, 0, 0] = np.inf
    M = metrics.servo_matrix(TRUE, estimated)
    assert np.isnan(M[0, 0]).all()
    assert np.isfinite(M[1:]).all()
    assert np.isnan(metrics.critical_gain(M)[0, 0])
    assert not metrics.locally_stable(M)[0, 0]
    assert not metrics.monotone(M)[0, 0]


def test_bad_inputs_are_named():
    with pytest.raises(InvalidArray, match=r"servo_matrix has shape \(2, 3\)"):
        metrics.monotone(np.ones((2, 3)))
