"""What the viewer shows, computed without a window: where everything is, to the same numbers as the library's."""

import time

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import view
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.estimators.analytic import AnalyticJacobian


@pytest.fixture(scope="module")
def scene(body, circle, touch):
    estimators = {
        "analytic": bk.estimators.Analytic(body),
        "rational_trig": bk.estimators.RationalTrig(),
        "least_squares": bk.estimators.LeastSquares(),
    }
    scores = {"row": np.arange(body.skin.count)}
    return view.Scene(body, {"circle": circle, "touch": touch}, estimators, learn_from=circle, scores=scores)


def picture(body, moment, image):
    """An image of the virtual screen, in the camera's axes."""
    return np.array([*image, body.camera.model.distance])


def test_links_camera_and_hand_are_where_the_kinematics_has_them(body, scene, touch):
    moment = scene.moment("touch", 40)
    q = torch.from_numpy(touch.q.values[0, 40])
    full = body.full_posture(q)
    kin = bk.kinematics(body.robot, "pinocchio")
    assert set(moment.links) == set(scene.surfaces)
    for link, pose in moment.links.items():
        np.testing.assert_allclose(pose, kin.pose(full, link).numpy(), atol=1e-12)
    np.testing.assert_allclose(moment.hand, touch.true_hand_position.values[0, 40], atol=1e-12)
    camera = kin.pose(full, body.camera.link).numpy() @ body.camera.link_T_camera.numpy()
    np.testing.assert_allclose(moment.camera, camera, atol=1e-12)
    # The image is on the line of sight from the camera to the hand.
    sight = camera[:3, :3].T @ (moment.hand - camera[:3, 3])
    np.testing.assert_allclose(moment.image, sight / sight[2] * body.camera.model.distance, atol=1e-9)


def test_the_estimate_is_the_integral_and_snaps_back_at_resets(body, scene, circle, touch):
    learned = bk.estimators.LeastSquares().fit(bk.experience(circle), seed=0)
    estimate = bk.integrate(bk.experience(touch), learned).values[0]
    resets = np.flatnonzero(touch.at_reference.values[0])
    assert len(resets) > 1
    after = int(resets[resets > resets[0] + 5][0])
    for index in (after - 1, after):
        moment = scene.moment("touch", index, "least_squares")
        np.testing.assert_allclose(moment.estimate, picture(body, moment, estimate[index]), atol=1e-12)
    drifted, back = (scene.moment("touch", index, "least_squares") for index in (after - 1, after))
    assert len(drifted.path) > 5
    assert len(back.path) == 1
    assert any("begins anew" in text for text in back.says)
    # The truth itself stays beside the hand.
    off = {
        name: np.nanmean([np.linalg.norm(one.estimate - one.image) for one in moments])
        for name in ("analytic", "least_squares")
        for moments in ([scene.moment("touch", index, name) for index in range(10, 300, 20)],)
    }
    assert off["analytic"] < 0.7 * off["least_squares"]


def test_ellipses_are_the_jacobians_and_only_a_wrong_one_differs(scene, body):
    exact = scene.moment("touch", 40, "analytic")
    wrong = scene.moment("touch", 40, "least_squares")
    np.testing.assert_allclose(exact.learned_ellipse, exact.true_ellipse, atol=1e-9)
    assert np.abs(wrong.learned_ellipse - wrong.true_ellipse).max() > 1e-4
    J = body.hand_image_jacobian(torch.from_numpy(exact.q)).numpy()
    around = exact.true_ellipse[:, :2] - exact.image[:2]
    # Every point u of the ellipse fulfils u (J J^T)^-1 u = the same number.
    level = np.einsum("ni,ij,nj->n", around, np.linalg.inv(J @ J.T), around)
    np.testing.assert_allclose(level, level[0], rtol=1e-6)


def test_doubt_is_shown_of_those_who_have_it_and_grows_from_the_reset(scene, touch):
    resets = touch.at_reference.values[0]
    start = int(np.flatnonzero(resets[:-1] & ~resets[1:])[0])
    sizes = [np.ptp(scene.moment("touch", start + step, "rational_trig").doubt, axis=0).max() for step in (1, 20)]
    assert sizes[0] < sizes[1]
    assert not len(scene.moment("touch", start + 20, "least_squares").doubt)


