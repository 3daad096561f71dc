"""Laws of the chain from camera to hand, and of finding it."""

import dataclasses

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.body.file import embodiment_folder
from bodyimage_kin.calibration import Prior, calibrate
from bodyimage_kin.errors import InvalidConfig, InvalidRecording, UnknownName
from bodyimage_kin.estimators import SelfCalibration, Uncertain
from bodyimage_kin.estimators.chain import Chain
from bodyimage_kin.estimators.self_calibration import CalibratedBody, CalibratedChain
from bodyimage_kin.metrics import pooled_relative_error

FAR = {"axis_spread": 0.2, "offset_spread": 0.02}
FELT = 'joints = ["left_shoulder_pitch", "left_shoulder_roll", "left_shoulder_yaw", "left_elbow", "left_wrist"]'


@pytest.fixture(scope="module")
def strange(tmp_path_factory):
    """Its neck carries the eye, its wrist slides, its elbow follows the shoulder and has an offset."""
    folder = tmp_path_factory.mktemp("strange")
    urdf = (embodiment_folder() / "infant.urdf").read_text()
    elbow, wrist = ('<joint name="left_elbow" type="revolute">', '<joint name="left_wrist" type="revolute">')
    assert elbow in urdf
    assert wrist in urdf
    urdf = urdf.replace(elbow, elbow + '<mimic joint="left_shoulder_yaw" multiplier="-0.5" offset="1.9"/>')
    urdf = urdf.replace(wrist, wrist.replace("revolute", "prismatic"))
    (folder / "infant.urdf").write_text(urdf)
    toml = (embodiment_folder() / "infant.toml").read_text()
    assert FELT in toml
    toml = toml.replace(FELT, 'joints = ["neck", "left_shoulder_pitch", "left_shoulder_yaw", "left_wrist"]')
    toml = toml.replace("left_elbow = 1.67\n", "").replace("left_wrist = 0.05\n", "left_wrist = 0.01\n")
    (folder / "strange.toml").write_text(toml)
    return bk.load_embodiment(folder / "strange.toml")


