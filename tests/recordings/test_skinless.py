"""Recordings of bodies without a skin: motions in front of the camera, and learners that take them."""

import functools

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig, NoSkin
from bodyimage_kin.metrics import excitation

PINHOLE = bk.Pinhole(300.0, 310.0, 320.0, 240.0, distortion=(-0.1, 0.01, 1e-3, 0.0), size=(640, 480))
CIRCLE = bk.motions.Circle(radius=0.04, distance=0.11, turns=0.3)


@functools.cache
def bare(model=PINHOLE, joints=None):
    """The infant with another eye and no skin."""
    infant = bk.load_embodiment("infant")
    camera = bk.Camera(infant.camera.link, infant.camera.link_T_camera, model)
    return bk.Embodiment.build(
        infant.robot, joints=joints or infant.joints, hand=infant.hand, camera=camera, home=infant.home
    )


@pytest.mark.parametrize("dynamics", [False, True])
def test_a_circle_stands_in_front_of_the_camera_at_its_depth(dynamics):
    body = bare()
    recording = bk.simulate(body, CIRCLE, seed=1, dynamics=dynamics, noise=bk.Noise(image=0.5))
    assert not {"touched", "true_touched", "at_reference", "reference_image"} & set(recording.variables)
    assert not {"rows", "columns"} & set(recording.attrs)
    point = body.hand_in_camera(recording.true_q.values[0]).numpy()
    # Dragged by a spring it lags a little, and weak rest springs pull it aside.
    atol = 2e-2 if dynamics else 1e-8
    np.testing.assert_allclose(point[:, 2], 0.11, rtol=0, atol=atol)
    np.testing.assert_allclose(np.hypot(point[:, 0], point[:, 1]), 0.04, rtol=0, atol=atol)
    assert (recording.hand_image.attrs["units"], recording.axis.values.tolist()) == ("px", ["u", "v"])
    off = recording.hand_image - recording.true_hand_image
    assert 0.3 < float(off.std()) < 0.7
    true = PINHOLE.project(torch.from_numpy(point)).numpy()
    np.testing.assert_allclose(recording.true_hand_image.values[0], true, rtol=0, atol=1e-9)


@pytest.mark.parametrize("model", [bk.Tracker(), bk.Stereo(PINHOLE, PINHOLE, np.eye(4) + 0.03 * np.eye(4, k=3))])
def test_learners_take_images_of_any_size(model):
    body = bare(model)
    recording = bk.simulate(body, CIRCLE, seed=2, dynamics=False)
    assert recording.sizes["axis"] == model.m
    learned = bk.estimators.LeastSquares().fit(bk.experience(recording))
    assert (learned.m, learned.p) == (model.m, 5)
    q = torch.from_numpy(recording.true_q.values[0])
    true = body.hand_image_jacobian(q).mean(0)
    steps = torch.from_numpy(np.diff(recording.q.values[0], axis=0))
    seen = (learned.jacobian(q[0]) - true) @ steps.T
    assert float(seen.square().sum()) < 0.1 * float((true @ steps.T).square().sum())
    assert excitation(recording, recording) is not None


def test_what_needs_a_skin_says_so():
    for motion in (bk.motions.RandomTouch(duration=1.0), bk.motions.FaceTour()):
        with pytest.raises(NoSkin, match="embodiment 'infant' has no skin"):
            bk.simulate(bare(), motion, dynamics=False)


def test_a_circle_without_depth_and_a_camera_that_moves_under_a_drag_are_refused():
    with pytest.raises(InvalidConfig, match=r"in front of its camera; distance=0\.0: give a number above 0"):
        bk.simulate(bare(), bk.motions.Circle(distance=0.0), dynamics=False)
    neck = bare(PINHOLE, ("neck", *bk.load_embodiment("infant").joints))
    recording = bk.simulate(neck, CIRCLE, dynamics=False)
    assert np.isfinite(recording.hand_image).all()
    with pytest.raises(InvalidConfig, match=r"a felt joint moves the camera's link 'right_eye'.*use dynamics=False"):
        bk.simulate(neck, CIRCLE)
