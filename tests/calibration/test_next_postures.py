"""Where to look next: by the prior alone, what is chosen tells most, and what is foretold comes about."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.calibration import Observed, calibrate, next_postures
from bodyimage_kin.errors import InvalidConfig

FACE = bk.probes.Face()


@pytest.fixture(scope="module")
def aimed(body):
    return next_postures(body, None, FACE, 10)


def images_of(body, q, noise=2e-4, seed=0):
    """What a body shows at these postures."""
    image = body.hand_image(torch.from_numpy(q)).numpy()
    image = image + noise * np.random.default_rng(seed).standard_normal(image.shape)
    return bk.recording(q=q, hand_image=image, joints=list(body.joints), order="scattered", unit="m")


def test_each_posture_is_visible_apart_and_lowers_what_is_foretold(body, aimed):
    assert body.visible(torch.from_numpy(aimed.q)).all()
    apart = np.abs(aimed.q[:, None] - aimed.q[None]).max(-1) + np.eye(10)
    assert apart.min() > 1e-3
    assert (np.diff(aimed.predicted_error) < 0).all()
    assert len(aimed.predicted_error) == 11


def test_aiming_beats_chance_and_telling_everything(body, aimed):
    others = [next_postures(body, None, FACE, 10, aim=aim).predicted_error[-1] for aim in ("everything", "random")]
    assert aimed.predicted_error[-1] < min(others)


def test_the_choice_is_greedy(body):
    candidates = body.felt_robot.sample(60, seed=4)
    one = next_postures(body, None, FACE, 1, candidates=candidates)
    visible = np.flatnonzero(body.visible(candidates).numpy())
    alone = [
        next_postures(body, None, FACE, 1, candidates=candidates[[index]]).predicted_error[-1] for index in visible[:8]
    ]
    assert one.predicted_error[-1] <= min(alone) + 1e-12


def test_what_is_foretold_comes_about(body, aimed):
    """Arms drawn from the prior, seen at the chosen postures: the error on the face is about as large as foretold."""
    thought = calibrate(
        body, Observed(images_of(body, aimed.q), noise={"images": 2e-4}), free=["axes", "offsets"], folds=2
    )
    sd = np.where(thought.fit.free, thought.prior.sds(thought.parameters), 0.0)
    q = body.touch_postures(range(0, 441, 7))
    errors = []
    for seed in range(8):
        true = thought.at(sd * np.random.default_rng(seed).standard_normal(len(sd)))
        exp = images_of(true, aimed.q, seed=seed)
        found = calibrate(body, Observed(exp, noise={"images": 2e-4}), free=["axes", "offsets"], robust=False, folds=2)
        J, Jh = (one.hand_image_jacobian(q, on_invisible="nan").numpy() for one in (true, found.body))
        seen = np.isfinite(J).all((1, 2)) & np.isfinite(Jh).all((1, 2))
        errors.append(metrics.pooled_relative_error(J[seen], Jh[seen]))
    assert 0.4 < np.median(errors) / aimed.predicted_error[-1] < 2.5


def test_what_was_seen_counts(body, aimed):
    more = next_postures(body, images_of(body, aimed.q), FACE, 3)
    assert more.predicted_error[0] < 0.2
    assert more.predicted_error[-1] < more.predicted_error[0]


def test_a_wider_prior_foretells_more_error(body):
    wide = bk.calibration.Prior(axes=0.1, offsets=0.01)
    errors = [next_postures(body, None, FACE, 3, prior=prior).predicted_error for prior in (None, wide)]
    assert errors[1][0] == pytest.approx(2 * errors[0][0], rel=0.05)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"count": 0}, "count=0"),
        ({"aim": "face"}, "aim='face'"),
        ({"candidates": np.zeros((4, 3))}, "candidates have shape"),
        ({"candidates": np.zeros((1, 5)), "count": 2}, "only"),
        ({"noise": -1.0}, "noise"),
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_mistakes_are_named(body, changes, match):
    asked = {"count": 1, **changes}
    count = asked.pop("count")
    with pytest.raises(InvalidConfig, match=match):
        next_postures(body, None, FACE, count, **asked)


def test_pixels_must_say_their_noise(body):
    import dataclasses

    model = bk.Pinhole(fx=800.0, fy=800.0, cx=320.0, cy=240.0)
    eye = dataclasses.replace(body, camera=bk.Camera(body.camera.link, body.camera.link_T_camera, model))
    with pytest.raises(InvalidConfig, match=r"\[px\]"):
        next_postures(eye, None, FACE, 1)
    assert next_postures(eye, None, FACE, 1, noise=0.5).predicted_error[-1] < 1.0