def around(body, count=30, spread=0.1):
    noise = torch.randn(count, body.p, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    q = body.felt_home + spread * noise
    return q[body.hand_in_camera(q)[:, 2] > 0.01]


@pytest.mark.parametrize("name", ["body", "strange"])
def test_the_chain_of_a_body_is_the_body(name, request):
    body = request.getfixturevalue(name)
    q = around(body)
    assert len(q) > 5
    known = CalibratedChain(Chain.of(body))
    torch.testing.assert_close(known.hand_image(q), body.hand_image(q), rtol=1e-10, atol=1e-12)
    torch.testing.assert_close(known.jacobian(q), body.hand_image_jacobian(q), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["body", "strange"])
def test_the_derivative_by_geometry_is_right(name, request):
    body = request.getfixturevalue(name)
    q, chain = around(body)[:4], Chain.of(body)
    geometry = chain.geometry * 1.1
    _, moved = chain.with_geometry(geometry).fit_terms(q)
    automatic = torch.func.jacrev(lambda g: chain.with_geometry(g).fit_terms(q)[0])(geometry)
    torch.testing.assert_close(moved, automatic, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["body", "strange"])
def test_conventions_are_what_images_leave_open_and_no_more(name, request):
    body = request.getfixturevalue(name)
    chain = Chain.of(body)
    geometry = chain.geometry * torch.linspace(0.9, 1.2, len(chain.geometry), dtype=torch.float64)
    _, moved = chain.with_geometry(geometry).convention(chain)
    automatic = torch.func.jacrev(lambda g: chain.with_geometry(g).convention(chain)[0])(geometry)
    torch.testing.assert_close(moved, automatic)
    rows, conventions = chain.convention(chain)
    assert rows.abs().max() < 1e-12
    q = around(body, 300, spread=0.5)
    images = chain.fit_terms(q)[1].flatten(0, 1)
    unknown = len(geometry) - int(torch.linalg.matrix_rank(images, rtol=1e-10))
    assert unknown == len(rows)
    assert torch.linalg.matrix_rank(torch.cat([images, conventions]), rtol=1e-10) == len(geometry)


def test_no_image_shows_the_common_scale(body):
    q, chain = around(body), Chain.of(body)
    k = len(chain.axes)
    scale = torch.cat([torch.full((3 * k,), 3.0), torch.full((3 * k + 3,), 2.0)]).to(torch.float64)
    larger = CalibratedChain(chain.with_geometry(chain.geometry * scale))
    torch.testing.assert_close(larger.jacobian(q), body.hand_image_jacobian(q), rtol=1e-9, atol=1e-12)


def test_what_a_circle_shows_tells_the_face(body, circle):
    learned = SelfCalibration(body, starts=3, **FAR).fit(bk.experience(circle), seed=0)
    face = body.touch_postures(np.arange(0, body.skin.count, 8))
    assert pooled_relative_error(body.hand_image_jacobian(face), learned.jacobian(face)) < 0.02


def test_a_start_is_not_the_truth(body, circle):
    """With next to no descent the answer is wrong: nothing leaks from the body but what the docstring says."""
    start = SelfCalibration(body, starts=1, steps=1, **FAR).fit(bk.experience(circle), seed=0)
    face = body.touch_postures(np.arange(0, body.skin.count, 8))
    assert pooled_relative_error(body.hand_image_jacobian(face), start.jacobian(face)) > 0.1


def test_a_body_of_other_joints_is_refused(strange, circle):
    with pytest.raises(UnknownName, match="no felt joint 'left_"):
        SelfCalibration(strange).fit(bk.experience(circle))


# With a prior --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def off(body, circle):
    """An infant whose axes and offsets are off by as much as the prior says."""
    thought = calibrate(body, bk.experience(circle), free=["axes"], folds=2)
    sd = thought.prior.sds(thought.parameters)
    wrong = np.isin([one.group for one in thought.parameters], ["axes", "offsets"])
    return thought.at(np.where(wrong, sd, 0.0) * np.random.default_rng(5).standard_normal(len(sd)))


@pytest.fixture(scope="module")
def seen(off):
    motion = bk.motions.Circle(turns=1.0)
    return bk.experience(bk.simulate(off, motion, seed=1, dynamics=False, noise=bk.Noise(image=2e-4)))


def on_face(off, learned):
    face = off.touch_postures(np.arange(0, off.skin.count, 8))
    return pooled_relative_error(off.hand_image_jacobian(face), learned.jacobian(face))


def test_out_of_sight_a_prior_beats_the_drawing_and_a_free_descent(body, off, seen):
    nominal = on_face(off, bk.estimators.Nominal(body).fit(seen))
    free = on_face(off, SelfCalibration(body, starts=1, **FAR).fit(seen, seed=0))
    known = on_face(off, SelfCalibration(body).fit(seen))
    assert known < 0.35 * min(nominal, free)


def test_it_is_the_core_that_calibrates_bodies(body, seen):
    learned = SelfCalibration(body).fit(seen)
    found = calibrate(body, seen, prior=Prior(hand_shift=0.02), free=["axes", "offsets", "hand"], folds=2).body
    q = found.touch_postures([0, 220, 440])
    torch.testing.assert_close(learned.jacobian(q), found.hand_image_jacobian(q), rtol=1e-6, atol=1e-9)


def test_its_doubt_is_that_of_the_calibrated_body_and_of_what_it_draws(body, off, seen, tmp_path):
    learned = SelfCalibration(body).fit(seen)
    fit = calibrate(body, seen, prior=Prior(hand_shift=0.02), free=["axes", "offsets", "hand"], folds=2)
    q = off.touch_postures([0, 220, 440])
    found, size = learned.covariance(q), learned.covariance(q).abs().amax((1, 2), keepdim=True)
    # By the chain's geometry, and by the bodies' measures.
    torch.testing.assert_close(found / size, fit.learned.covariance(q) / size, rtol=0.0, atol=1e-3)
    for drawn in (learned.draws(400, seed=1), fit.learned.draws(100, seed=1)):
        entries = torch.stack([one.jacobian(q).flatten(1) for one in drawn])
        variance, expected = entries.var(0), found.diagonal(dim1=1, dim2=2)
        assert ((variance / expected).log().abs() < 0.7).all()
    # An arm that is off as the prior says is as far off as it foretells.
    wrong = (learned.jacobian(q) - off.hand_image_jacobian(q)).flatten(1)
    assert 0.1 < float((wrong**2).sum() / found.diagonal(dim1=1, dim2=2).sum()) < 10
    learned.save(tmp_path)
    torch.testing.assert_close(bk.load_learned(tmp_path).covariance(q), found, rtol=1e-9, atol=1e-20)


@pytest.mark.parametrize("model", [bk.Pinhole(fx=800.0, fy=790.0, cx=320.0, cy=240.0), bk.Tracker()], ids=["px", "m"])
def test_any_camera_will_do(body, off, model):
    thought, true = (
        dataclasses.replace(one, camera=bk.Camera(one.camera.link, one.camera.link_T_camera, model))
        for one in (body, off)
    )
    q = true.touch_postures(range(0, 441, 4), distance=0.03)
    exp = bk.recording(
        q=q.numpy(), hand_image=true.hand_image(q).numpy(), joints=list(body.joints), order="scattered",
        unit=model.unit,
    )  # fmt: skip
    learned = SelfCalibration(thought).fit(exp)
    assert isinstance(learned, CalibratedBody)
    assert isinstance(learned, Uncertain)
    assert len(learned.draws(2)) == 2
    assert (learned.m, learned.p, learned.unit) == (model.m, 5, model.unit)
    J, nominal = true.hand_image_jacobian(q), thought.hand_image_jacobian(q)
    assert pooled_relative_error(J, learned.jacobian(q)) < 0.2 * pooled_relative_error(J, nominal)
    torch.testing.assert_close(
        learned.hand_image(q), true.hand_image(q), rtol=0.0, atol=1e-3 * float(exp.hand_image.std())
    )


@pytest.mark.usefixtures("unchecked")
def test_what_it_cannot_do_is_said(body, seen):
    with pytest.raises(InvalidRecording, match="and their own noise"):
        SelfCalibration(body).fit(seen.isel(time=slice(0, 5)))
    with pytest.raises(InvalidConfig, match="axis_spread=0"):
        SelfCalibration(body, axis_spread=0)
    assert SelfCalibration(body, starts=1, axis_spread=0).axis_spread == 0
