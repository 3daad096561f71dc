"""Corrupted truths are wrong in the way they say, and every metric catches them."""

import dataclasses

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators import Analytic, ConstantJacobian, LeastSquares
from bodyimage_kin.estimators.nulls import OtherArm, RankOne, Rotated, Scaled, Zero

NULLS = (Scaled, Rotated, RankOne, Zero, OtherArm)


@pytest.fixture(scope="module")
def face(body):
    return body.touch_postures(np.arange(0, body.skin.count, 30))


@pytest.fixture(scope="module")
def corrupted(body, circle, face):
    exp = bk.experience(circle)
    return {null.__name__: null(body).fit(exp).jacobian(face) for null in NULLS}


def test_each_is_wrong_in_its_own_way(body, face, corrupted):
    true = body.hand_image_jacobian(face)
    torch.testing.assert_close(corrupted["Scaled"], 0.1 * true)
    assert not corrupted["Zero"].any()
    assert torch.linalg.matrix_rank(corrupted["RankOne"], rtol=1e-9).tolist() == [1] * len(face)
    torch.testing.assert_close(torch.linalg.matrix_norm(corrupted["RankOne"], 2), torch.linalg.matrix_norm(true, 2))
    torch.testing.assert_close(corrupted["Rotated"].norm(dim=-2), true.norm(dim=-2))
    torch.testing.assert_close(corrupted["Rotated"][..., 0, :], true[..., 0, :] * 3**0.5 / 2 - true[..., 1, :] / 2)
    torch.testing.assert_close(corrupted["OtherArm"], true * torch.tensor([[-1.0], [1.0]], dtype=torch.float64))


def test_every_metric_of_the_whole_catches_them(body, face, corrupted):
    true = body.hand_image_jacobian(face)
    for name, estimated in corrupted.items():
        assert metrics.pooled_relative_error(true, estimated) > 0.25, name
        servo = metrics.servo_matrix(true, estimated) if name not in ("Zero", "Scaled", "RankOne") else None
        assert servo is None or not np.allclose(servo, np.eye(2), atol=0.1), name
    assert metrics.pooled_scale_free_error(true, corrupted["Scaled"]) < 1e-12
    assert metrics.pooled_scale_free_error(true, corrupted["Rotated"]) == pytest.approx(0.25, abs=1e-9)


def test_learned_jacobians_and_estimators_are_corrupted_too(body, circle, face):
    exp = bk.experience(circle)
    constant = LeastSquares().fit(exp)
    for truth in (constant, LeastSquares()):
        torch.testing.assert_close(Scaled(truth, 0.5).fit(exp).jacobian(face), 0.5 * constant.jacobian(face))
    torch.testing.assert_close(Scaled(Analytic(body), 1.0).fit(exp).jacobian(face), body.hand_image_jacobian(face))


def test_displacements_are_corrupted_with_the_jacobian(body, circle, face):
    learned = Rotated(body).fit(bk.experience(circle))
    dq = 0.01 * torch.ones_like(face)
    torch.testing.assert_close(learned.displacement(face, dq), learned.jacobian(face).sum(-1) * 0.01)


def test_another_arm_is_its_own(body, circle, face):
    exp = bk.experience(circle)
    other = ConstantJacobian(torch.ones(2, 5, dtype=torch.float64))
    assert (OtherArm(body, other).fit(exp).jacobian(face) == 1.0).all()
    with pytest.raises(InvalidConfig, match="as many felt joints"):
        OtherArm(body, ConstantJacobian(torch.ones(2, 4, dtype=torch.float64))).fit(exp)


def test_settings_are_checked(body, circle):
    with pytest.raises(InvalidConfig, match="factor"):
        Scaled(body, float("nan"))
    with pytest.raises(InvalidConfig, match="degrees"):
        Rotated(body, float("inf"))
    with pytest.raises(InvalidConfig, match="two coordinates"):
        Rotated(ConstantJacobian(torch.ones(1, 5, dtype=torch.float64))).fit(bk.experience(circle)).jacobian([0.0] * 5)
    with pytest.raises(dataclasses.FrozenInstanceError):
        Zero(body).truth = None


def test_nulls_cannot_be_saved(body, circle, tmp_path):
    with pytest.raises(InvalidConfig, match="cannot be saved"):
        Zero(body).fit(bk.experience(circle)).save(tmp_path / "null")
