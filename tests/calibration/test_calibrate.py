"""Bodies fitted to recordings: what was off is found, what cannot be known is said, and nonsense is called so."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.calibration import Observed, Prior, calibrate, halves
from bodyimage_kin.errors import InvalidArray, InvalidConfig, InvalidRecording
from bodyimage_kin.robot import transforms


def seen(body, seed=1, **noise):
    noise = {"torque": 0.1, "image": 2e-4, "encoder": 1e-3} | noise
    return bk.experience(bk.simulate(body, bk.motions.Circle(turns=1.0), seed=seed, noise=bk.Noise(**noise)))


@pytest.fixture(scope="module")
def off(body):
    """An infant whose axes and offsets are off by as much as the prior says, and the values of what is off."""
    as_thought = calibrate(body, seen(body))
    sd = as_thought.prior.sds(as_thought.parameters)
    group = np.array([one.group for one in as_thought.parameters])
    theta = np.where(np.isin(group, ["axes", "offsets"]), sd, 0.0) * np.random.default_rng(5).standard_normal(len(sd))
    return as_thought.at(theta)


@pytest.fixture(scope="module")
def found(body, off):
    return calibrate(body, seen(off))


def face_error(true, estimate):
    q = true.touch_postures(range(0, 441, 7))
    return metrics.pooled_relative_error(true.hand_image_jacobian(q).numpy(), estimate.hand_image_jacobian(q).numpy())


def test_nothing_off_is_the_same_body(body):
    fit = calibrate(body, seen(body))
    same = fit.at(np.zeros(len(fit.parameters)))
    q = body.touch_postures([0, 220, 440])
    torch.testing.assert_close(same.hand_image_jacobian(q), body.hand_image_jacobian(q), rtol=1e-12, atol=1e-14)


def test_a_body_that_is_off_is_found_where_it_was_never_seen(body, off, found):
    assert face_error(off, body) > 0.4
    assert face_error(off, found.body) < 0.15
    assert found.explains
    assert found.held_out.medians[0] < 0.1 * found.nominal.medians[0]
    assert "measures from" in found.verdict


def test_draws_are_as_far_from_the_truth_as_they_are_from_each_other(off, found):
    draws = found.draws(6)
    errors = [face_error(off, one) for one in draws]
    apart = [face_error(found.body, one) for one in draws]
    assert 0.2 < np.median(errors) / np.median(apart) < 5.0
    assert [one.sha256 for one in found.draws(2)] == [one.sha256 for one in draws[:2]]


def test_halves_of_what_was_seen_differ_about_as_much_as_draws(off, found):
    one, other = halves(found)
    q = off.touch_postures(range(0, 441, 7))
    apart = metrics.pooled_relative_error(one.hand_image_jacobian(q).numpy(), other.hand_image_jacobian(q).numpy())
    assert 0.0 < apart < 0.3
    assert halves(found)[0].sha256 == one.sha256


def test_the_file_it_was_read_from_is_kept_but_for_the_joints(body, found):
    text = found.to_urdf()
    assert bk.Robot.from_urdf(text).tree.joints == bk.Robot.from_urdf(found.robot.to_urdf()).tree.joints
    assert text.count("<visual") == body.robot.source.decode().count("<visual") > 0


def test_the_robot_that_was_found_is_read_alike_by_other_libraries(found):
    text = found.robot.to_urdf()
    again = bk.Robot.from_urdf(text)
    q = again.sample(20, seed=1)
    link = found.body.hand.link
    poses = [bk.kinematics(again, name).pose(q, link) for name in ("pinocchio", "pytorch_kinematics", "mujoco")]
    ours = bk.kinematics(found.robot).pose(q, link)
    for pose in poses:
        torch.testing.assert_close(pose, ours, rtol=0.0, atol=1e-12)


def test_a_robot_calibrates_itself_by_touching_without_an_eye(body, off):
    touches = bk.experience(bk.simulate(off, bk.motions.RandomTouch(duration=60.0), seed=2)).drop_vars("hand_image")
    fit = calibrate(body, Observed(touches, use=["touches"]), free=["axes", "offsets"], folds=2)
    q = off.touch_postures(range(0, 441, 7))
    apart = [np.linalg.norm(one.hand_in_skin(q) - off.hand_in_skin(q), axis=1) for one in (body, fit.body)]
    assert np.median(apart[1]) < 0.25 * np.median(apart[0])
    assert fit.held_out.medians[0] < 0.5 * fit.nominal.medians[0]


def test_several_kinds_of_evidence_are_worth_more_than_one(body, off):
    images = seen(off)
    touches = bk.experience(bk.simulate(off, bk.motions.RandomTouch(duration=30.0), seed=2))
    both = calibrate(body, [images, Observed(touches, use=["touches"])], free=["axes", "offsets"], folds=2)
    one = calibrate(body, images, free=["axes", "offsets"], folds=2)
    assert face_error(off, both.body) < face_error(off, one.body)
    assert np.trace(both.fit.information) > np.trace(one.fit.information)


def test_a_tracker_in_a_frame_of_its_own(body, off):
    rng = np.random.default_rng(0)
    q = off.felt_robot.sample(300, seed=3).numpy()
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    point = off.hand_position(torch.from_numpy(q)).numpy() @ turn + [3.0, -1.0, 0.5]
    exp = bk.recording(
        q=q, hand_position=point + 1e-5 * rng.standard_normal(point.shape), joints=list(off.joints), order="scattered"
    )
    fit = calibrate(body, exp)
    assert fit.nominal.medians[0] > 3e-3
    assert fit.held_out.medians[0] < 1e-4


def test_what_cannot_be_known_is_said_in_words(found):
    assert found.unobservable
    assert any("offset along its axis" in one for one in found.unobservable)
    # Sliding an origin along its own axis moves nothing.
    index = next(i for i, one in enumerate(found.parameters) if one.name == "left_elbow: offset along its axis")
    assert found.fit.covariance[index, index] ** 0.5 > 0.5 * found.prior.offsets
    assert 0 < found.observability["told"] < found.free
    assert all(found.observability[name] > 0 for name in ("O1", "O2", "O3", "O4", "O5"))


@pytest.mark.parametrize(
    "wrong",
    [
        lambda exp: exp.assign(q=exp["q"] * 180 / np.pi),
        lambda exp: exp.assign(hand_image=exp["hand_image"] * 1e6),
        lambda exp: exp.assign(hand_image=0 * exp["hand_image"] + np.roll(exp["hand_image"].values, 30, axis=1)),
    ],
    ids=["degrees for radians", "a million times too large", "images of other postures"],
)
def test_a_fit_that_explains_nothing_says_so(body, wrong):
    fit = calibrate(body, wrong(seen(body)))
    assert not fit.explains
    assert "explains nothing" in fit.verdict


def test_joints_that_hardly_move_are_named(body):
    exp = seen(body)
    q = exp["q"].copy()
    q[:, :, 1:] = q[:, :1, 1:].values
    assert "left_wrist" in calibrate(body, exp.assign(q=q)).still


@pytest.mark.slow
def test_only_what_helps_is_freed(body, off):
    assert calibrate(body, seen(body), free="auto").groups == ()
    freed = calibrate(body, seen(off), free="auto")
    assert freed.groups
    assert freed.held_out.medians[0] <= freed.nominal.medians[0]


def test_what_is_held_stays(body, off):
    fit = calibrate(body, seen(off), free=["axes"])
    for parameter, value in zip(fit.parameters, fit.fit.theta, strict=True):
        assert (value != 0.0) == (parameter.group == "axes"), parameter


def test_a_narrow_prior_holds_and_a_wide_one_lets_go(body, off):
    exp = seen(off)
    narrow = calibrate(body, exp, prior=Prior(axes=1e-9, offsets=1e-9, hand_shift=1e-9))
    assert np.abs(narrow.fit.theta).max() < 1e-6
    wide = calibrate(body, exp, prior=Prior(axes=0.5, offsets=0.05))
    assert wide.held_out.medians[0] < 0.2 * narrow.held_out.medians[0]


def test_no_truth_reaches_a_fit(body, off):
    rec = bk.simulate(off, bk.motions.Circle(turns=0.5), seed=1)
    noise = {name: rec[name].astype(float) * 0 + 7.0 for name in rec if str(name).startswith("true_")}
    one, other = (calibrate(body, each, free=["axes"], folds=2) for each in (rec, rec.assign(noise)))
    np.testing.assert_array_equal(one.fit.theta, other.fit.theta)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda body, exp: calibrate(body, exp, free=["arms"]), InvalidConfig, "free='arms'"),
        (lambda body, exp: calibrate(body, exp, free="all"), InvalidConfig, "free='all'"),
        (lambda body, exp: calibrate(body, exp.drop_vars(["hand_image", "touched"])), InvalidRecording, "nothing"),
        (lambda body, exp: calibrate(body, exp.isel(time=slice(0, 2)), folds=2), InvalidRecording, "noise of"),
        (lambda body, exp: calibrate(body, Observed(exp, use=["points"])), InvalidConfig, "no hand_position"),
        (lambda body, exp: Observed(exp, noise={"images": -1}), InvalidConfig, "noise"),
        (lambda body, exp: Prior(axes=0), InvalidConfig, "axes=0"),
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_mistakes_are_named(body, call, error, message):
    with pytest.raises(error, match=message):
        call(body, seen(body))


def test_a_hand_of_many_points_is_found_turned_and_its_points_with_it(body):
    rng = np.random.default_rng(0)
    q = seen(body)["q"].values[0, :80]
    thought = rng.uniform(-0.02, 0.02, (len(q), 3))
    turn = transforms.rpy_matrix([0.1, -0.2, 0.15])
    offset = thought @ turn.T + [0.004, -0.003, 0.005]
    image = body.hand_image(q, offset).numpy()
    exp = bk.recording(q, hand_image=image, hand_offset=thought, joints=body.joints, unit="m", order="scattered")
    fit = calibrate(body, Observed(exp, use=["images"], noise={"images": 1e-5}), free=["hand"], folds=2)
    assert fit.free == 6
    np.testing.assert_allclose(fit.hand_offset(thought), offset, atol=2e-4)
    np.testing.assert_allclose(fit.hand_offset(body.hand.offset), fit.body.hand.offset, atol=1e-12)
    with pytest.raises(InvalidArray, match=r"give \(\*batch, 3\)"):
        fit.hand_offset([0.0, 0.0])


def test_intrinsics_and_a_camera_that_stands_elsewhere_are_found(body):
    rng = np.random.default_rng(0)
    model = bk.Pinhole(
        fx=800.0, fy=790.0, cx=320.0, cy=240.0, distortion=(-0.1, 0.05, 1e-3, -1e-3, 0.0), size=(640, 480)
    )
    camera = bk.Camera(body.camera.link, body.camera.link_T_camera, model)
    nominal = dataclasses.replace(body, camera=camera)
    q = body.touch_postures(range(441), distance=0.03).numpy()
    q += 0.02 * rng.standard_normal(q.shape)
    moved = body.camera.link_T_camera.numpy().copy()
    moved[:3, 3] += [0.004, -0.003, 0.002]
    true = dataclasses.replace(
        body, camera=bk.Camera(camera.link, moved, dataclasses.replace(model, fx=812.0, cx=326.0))
    )
    image = true.hand_image(torch.from_numpy(q)).numpy() + 0.1 * rng.standard_normal((441, 2))
    exp = bk.recording(q=q, hand_image=image, joints=list(body.joints), order="scattered", unit="px")
    fit = calibrate(nominal, exp, free=["camera", "intrinsics"])
    assert fit.nominal.medians[0] > 5.0
    assert fit.held_out.medians[0] < 0.2
    found = fit.body.camera.model
    assert abs(found.fx - 812.0) < 0.3 * abs(model.fx - 812.0) or "fx" in " ".join(fit.unobservable)
