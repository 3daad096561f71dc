"""Laws of the polynomial basis, and of the two estimators built on it."""

import itertools

import numpy as np
import pytest
import torch
from experiences import scattered

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.estimators import LeastSquares, Polynomial, RationalPolynomial, TrigRidge
from bodyimage_kin.estimators._basis import PolynomialBasis
from bodyimage_kin.metrics import pooled_relative_error


def basis(p, degree, seed=0):
    rng = np.random.default_rng(seed)
    return PolynomialBasis(torch.from_numpy(rng.standard_normal(p)), degree, torch.from_numpy(rng.uniform(0.5, 2.0, p)))


@pytest.mark.parametrize(("p", "degree"), [(1, 1), (1, 4), (3, 1), (3, 3), (5, 3), (7, 2)])
def test_every_monomial_up_to_the_degree_is_there_once(p, degree):
    found = {tuple(row) for row in basis(p, degree).exponents.tolist()}
    assert found == {row for row in itertools.product(range(degree + 1), repeat=p) if sum(row) <= degree}
    assert len(found) == len(basis(p, degree).exponents)
    assert basis(p, degree).exponents[0].tolist() == [0] * p


@pytest.mark.parametrize(("p", "degree"), [(1, 3), (3, 2), (4, 4)])
def test_values_are_the_monomials_and_the_derivative_stays_within(p, degree):
    functions = basis(p, degree)
    q = torch.randn(6, p, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    d = (q - functions.centre) / functions.scale
    torch.testing.assert_close(functions(q), torch.stack([(d**e).prod(1) for e in functions.exponents], 1))
    assert functions(q.reshape(2, 3, p)).shape == (2, 3, len(functions.exponents))
    weights = torch.randn(len(functions.exponents), 2, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    slope = torch.func.vmap(torch.func.jacrev(lambda x: functions(x) @ weights))(q)
    ours = (functions(q) @ functions.derivative(weights).flatten(1)).reshape(6, 2, p)
    torch.testing.assert_close(ours, slope, rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(torch.einsum("npf,fm->nmp", functions.slopes(q), weights), slope)


def test_what_makes_no_basis_is_refused():
    centre = torch.zeros(20, dtype=torch.float64)
    with pytest.raises(InvalidConfig, match="smaller degree"):
        _ = PolynomialBasis(centre, 6, centre + 1.0).orders
    with pytest.raises(InvalidArray, match="positive"):
        PolynomialBasis(centre, 2, centre)
    with pytest.raises(InvalidConfig, match="degree"):
        Polynomial(degree=0)


def wander(count, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3))


def test_a_cubic_finds_a_cubic_and_foretells_it_elsewhere():
    def image(q):
        return np.stack([q[:, 0] ** 3 - q[:, 1] * q[:, 2], 1.0 + q[:, 0] * q[:, 1] * q[:, 2] - q[:, 2]], 1)

    q, far = wander(200), 2.0 * wander(30, seed=1)
    learned = Polynomial(penalty=1e-12).fit(scattered(q, image(q)))
    np.testing.assert_allclose(learned.hand_image(far), image(far), atol=1e-5)
    assert Polynomial(degree=2).fit(scattered(q, image(q))).hand_image(far).sub(torch.from_numpy(image(far))).norm() > 1


def test_a_ratio_of_polynomials_finds_one():
    def image(q):
        return np.stack([q[:, 0] - q[:, 1] ** 2, q[:, 1] + q[:, 2]], 1) / (2.0 + q[:, [0]] * q[:, [2]] / 2)

    q, far = wander(200), 1.5 * wander(30, seed=1)
    learned = RationalPolynomial().fit(scattered(q, image(q)))
    np.testing.assert_allclose(learned.hand_image(far), image(far), atol=1e-4)


def test_joints_are_divided_by_one_spread_so_that_noise_stays_small():
    q = wander(150) * [1.0, 1.0, 1e-3]
    functions = Polynomial().fit(scattered(q, q[:, :2])).basis
    np.testing.assert_allclose(functions.centre, q.mean(0))
    np.testing.assert_allclose(functions.scale, np.sqrt(((q - q.mean(0)) ** 2).mean()) * np.ones(3))


def test_they_pay_out_of_sight(body):
    """A cubic is a match for trigonometric ridge regression, and a depth is worth more."""
    noise = bk.Noise(torque=0.1, encoder=1e-3, image=2e-4)
    recording = bk.simulate(body, bk.motions.Circle(), seed=100, noise=noise)
    exp = bk.experience(recording)
    face = body.touch_postures(np.arange(0, body.skin.count, 8))
    true = body.hand_image_jacobian(face)
    error = {
        type(spec): pooled_relative_error(true, spec.fit(exp).jacobian(face))
        for spec in (Polynomial(), RationalPolynomial(), TrigRidge(), LeastSquares())
    }
    assert error[Polynomial] < 1.1 * error[TrigRidge]
    assert error[Polynomial] < 0.9 * error[LeastSquares]
    assert error[RationalPolynomial] < 0.6 * error[LeastSquares]