def test_the_map_grows_with_touches_and_needs_them(scene, touch):
    first, last = (scene.moment("touch", index, "analytic").map for index in (0, scene.samples("touch") - 1))
    assert first.shape == last.shape == (441, 3)
    assert np.abs(first - last).max() > 1e-3
    assert not len(scene.moment("circle", 10, "analytic").map)


def test_the_skin_is_coloured_by_touches_so_far_or_by_a_score(scene, touch):
    last = scene.samples("touch") - 1
    moment = scene.moment("touch", last)
    touched = touch.touched.values[0]
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(moment.values)), np.unique(touched[touched >= 0]))
    assert np.nanmax(moment.values) == 1.0
    scored = scene.moment("touch", last, colouring="row").values
    np.testing.assert_allclose(scored, np.arange(441) / 440)


def test_postures_to_go_to_stand_beside_the_robot(body):
    q = body.touch_postures([0, 440]).numpy()
    ghosts = view.Scene(body, ghosts=q).ghost_links()
    kin = bk.kinematics(body.robot, "pinocchio")
    assert len(ghosts) == 2
    for posture, links in zip(q, ghosts, strict=True):
        assert "left_hand" in links
        assert "head" not in links
        for name, pose in links.items():
            np.testing.assert_allclose(pose, kin.pose(body.full_posture(posture), name).numpy(), atol=1e-12)


def test_a_posture_is_shown_without_any_recording(body):
    scene = view.Scene(body)
    moment = scene.posture(body.felt_home)
    assert np.isfinite(moment.hand).all()
    assert np.isnan(moment.estimate).all()
    assert not moment.touched
    with pytest.raises(UnknownName, match="recording"):
        scene.moment("circle", 0)
    with pytest.raises(InvalidConfig, match="give one for each of 441 taxels"):
        view.Scene(body, scores={"x": [1.0, 2.0]})


def test_who_cannot_learn_says_so_on_the_page(body, touch):
    scene = view.Scene(body, {"touch": touch}, {"paper": bk.estimators.PaperMLP()})
    moment = scene.moment("touch", 3, "paper")
    assert any(text.startswith("paper: ") for text in moment.says)


def test_scattered_postures_are_gone_through_touch_by_touch(body, touch):
    few = touch.isel(time=slice(0, 60))
    scattered = bk.recording(
        q=few.q.values[0], touched=few.touched.values[0], joints=list(body.joints), order="scattered"
    )
    scene = view.Scene(body, {"mine": scattered}, {"analytic": bk.estimators.Analytic(body)})
    stops = scene.stops("mine")
    assert list(stops) == list(np.flatnonzero((few.touched.values[0] >= 0).any(1)))
    moment = scene.moment("mine", int(stops[-1]), "analytic")
    np.testing.assert_allclose(moment.estimate, moment.image, atol=1e-4)


@pytest.mark.parametrize(
    "model",
    [
        bk.Pinhole(500.0, 510.0, 320.0, 240.0, distortion=(0.05, -0.02, 1e-3, -1e-3, 0.0), size=(640, 480)),
        bk.Stereo(
            bk.Pinhole(500.0, 510.0, 320.0, 240.0), bk.Pinhole(500.0, 510.0, 320.0, 240.0),
            [[1, 0, 0, 0.02], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        ),
        bk.Tracker(),
    ],
    ids=["pinhole", "stereo", "tracker"],
)  # fmt: skip
def test_any_camera_shows_the_image_on_the_line_of_sight(body, model):
    other = bk.Embodiment.build(
        body.robot, joints=list(body.joints), hand=body.hand,
        camera=bk.Camera(body.camera.link, body.camera.link_T_camera, model),
    )  # fmt: skip
    scene = view.Scene(other, estimators={"analytic": AnalyticJacobian(other)})
    moment = scene.posture(body.felt_home, "analytic")
    sight = moment.camera[:3, :3].T @ (moment.hand - moment.camera[:3, 3])
    np.testing.assert_allclose(moment.image / np.linalg.norm(moment.image), sight / np.linalg.norm(sight), atol=1e-8)
    assert len(moment.true_ellipse) > 8
    np.testing.assert_allclose(moment.learned_ellipse, moment.true_ellipse, atol=1e-9)


def test_rods_stand_where_meshes_are_missing(body):
    urdf = '<robot name="m"><link name="a"><visual><geometry><mesh filename="no.stl"/></geometry></visual></link>\n'
    urdf += '<link name="b"/><joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
    urdf += '<origin xyz="0 0 0.3"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    robot = bk.Robot.from_urdf(urdf)
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -1], [0, 0, 0, 1]]
    arm = bk.Embodiment.build(
        robot, joints=["j"], hand=bk.Hand("b", (0.1, 0, 0)), camera=bk.Camera("a", pose, bk.Tracker())
    )
    scene = view.Scene(arm)
    assert set(scene.surfaces) == {"a", "b"}
    assert "no.stl" in scene.notes[0]


