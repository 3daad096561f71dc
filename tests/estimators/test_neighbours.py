"""Laws of Jacobians that are fitted where they are asked for."""

import numpy as np
import pytest
import torch
from experiences import taught

from bodyimage_kin.errors import InvalidPosture
from bodyimage_kin.estimators import LocallyWeighted, NearestNeighbours, Ridge, pairs

LEFT, RIGHT = np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([[-1.0, 0.5], [0.0, 2.0]])


@pytest.fixture(scope="module")
def two_places():
    """Small motion at the origin, a leap of which nothing is seen, small motion ten radians to the right."""
    rng = np.random.default_rng(0)
    dq = 0.05 * rng.standard_normal((200, 2))
    dr = np.where(np.arange(200)[:, None] < 100, dq @ LEFT.T, dq @ RIGHT.T)
    exp = taught(dq, dr).copy(deep=True)
    exp.q.values[0, 101:, 0] += 10.0
    exp.hand_image.values[0, 100:101] = np.nan
    return exp


@pytest.mark.parametrize("spec", [NearestNeighbours(20, penalty=1e-9), LocallyWeighted(0.5, penalty=1e-9)])
def test_each_place_has_its_own_jacobian(spec, two_places):
    learned = spec.fit(two_places)
    np.testing.assert_allclose(learned.jacobian([[0.0, 0.0], [10.0, 0.0]]), np.stack([LEFT, RIGHT]), atol=1e-5)
    assert learned.jacobian([1e5, 0.0]).isfinite().all()


@pytest.mark.parametrize("spec", [NearestNeighbours(10**6, penalty=1e-2), LocallyWeighted(1e6, penalty=1e-2)])
def test_all_neighbours_alike_is_one_ridge_regression_after_another(spec, two_places):
    data = pairs(two_places)
    penalty = 1e-2 * float((data.dq**2).sum(1).mean()) / 2
    constant = Ridge(penalty).fit(two_places).matrix
    rest = data.dr - data.dq @ constant.T
    gram = data.dq.T @ data.dq / len(data.dq) + penalty * torch.eye(2, dtype=torch.float64)
    expected = constant + torch.linalg.solve(gram, data.dq.T @ rest / len(data.dq)).T
    torch.testing.assert_close(spec.fit(two_places).jacobian([0.0, 0.0]), expected, rtol=1e-8, atol=1e-9)


def test_neighbours_are_the_nearest(two_places):
    learned = NearestNeighbours(3, penalty=1e-3).fit(two_places)
    q = torch.tensor([0.02, -0.01], dtype=torch.float64)
    nearest = (learned.q - q).norm(dim=1).argsort()[:3]
    gram = sum(torch.outer(learned.dq[i], learned.dq[i]) for i in nearest) / 3
    mixed = sum(torch.outer(learned.dq[i], learned.residual[i]) for i in nearest) / 3
    local = torch.linalg.solve(gram + learned.penalty * torch.eye(2, dtype=torch.float64), mixed).T
    torch.testing.assert_close(learned.jacobian(q), learned.constant + local)


def test_the_bandwidth_chosen_tells_places_apart(two_places):
    assert LocallyWeighted().fit(two_places).bandwidth < 5.0


def test_what_is_not_finite_has_no_neighbours(two_places):
    with pytest.raises(InvalidPosture, match="no neighbours"):
        NearestNeighbours().fit(two_places).jacobian([np.nan, 0.0])


def test_weights_fall_with_the_squared_distance(two_places):
    learned = LocallyWeighted(0.05, penalty=1e-3).fit(two_places)
    q = torch.tensor([0.02, -0.01], dtype=torch.float64)
    weights = torch.exp(-((learned.q - q) ** 2).sum(1) / (2 * 0.05**2))
    weights = weights / weights.sum()
    gram = learned.dq.T @ (weights[:, None] * learned.dq) + learned.penalty * torch.eye(2, dtype=torch.float64)
    local = torch.linalg.solve(gram, learned.dq.T @ (weights[:, None] * learned.residual)).T
    torch.testing.assert_close(learned.jacobian(q), learned.constant + local)
