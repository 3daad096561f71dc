"""Laws of ensembles."""

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.estimators import Analytic, ConstantJacobian, Ensemble, ForwardNetwork, Ridge
from bodyimage_kin.estimators.ensemble import EnsembleJacobian

SPEC = Ensemble(ForwardNetwork(hidden=(4,), steps=5), members=3)


@pytest.fixture(scope="module")
def learned(circle):
    return SPEC.fit(bk.experience(circle), seed=1)


def test_it_is_the_mean_of_its_members(learned, body):
    q = body.felt_home.expand(4, -1)
    members = learned.member_jacobians(q)
    assert members.shape == (3, 4, 2, 5)
    torch.testing.assert_close(learned.jacobian(q), members.mean(0))
    torch.testing.assert_close(learned.jacobian_std(q), members.std(0))
    assert (learned.jacobian_std(q) > 0).all()


def test_draws_are_members(learned, body):
    draws = learned.jacobian_draws(body.felt_home, 20, seed=0)
    members = learned.member_jacobians(body.felt_home)
    assert all(any(torch.equal(draw, member) for member in members) for draw in draws)
    assert len({draw.sum().item() for draw in draws}) == 3


def test_members_that_draw_nothing_differ_by_what_they_miss(circle, body):
    exp = bk.experience(circle)
    alike = Ensemble(Ridge(1e-6), members=3).fit(exp)
    apart = Ensemble(Ridge(1e-6), members=3, missing=0.3).fit(exp)
    assert alike.jacobian_std(body.felt_home).max() < 1e-15
    assert apart.jacobian_std(body.felt_home).max() > 1e-9


def test_other_seeds_are_other_members(circle, learned):
    other = SPEC.fit(bk.experience(circle), seed=2)
    assert not torch.equal(other.members[0].layers[0], learned.members[0].layers[0])


def test_ensembles_of_what_is_known_cannot_be_saved(circle, body, tmp_path):
    learned = Ensemble(Analytic(body), members=2).fit(bk.experience(circle))
    np.testing.assert_allclose(learned.jacobian(body.felt_home), body.hand_image_jacobian(body.felt_home))
    with pytest.raises(InvalidConfig, match="cannot be saved"):
        learned.save(tmp_path / "known")


def test_members_are_there_and_of_one_size():
    with pytest.raises(InvalidArray, match="members of one size"):
        EnsembleJacobian(())
    members = [ConstantJacobian(torch.zeros(2, p, dtype=torch.float64)) for p in (3, 4)]
    with pytest.raises(InvalidArray, match="members of one size"):
        EnsembleJacobian(tuple(members))