def test_a_step_of_the_slider_takes_no_longer_than_a_frame(scene):
    scene.moment("touch", 0, "rational_trig")
    took = []
    for index in np.linspace(0, scene.samples("touch") - 1, 300).astype(int):
        begin = time.process_time()
        scene.moment("touch", int(index), "rational_trig")
        took.append(time.process_time() - begin)
    assert np.median(took) <= 0.033


def nao_torso(folder):
    """The places of the torso's taxels in the torso [m], by their numbers: row, triangle and patch added up."""
    table = np.loadtxt(folder / "Transformations" / "torso.txt")
    triangles = [*range(6), *range(8, 16), *range(16, 19), *range(24, 32)]
    places, ids = [], []
    for row, triangle in enumerate(triangles):
        numbers = [12 * triangle + within for within in range(12) if within not in (6, 10)]
        first = 3 + len(triangles) + 10 * row
        places.append(table[first : first + 10] + table[3 + row] + table[1 if triangle < 16 else 2] + table[0])
        ids += numbers
    return np.concatenate(places), np.array(ids)


@pytest.mark.real_data
@pytest.mark.filterwarnings("ignore::bodyimage_kin.errors.DataWarning")
def test_the_touches_of_a_real_robot_are_gone_through(real_data, tmp_path):
    robot = bk.Robot.from_urdf(real_data / "nao" / "nao.urdf")
    arm = ("RShoulderPitch", "RShoulderRoll", "RElbowYaw", "RElbowRoll", "RWristYaw")
    columns = {"q": {name: f"angles.{name}" for name in arm}, "touched": "activatedTaxels"}
    touches = bk.read_recording(real_data / "nao" / "torso_rightFinger.mat", columns, robot=robot, order="scattered")
    places, ids = nao_torso(real_data / "nao")
    places += np.array([0.0646, 0.0006, 0.0468])
    skin = bk.Skin.points(places, link="torso", forward=[1, 0, 0], right=[0, -1, 0])
    camera = bk.Camera("CameraTop_optical_frame", np.eye(4), bk.Pinhole(560.0, 560.0, 320.0, 240.0, size=(640, 480)))
    body = bk.Embodiment.build(robot, joints=arm, hand=bk.Hand("r_wrist", (0.06, 0, 0)), camera=camera, skin=skin)
    # The makers' numbers become those of the skin.
    number = np.full(384, -1)
    number[ids] = np.arange(len(ids))
    touched = touches["touched"].values
    touches["touched"].values = np.where(touched >= 0, number[touched], -1)
    scene = view.Scene(body, {"torso": touches}, {"analytic": bk.estimators.Analytic(body)})
    stops = scene.stops("torso")
    assert len(stops) > 1000
    moments = [scene.moment("torso", int(index), "analytic") for index in stops[::100]]
    assert all(moment.touched for moment in moments)
    assert np.isfinite([moment.hand for moment in moments]).all()
    gone = [int(np.isfinite(moment.values).sum()) for moment in moments]
    assert gone == sorted(gone)
    assert gone[-1] > 50
    assert moments[-1].map.shape == (skin.count, 3)
