"""Who is told of a wrong body: how wrong, drawn by the seed alone, and corrected by who can learn."""

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators import Analytic, LeastSquares, Misinformed, SelfCalibration


@pytest.fixture(scope="module")
def exp(circle):
    return bk.experience(circle)


def error(body, learned):
    q = body.touch_postures(range(0, 441, 40))
    return metrics.pooled_relative_error(body.hand_image_jacobian(q), learned.jacobian(q))


def test_the_body_told_is_off_by_the_spreads_and_by_the_seed_alone(body, exp):
    spec = Misinformed(Analytic(body))
    bodies = [spec.told(body, exp, seed) for seed in range(12)]
    assert len({one.sha256 for one in [body, *bodies]}) == 13
    assert spec.told(body, exp, 3) == bodies[3]
    assert Misinformed(SelfCalibration(body)).told(body, exp, 3) == bodies[3]
    off = torch.stack([one.hand.offset - body.hand.offset for one in bodies])
    assert 0.5 < float(off.square().mean().sqrt()) / spec.hand_spread < 1.6
    tilts = [
        np.linalg.norm(np.cross(one.robot.tree.joints[i].axis, np.array(joint.axis)))
        + np.linalg.norm(np.asarray(one.robot.tree.joints[i].origin)[:3, 3] - np.asarray(joint.origin)[:3, 3])
        for one in bodies
        for i, joint in enumerate(body.robot.tree.joints)
        if joint.name in body.joints
    ]
    assert max(tilts) > 0.003


def test_told_the_truth_is_not_misinformed(body, exp):
    right = Misinformed(Analytic(body), 0.0, 0.0, 0.0).fit(exp)
    assert error(body, right) < 1e-12


def test_the_hand_is_seen_where_it_was_seen(body, exp):
    wrong = Misinformed(Analytic(body), axis_spread=0.15, offset_spread=0.01).told(body, exp, 0)
    assert bool(torch.isfinite(wrong.hand_image(exp["q"].values[0])).all())


def test_who_learns_corrects_what_was_wrong(body, exp):
    believed = [error(body, Misinformed(Analytic(body)).fit(exp, seed)) for seed in range(3)]
    corrected = [error(body, Misinformed(SelfCalibration(body)).fit(exp, seed)) for seed in range(3)]
    assert min(believed) > 0.03
    assert max(corrected) < 0.5 * min(believed)


def test_what_knows_no_body_cannot_be_misinformed():
    with pytest.raises(InvalidConfig, match="LeastSquares knows no body"):
        Misinformed(LeastSquares())


def test_spreads_of_which_no_body_sees_the_hand_are_refused(body, exp, monkeypatch):
    monkeypatch.setattr("bodyimage_kin.estimators.misinformed._TRIES", 1)
    spec = Misinformed(Analytic(body), offset_spread=5.0)
    with pytest.raises(InvalidConfig, match="smaller spreads"):
        [spec.fit(exp, seed) for seed in range(30)]


@pytest.mark.parametrize("setting", ["axis_spread", "offset_spread", "hand_spread"])
def test_spreads_are_numbers(body, setting):
    with pytest.raises(InvalidConfig, match=setting):
        Misinformed(Analytic(body), **{setting: -1.0})
