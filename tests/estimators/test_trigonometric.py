"""Laws of the trigonometric basis, and of the two estimators built on it."""

import itertools

import numpy as np
import pytest
import torch
from experiences import taught

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators import LeastSquares, RationalTrig, TrigRidge
from bodyimage_kin.estimators._basis import TrigBasis
from bodyimage_kin.estimators.rational import _solve
from bodyimage_kin.metrics import pooled_relative_error


def shown(q, image):
    exp = taught(np.diff(q, axis=0), np.diff(image, axis=0))
    return exp.assign(q=exp.q + q[0], hand_image=exp.hand_image + image[0])


def basis(p, degree, seed=0):
    return TrigBasis(torch.randn(p, generator=torch.Generator().manual_seed(seed), dtype=torch.float64), degree)


# The basis ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("p", "degree"), [(1, 1), (3, 1), (3, 2), (3, 3), (5, 3), (7, 2)])
def test_every_product_within_the_degree_is_there_once(p, degree):
    factors = basis(p, degree).factors.tolist()
    wanted = [list(c) for c in itertools.product((0, 1, 2), repeat=p) if np.count_nonzero(c) <= degree]
    assert factors == wanted
    assert factors[0] == [0] * p


@pytest.mark.parametrize(("p", "degree"), [(1, 1), (3, 2), (4, 4)])
def test_its_derivative_stays_within_it(p, degree):
    functions = basis(p, degree)
    weights = torch.randn(len(functions.factors), 2, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    q = torch.randn(6, p, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    slope = torch.func.vmap(torch.func.jacrev(lambda x: functions(x) @ weights))(q)
    ours = (functions(q) @ functions.derivative(weights).flatten(1)).reshape(6, 2, p)
    torch.testing.assert_close(ours, slope, rtol=1e-12, atol=1e-12)


def test_values_are_the_products_themselves():
    functions = basis(3, 2)
    q = torch.randn(5, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(3))
    d = q - functions.centre
    each = torch.stack([torch.ones_like(d), torch.sin(d), 1 - torch.cos(d)])
    for values, factors in zip(functions(q).T, functions.factors.tolist(), strict=True):
        torch.testing.assert_close(values, torch.stack([each[f, :, i] for i, f in enumerate(factors)]).prod(0))


def test_functions_without_end_are_refused_before_memory_is():
    with pytest.raises(InvalidConfig, match="smaller degree"):
        _ = basis(20, 20).factors


# The estimators -------------------------------------------------------------------------------------------------------


def wander(count, p, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, p))


def projected(q):
    """A chain of three joints before a pinhole, and what it shows."""
    a, b, c = q[:, 0], q[:, 1], q[:, 2]
    x = 0.1 * np.sin(a) + 0.05 * np.sin(a) * np.cos(b)
    y = 0.1 * np.sin(b) + 0.04 * np.sin(b) * np.cos(c)
    z = 0.4 + 0.1 * np.cos(a) + 0.05 * np.cos(b) * np.sin(c)
    return 0.04 * np.stack([x, y], 1) / z[:, None]


def true_slope(q, step=1e-6):
    columns = [(projected(q + step * e) - projected(q - step * e)) / (2 * step) for e in np.eye(3)]
    return np.stack(columns, -1)


def test_rational_trig_finds_a_projected_chain_and_foretells_it_elsewhere():
    q = wander(400, 3)
    learned = RationalTrig().fit(shown(q, projected(q)))
    beyond = 1.5 * wander(50, 3, seed=1)
    error = pooled_relative_error(true_slope(beyond), learned.jacobian(beyond))
    assert error < 1e-3
    np.testing.assert_allclose(learned.hand_image(beyond), projected(beyond), atol=1e-5)
    # A polynomial has no depth: with the same functions it cannot.
    assert (
        pooled_relative_error(true_slope(beyond), TrigRidge(None).fit(shown(q, projected(q))).jacobian(beyond)) > 0.01
    )


def test_trig_ridge_finds_a_trigonometric_polynomial():
    q = wander(300, 3)
    image = np.stack([np.sin(q[:, 0]) * np.cos(q[:, 1]), 2.0 - np.cos(q[:, 2])], 1)
    learned = TrigRidge(degree=2, penalty=1e-12).fit(shown(q, image))
    np.testing.assert_allclose(learned.hand_image(q + 0.5)[:, 1], 2.0 - np.cos(q[:, 2] + 0.5), atol=1e-4)


def test_a_stated_penalty_is_the_end_of_the_same_path(circle):
    exp = bk.experience(circle)
    supple, stiff = (RationalTrig(penalty=penalty).fit(exp).weights for penalty in (1e-8, 1e2))
    assert stiff[1:].norm() < 1e-2 * supple[1:].norm()


def test_depth_in_the_model_pays_out_of_sight(body):
    exp = bk.experience(
        bk.simulate(body, bk.motions.Circle(), dynamics=False, noise=bk.Noise(encoder=1e-3, image=2e-4))
    )
    face = body.touch_postures(np.arange(0, body.skin.count, 8))
    true = body.hand_image_jacobian(face)
    error = {
        spec: pooled_relative_error(true, spec.fit(exp).jacobian(face)) for spec in (RationalTrig(), LeastSquares())
    }
    assert error[RationalTrig()] < 0.7 < error[LeastSquares()]


def test_each_equation_is_divided_by_the_depth_it_was_found_at():
    generator = torch.Generator().manual_seed(0)
    X = 0.4 * torch.randn(60, 3, generator=generator, dtype=torch.float64)
    Y = torch.randn(60, 2, generator=generator, dtype=torch.float64)
    depth = 0.5 + torch.rand(60, generator=generator, dtype=torch.float64)
    found, deeper = _solve(X, Y, depth, penalty=0.1, steps=1)

    def cost(solution):
        values = solution[0] + X @ solution[1:]
        wrong = (values[:, 2:] * Y - values[:, :2]) / depth[:, None]
        return float((wrong**2).sum() / 60 + 0.1 * (solution[1:] ** 2).sum())

    torch.testing.assert_close(deeper, found[0, 2] + X @ found[1:, 2])
    assert found[0, 2] == 1.0
    for seed in range(20):
        nudge = 1e-3 * torch.randn(4, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
        nudge[0, 2] = 0.0
        assert cost(found) < cost(found + nudge)
