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
    members = torch.stack([member.jacobian(q) for member in learned.members])
    assert members.shape == (3, 4, 2, 5)
    torch.testing.assert_close(learned.jacobian(q), members.mean(0))
    variance = learned.covariance(q).diagonal(dim1=-2, dim2=-1).reshape(4, 2, 5)
    torch.testing.assert_close(variance.sqrt(), members.std(0))
    assert (variance > 0).all()


def test_covariances_are_those_of_members(learned, body):
    q, dq = body.felt_home, 0.1 * torch.arange(5, dtype=torch.float64)
    entries = np.stack([member.jacobian(q).flatten().numpy() for member in learned.members])
    np.testing.assert_allclose(learned.covariance(q), np.cov(entries.T), rtol=1e-10, atol=1e-18)
    moved = np.stack([member.displacement(q, dq).numpy() for member in learned.members])
    np.testing.assert_allclose(learned.displacement_covariance(q, dq), np.cov(moved.T), rtol=1e-10, atol=1e-18)


def test_draws_are_members(learned):
    draws = learned.draws(20, seed=0)
    assert all(any(draw is member for member in learned.members) for draw in draws)
    assert len(set(map(id, draws))) == 3


def test_members_that_draw_nothing_differ_by_what_they_miss(circle, body):
    exp = bk.experience(circle)
    alike = Ensemble(Ridge(1e-6), members=3).fit(exp)
    apart = Ensemble(Ridge(1e-6), members=3, missing=0.3).fit(exp)
    assert alike.covariance(body.felt_home).abs().max() < 1e-30
    assert apart.covariance(body.felt_home).diagonal().max() > 1e-18


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


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("members", [1, 10**30, True, 2.0])
def test_members_are_counted(members):
    with pytest.raises(InvalidConfig, match=f"members={members}: give a whole number of at least 2 and at most 10000"):
        Ensemble(Ridge(), members)
