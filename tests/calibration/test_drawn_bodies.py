"""Bodies drawn from a prior: as far off as it says, and each a body like any other."""

from __future__ import annotations

import numpy as np
import pytest

import bodyimage_kin as bk
from bodyimage_kin.calibration import Prior, drawn_bodies
from bodyimage_kin.errors import InvalidConfig


def origins(one):
    """Where the joints of the felt way are in their parents."""
    path = one.felt_robot.path(one.hand.link)
    return np.stack([joint.origin for joint in path if joint.kind != "fixed"])


def test_joints_are_off_by_what_the_prior_says(body):
    bodies = drawn_bodies(body, 60, prior=Prior(axes=0.03, offsets=0.004), seed=1)
    away = np.stack([origins(one) - origins(body) for one in bodies])
    assert away[..., :3, 3].std() == pytest.approx(0.004, rel=0.1)
    axes = np.array([joint.axis for joint in body.felt_robot.path(body.hand.link) if joint.kind != "fixed"])
    turned = np.einsum("bjkl,jl->bjk", away[..., :3, :3], axes)
    # Of an axis, two directions tilt.
    assert np.sqrt((turned**2).sum(-1).mean() / 2) == pytest.approx(0.03, rel=0.1)


def test_encoders_turn_about_the_axis_alone(body):
    [one] = drawn_bodies(body, 1, free=["encoders"])
    np.testing.assert_allclose(origins(one)[:, :3, 3], origins(body)[:, :3, 3], atol=1e-12)
    axes = np.array([joint.axis for joint in body.felt_robot.path(body.hand.link) if joint.kind != "fixed"])
    for found, was, axis in zip(origins(one), origins(body), axes, strict=True):
        np.testing.assert_allclose(found[:3, :3] @ axis, was[:3, :3] @ axis, atol=1e-9)
        assert abs(found[:3, :3] - was[:3, :3]).max() > 1e-5


def test_the_same_seed_draws_the_same_bodies_however_many(body):
    few, many = drawn_bodies(body, 2, seed=3), drawn_bodies(body, 4, seed=3)
    assert few == many[:2]
    assert len({one.sha256 for one in many}) == 4
    assert few[0] != drawn_bodies(body, 1, seed=4)[0]


def test_a_body_that_is_drawn_can_be_asked_like_any_other(body):
    [one] = drawn_bodies(body, 1, prior=Prior(axes=0.01, offsets=0.001))
    assert one.skin.count == body.skin.count
    exp = bk.experience(bk.simulate(one, bk.motions.Circle(turns=0.2), dynamics=False))
    assert np.isfinite(exp.hand_image).all()


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("wrong", [{"count": 0}, {"count": 1, "free": ["camera"]}])
def test_what_cannot_be_drawn_is_refused(body, wrong):
    with pytest.raises(InvalidConfig):
        drawn_bodies(body, **wrong)
