"""Laws of cameras: the virtual screen by hand, the pinhole by OpenCV's published formula, all by their derivatives."""

import dataclasses
import functools
import inspect
import math
import pickle

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import central

import bodyimage_kin as bk
from bodyimage_kin.body import Camera, CameraModel, Pinhole, Stereo, Tracker, VirtualScreen
from bodyimage_kin.errors import FoldedLens, InvalidArray, InvalidConfig, NotVisible
from bodyimage_kin.robot.transforms import rpy_matrix, transform

SCREEN = VirtualScreen(distance=0.04, near=0.05, half_angle=math.radians(60))
LENS = (-0.28, 0.09, 1.1e-3, -0.6e-3, -0.013)
PINHOLE = Pinhole(615.0, 620.0, 322.5, 238.0, distortion=LENS, size=(640, 480), near=0.02)
BESIDE = transform(rpy_matrix((0.02, -0.05, 0.01)), (0.06, 0.001, -0.002))
STEREO = Stereo(PINHOLE, Pinhole(600.0, 600.0, 320.0, 240.0, size=(640, 480)), BESIDE)


def tensor(*values):
    return torch.tensor(values, dtype=torch.float64)


def test_a_point_is_seen_at_screen_distance_times_its_slope():
    # x = h_z h_x / z and y = h_z h_y / z (equations 18 and 19).
    image = SCREEN.project(tensor([0.02, -0.03, 0.08], [0.02, -0.03, 0.04], [0.0, 0.0, 1.0]))
    torch.testing.assert_close(image, tensor([0.01, -0.015], [0.02, -0.03], [0.0, 0.0]), atol=1e-17, rtol=0)


def test_what_is_not_in_front_has_no_image():
    image = SCREEN.project(tensor([0.1, 0.1, 0.0], [0.1, 0.1, -1.0], [0.1, 0.1, 1e-9]))
    assert image.isnan().all(1).tolist() == [True, True, False]


def test_a_point_without_image_spoils_no_gradient():
    points = tensor([0.1, 0.1, -1.0], [0.01, 0.0, 0.1]).requires_grad_()
    SCREEN.project(points)[1].sum().backward()
    assert torch.isfinite(points.grad).all()


@pytest.mark.parametrize("batch", [(), (0,), (2, 3)])
def test_the_derivative_is_that_of_the_projection(batch):
    points = torch.rand(*batch, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)) + 0.05
    derivative = SCREEN.derivative(points)
    assert derivative.shape == (*batch, 2, 3)
    for point, expected in zip(points.reshape(-1, 3), derivative.reshape(-1, 2, 3), strict=True):
        torch.testing.assert_close(torch.func.jacrev(SCREEN.project)(point), expected, atol=1e-14, rtol=1e-14)


def test_the_derivative_by_hand():
    # h_z / z [[1, 0, -x/z], [0, 1, -y/z]] at z = 0.08.
    derivative = SCREEN.derivative(tensor(0.02, -0.04, 0.08))
    torch.testing.assert_close(derivative, tensor([0.5, 0.0, -0.125], [0.0, 0.5, 0.25]), atol=1e-16, rtol=0)


def test_the_view_is_a_cone_beyond_the_near_plane():
    inside = math.tan(math.radians(59.9)) * 0.1
    outside = math.tan(math.radians(60.1)) * 0.1
    seen = {
        (0.0, 0.0, 0.05): True,
        (0.0, 0.0, 0.0499): False,
        (0.0, 0.0, -0.1): False,
        (inside, 0.0, 0.1): True,
        (0.0, -inside, 0.1): True,
        (outside, 0.0, 0.1): False,
        # A cone, not a pyramid: each coordinate alone would pass.
        (0.8 * inside, 0.8 * inside, 0.1): False,
        (0.0, 0.0, math.nan): False,
    }
    assert SCREEN.visible(tensor(*seen)).tolist() == list(seen.values())


# Every model ----------------------------------------------------------------------------------------------------------


class Orthographic:
    """A model of one's own: it keeps to the protocol and inherits nothing; a single coordinate, in millimetres."""

    m, unit, names = 1, "mm", ("height",)

    def project(self, points):
        return -1000.0 * points[..., 1:2]

    def derivative(self, points):
        return points.new_tensor([0.0, -1000.0, 0.0]).expand(*points.shape[:-1], 1, 3)

    def visible(self, points):
        return points[..., 2] > 0.0


MODELS = {"screen": SCREEN, "pinhole": PINHOLE, "stereo": STEREO, "tracker": Tracker(), "own": Orthographic()}


@functools.cache
def infant():
    return bk.load_embodiment("infant")


def looking(model, link_T_camera=None, body=None):
    """The infant, or another body, with another camera in its eye."""
    body = body or infant()
    pose = body.camera.link_T_camera if link_T_camera is None else link_T_camera
    return dataclasses.replace(body, camera=Camera(body.camera.link, pose, model))


def in_the_image(model, count=400, seed=0):
    """Points all over the image and up to its very edges."""
    rng = np.random.default_rng(seed)
    wide, high = model.size
    pixels = rng.uniform([-0.5, -0.5], [wide - 0.5, high - 0.5], (count, 2))
    edge = count // 2
    pixels[:edge, 0] = rng.choice([-0.5 + 1e-6, wide - 0.5 - 1e-6], edge)
    depth = torch.from_numpy(rng.uniform(0.05, 3.0, (count, 1)))
    return torch.cat([model.undistort(pixels), torch.ones(count, 1).double()], 1) * depth


@pytest.mark.parametrize("name", MODELS)
def test_every_derivative_is_that_of_the_projection_near_the_edges_too(name):
    model = MODELS[name]
    points = in_the_image(PINHOLE, 100)
    derivative = model.derivative(points)
    assert derivative.shape == (100, model.m, 3)
    auto = torch.func.vmap(torch.func.jacrev(model.project))(points)
    scale = derivative.abs().amax((1, 2), keepdim=True)
    assert float(((auto - derivative) / scale).abs().max()) < 1e-10
    for point, expected in zip(points, derivative, strict=True):
        differences = central(model.project, point, 1e-3 * float(point[2]))
        assert float((differences - expected).abs().max() / expected.abs().max()) < 1e-7


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("batch", [(), (0,), (2, 3)])
def test_every_model_keeps_to_the_protocol(name, dtype, batch):
    model = MODELS[name]
    assert isinstance(model, CameraModel)
    assert (isinstance(model.unit, str), len(model.names)) == (True, model.m)
    points = torch.tensor([0.01, -0.02, 0.3], dtype=dtype).expand(*batch, 3)
    image, derivative, visible = model.project(points), model.derivative(points), model.visible(points)
    assert (image.shape, derivative.shape, visible.shape) == ((*batch, model.m), (*batch, model.m, 3), batch)
    assert (image.dtype, derivative.dtype, visible.dtype) == (dtype, dtype, torch.bool)
    assert bool(visible.all())


@pytest.mark.parametrize("model", [SCREEN, PINHOLE, STEREO])
def test_what_lies_behind_is_not_seen_has_no_image_and_spoils_no_gradient(model):
    points = tensor([0.01, 0.02, -0.3], [0.0, 0.0, 0.0], [0.01, 0.02, 0.3]).requires_grad_()
    assert model.project(points).isnan().any(-1).tolist() == [True, True, False]
    assert model.derivative(points).isnan().flatten(1).any(-1).tolist() == [True, True, False]
    assert model.visible(points).tolist() == [False, False, True]
    for found in (model.project(points), model.derivative(points)):
        (gradient,) = torch.autograd.grad(found[2].sum(), points)
        assert gradient.isfinite().all()


def test_a_tracker_reports_the_point_wherever_it_is():
    points = tensor([0.3, 0.1, -2.0], [0.0, 0.0, 0.0])
    assert torch.equal(Tracker().project(points), points)
    assert bool(Tracker().visible(points).all())
    assert (Tracker().unit, STEREO.unit, PINHOLE.unit, SCREEN.unit) == ("m", "px", "px", "m")


def test_stereo_is_two_cameras_of_one_mount():
    points = in_the_image(PINHOLE)
    in_right = (points - torch.from_numpy(BESIDE[:3, 3])) @ torch.from_numpy(BESIDE[:3, :3])
    image = STEREO.project(points)
    assert torch.equal(image[:, :2], PINHOLE.project(points))
    torch.testing.assert_close(image[:, 2:], STEREO.right.project(in_right), rtol=1e-13, atol=1e-10)
    assert torch.equal(STEREO.visible(points), PINHOLE.visible(points) & STEREO.right.visible(in_right))
    assert 0 < int(STEREO.visible(points).sum()) < int(PINHOLE.visible(points).sum())
    assert STEREO.names == ("left u", "left v", "right u", "right v")


# The pinhole ----------------------------------------------------------------------------------------------------------


def opencv(camera, point):
    """The formulas of OpenCV's calib3d module for one point, as its documentation writes them down."""
    k1, k2, p1, p2, k3 = camera.distortion
    x_c, y_c, z_c = point
    x, y = x_c / z_c, y_c / z_c
    r = math.sqrt(x * x + y * y)
    radial = 1 + k1 * r**2 + k2 * r**4 + k3 * r**6
    x_d = x * radial + 2 * p1 * x * y + p2 * (r**2 + 2 * x**2)
    y_d = y * radial + p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y
    return camera.fx * x_d + camera.cx, camera.fy * y_d + camera.cy


def test_the_pinhole_is_opencvs():
    points = in_the_image(PINHOLE)
    expected = np.array([opencv(PINHOLE, point) for point in points.tolist()])
    np.testing.assert_allclose(PINHOLE.project(points), expected, rtol=0, atol=1e-10)
    # By hand, without distortion: f x/z + c.
    plain = Pinhole(100.0, 200.0, 10.0, 20.0)
    torch.testing.assert_close(plain.project(tensor(0.1, -0.2, 0.5)), tensor(30.0, -60.0), rtol=0, atol=1e-12)
    # Four coefficients have k3 = 0; the order is OpenCV's.
    four = dataclasses.replace(PINHOLE, distortion=LENS[:4])
    assert four == dataclasses.replace(PINHOLE, distortion=(*LENS[:4], 0.0))
    assert Pinhole.from_matrix(PINHOLE.matrix, np.array([LENS]), (640, 480), near=0.02) == PINHOLE


coefficient = st.floats(-1.0, 1.0)
lenses = st.tuples(
    st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.5, 0.5)
)


@given(distortion=lenses)
@settings(max_examples=60)
def test_the_fold_is_the_first_place_where_the_lens_is_singular(distortion):
    camera = Pinhole(1.0, 1.0, 0.0, 0.0, distortion)
    angle = torch.linspace(0.0, 2 * math.pi, 721, dtype=torch.float64)
    reach = min(camera.fold, 20.0)

    def least_determinant(t):
        points = torch.stack([t * angle.cos(), t * angle.sin(), torch.ones_like(angle)], 1)
        # A lens without size that never folds: its formula alone.
        open_lens = dataclasses.replace(camera)
        open_lens.__dict__["fold"] = math.inf
        return float(torch.linalg.det(open_lens.derivative(points)[:, :, :2]).min())

    assert all(least_determinant(t) > 0.0 for t in np.linspace(1e-3, 0.999 * reach, 40))
    if math.isfinite(camera.fold) and camera.fold < 20.0:
        assert least_determinant(1.001 * camera.fold) < 1e-3 * (1.0 + camera.fold**12)


@given(distortion=lenses, focal=st.floats(50.0, 9000.0), seed=st.integers(0, 100))
@settings(max_examples=80)
def test_undistorting_is_the_way_back_to_a_ten_billionth_of_a_pixel(distortion, focal, seed):
    camera = Pinhole(focal, 1.1 * focal, 320.0, 240.0, distortion)
    rng = np.random.default_rng(seed)
    reach = min(0.999 * camera.fold, 1.5)
    angle, radius = rng.uniform(0, 2 * math.pi, 200), reach * np.sqrt(rng.uniform(size=200))
    there = torch.from_numpy(np.stack([radius * np.cos(angle), radius * np.sin(angle), np.ones(200)], 1))
    pixels = camera.project(there)
    back = camera.undistort(pixels)
    again = camera.project(torch.cat([back, torch.ones(200, 1).double()], 1))
    assert float((again - pixels).abs().max()) <= 1e-10
    # Away from the fold the directions are the same, too.
    inner = torch.from_numpy(radius) < 0.9 * camera.fold
    torch.testing.assert_close(back[inner], there[inner, :2], rtol=1e-8, atol=1e-9)


def test_undistorting_keeps_what_is_unseen_and_any_batch_shape():
    pixels = torch.full((2, 3, 2), 100.0)
    pixels[0, 1] = math.nan
    found = PINHOLE.undistort(pixels)
    assert (found.shape, found.dtype) == ((2, 3, 2), torch.float32)
    assert found.isnan().all(-1).tolist() == [[False, True, False], [False, False, False]]
    assert PINHOLE.undistort(np.zeros((0, 2))).shape == (0, 2)
    assert PINHOLE.undistort([322.5, 238.0]).tolist() == [0.0, 0.0]
    with pytest.raises(InvalidConfig, match=r"pixels have shape \(3,\); give \(\*batch, 2\)"):
        PINHOLE.undistort([1.0, 2.0, 3.0])


BARREL = (-0.3, 0.0, 0.0, 0.0, 0.0)
"""It turns back where 1 = 0.9 s: at s = 10/9, seen at 0.7027 of the focal length."""


def test_beyond_the_fold_nothing_is_seen():
    camera = Pinhole(300.0, 300.0, 200.0, 200.0, BARREL)
    assert camera.fold == pytest.approx(math.sqrt(10 / 9), rel=1e-12)
    aside = tensor([0.9, 0.0, 1.0], [1.6, 0.0, 1.0])
    # By the formula the farther point would stand in the middle of the image once more.
    assert opencv(camera, aside[1].tolist())[0] == pytest.approx(200 + 300 * 1.6 * (1 - 0.3 * 2.56))
    assert camera.project(aside).isnan().any(1).tolist() == [False, True]
    assert camera.derivative(aside).isnan().flatten(1).any(1).tolist() == [False, True]
    assert camera.visible(aside).tolist() == [True, False]
    with pytest.raises(FoldedLens, match=r"pixel \[412\.0, 200\.0\] \(1 of 2\): no direction.*back 46\.5 degrees"):
        camera.undistort([[410.0, 200.0], [412.0, 200.0]])


def test_a_lens_that_folds_inside_of_the_image_is_refused():
    # Seen up to 0.7027 * 300 = 210.8 px from the middle: a circle that holds this square, and not a wider one.
    assert Pinhole(300.0, 300.0, 148.5, 148.5, BARREL, size=(298, 298)).fold > 1.0
    with pytest.raises(FoldedLens, match=r"folds inside of the image of 300 x 300 px; .*46\.5 degrees.*smaller 'size'"):
        Pinhole(300.0, 300.0, 149.5, 149.5, BARREL, size=(300, 300))
    # A principal point aside brings one corner beyond.
    with pytest.raises(FoldedLens):
        Pinhole(300.0, 300.0, 160.0, 148.5, BARREL, size=(298, 298))


def test_a_pixel_is_seen_up_to_its_own_edge():
    camera = Pinhole(100.0, 100.0, 0.0, 0.0, size=(10, 20), near=0.5)
    inside = tensor([-0.499, 0.0], [-0.501, 0.0], [9.499, 19.499], [9.499, 19.501], [9.501, 0.0])
    points = torch.cat([inside / 100.0, torch.ones(5, 1).double()], 1)
    assert camera.visible(points).tolist() == [True, False, True, False, False]
    assert camera.visible(0.5 * points).tolist() == [False] * 5
    assert bool(dataclasses.replace(camera, size=None).visible(points).all())


def make(kind, *values, **named):
    """An object as users make it: what is given is checked by the class, not by the type checker of these tests."""
    made = object.__new__(kind)
    inspect.unwrap(kind.__init__)(made, *values, **named)
    return made


BAD = {
    "negative focal length": (lambda: make(Pinhole, -600, 600, 320, 240), "fx=-600: give a number above 0"),
    "focal length of text": (lambda: make(Pinhole, 600, "600", 320, 240), "fy='600': give a number above 0"),
    "principal point not finite": (lambda: make(Pinhole, 600, 600, math.nan, 240), "cx=nan: give a number"),
    "size not whole": (
        lambda: make(Pinhole, 600, 600, 320, 240, size=(640.0, 480)),
        r"size\[0\]=640.0: give a whole number",
    ),
    "size of one": (lambda: make(Pinhole, 600, 600, 320, 240, size=(640,)), r"size=\(640,\): give width and height"),
    "size zero": (
        lambda: make(Pinhole, 600, 600, 320, 240, size=(0, 480)),
        r"size\[0\]=0: give a whole number of at least 1",
    ),
    "size a number": (lambda: make(Pinhole, 600, 600, 320, 240, size=640), "size=640: give width and height"),
    "eight coefficients": (lambda: make(Pinhole, 600, 600, 320, 240, [0.0] * 8), "distortion=.*OpenCV's model of five"),
    "distortion not finite": (lambda: make(Pinhole, 600, 600, 320, 240, [math.inf, 0, 0, 0]), r"distortion\[0\]=inf"),
    "skew": (lambda: Pinhole.from_matrix([[600, 1, 320], [0, 600, 240], [0, 0, 1]]), "without skew"),
    "screen behind": (lambda: make(VirtualScreen, -0.04), "distance=-0.04: give a number above 0"),
    "wide cone": (
        lambda: make(VirtualScreen, 0.04, half_angle=1.6),
        "half_angle=1.6: give a number above 0 and below 1.5708",
    ),
    "true": (lambda: make(VirtualScreen, True), "distance=True: give a number"),
    "pose of ones": (lambda: make(Camera, "eye", np.ones((4, 4)), SCREEN), r"link_T_camera\[3\]=.*give 0, 0, 0, 1"),
    "pose scaled": (
        lambda: make(Camera, "eye", np.diag([2, 2, 2, 1]), SCREEN),
        r"not orthogonal unit vectors \(off by 3\)",
    ),
    "pose sheared": (lambda: make(Camera, "eye", sheared(), SCREEN), "not orthogonal unit vectors"),
    "pose mirrored": (lambda: make(Camera, "eye", np.diag([1, 1, -1, 1]), SCREEN), "mirrors"),
    "pose not finite": (lambda: make(Camera, "eye", np.full((4, 4), np.nan), SCREEN), "not finite"),
    "pose of three rows": (
        lambda: make(Camera, "eye", np.eye(3), SCREEN),
        r"link_T_camera has shape \(3, 3\); give \(4, 4\)",
    ),
    "stereo pose": (lambda: make(Stereo, PINHOLE, PINHOLE, 2 * np.eye(4)), r"left_T_right\[3\]"),
    "stereo of two units": (lambda: make(Stereo, PINHOLE, SCREEN, np.eye(4)), "left camera speaks px, the right one m"),
    "no model": (lambda: make(Camera, "eye", np.eye(4), "pinhole"), "camera model='pinhole': .* lacks m, unit"),
    "class for an object": (lambda: make(Camera, "eye", np.eye(4), Tracker), "give an object with m, unit"),
    "no link": (lambda: make(Camera, "", np.eye(4), SCREEN), "camera link=''"),
}


def sheared():
    matrix = np.eye(4)
    matrix[0, 1] = 1e-4
    return matrix


@pytest.mark.parametrize("bad", BAD)
def test_bad_cameras_are_refused_in_one_line(bad):
    bad_camera, message = BAD[bad]
    with pytest.raises(InvalidConfig, match=message) as caught:
        bad_camera()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"m": 0}, r"camera model.m=0: give a whole number of at least 1"),
        ({"names": ("x", "y")}, r"names=\('x', 'y'\): give a tuple of 1 names"),
        ({"project": lambda points: points}, r"project: of points \(2, 3\) comes \(2, 3\); give a tensor \(2, 1\)"),
        ({"visible": lambda points: True}, r"visible: of points \(2, 3\) comes bool"),
        ({"unit": ""}, "camera model.unit=''"),
    ],
)
def test_a_model_of_ones_own_is_tried_before_it_is_used(change, message):
    model = type("Own", (Orthographic,), {k: staticmethod(v) if callable(v) else v for k, v in change.items()})()
    with pytest.raises(InvalidConfig, match=message):
        Camera("eye", np.eye(4), model)


def test_a_rotation_typed_with_six_digits_is_made_exact_and_an_exact_one_kept():
    exact = transform(rpy_matrix((0.3, -1.2, 2.5)), (0.1, 0.2, 0.3))
    assert np.array_equal(Camera("eye", exact, SCREEN).link_T_camera, exact)
    found = Camera("eye", np.round(exact, 6), SCREEN).link_T_camera.numpy()
    np.testing.assert_allclose(found[:3, :3].T @ found[:3, :3], np.eye(3), rtol=0, atol=1e-15)
    np.testing.assert_allclose(found, exact, rtol=0, atol=2e-6)


@pytest.mark.parametrize("name", [name for name in MODELS if name != "own"])
def test_cameras_are_equal_by_what_they_are(name):
    camera = Camera("eye", BESIDE, MODELS[name])
    again = pickle.loads(pickle.dumps(camera))
    assert (again == camera, hash(again) == hash(camera)) == (True, True)
    assert camera != Camera("ear", BESIDE, MODELS[name])
    assert camera != Camera("eye", np.eye(4), MODELS[name])
    assert camera != Camera("eye", BESIDE, dataclasses.replace(PINHOLE, fx=614.0))
    assert Stereo(PINHOLE, PINHOLE, BESIDE) != STEREO


# In a body ------------------------------------------------------------------------------------------------------------


@functools.cache
def in_front(count=33):
    body = infant()
    q = body.felt_robot.sample(4000, seed=1)
    point = body.hand_in_camera(q)
    return q[(point[:, 2] > 0.08) & (point[:, :2].norm(dim=1) < 0.6 * point[:, 2])][:count]


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("given_offset", [None, "one", "each"])
def test_the_compiled_image_is_that_of_the_formulas(name, given_offset):
    q = in_front()
    offset = {"one": tensor(0.01, -0.005, 0.02), "each": 0.02 * torch.rand(33, 3).double(), None: None}[given_offset]
    model, body = MODELS[name], looking(MODELS[name])
    slow = dataclasses.replace(body)
    slow.__dict__["_sight"] = None
    assert (body._sight is not None, body.m) == (True, model.m)
    for function in ("hand_image", "hand_image_jacobian"):
        found = getattr(body, function)(q, hand_offset=offset)
        expected = getattr(slow, function)(q, hand_offset=offset)
        scale = float(expected.abs().max())
        torch.testing.assert_close(found, expected, rtol=1e-11, atol=1e-13 * scale)
    # The centre named is the centre not named, to the bit.
    assert torch.equal(body.hand_image(q, hand_offset=infant().hand.offset), body.hand_image(q))
    # From poses alone, and no shared formula.
    kin = bk.kinematics(body.robot, "pinocchio")
    full, carried = body.full_posture(q), offset if offset is not None else body.hand.offset
    hand, eye = kin.pose(full, body.hand.link), kin.pose(full, body.camera.link) @ body.camera.link_T_camera
    places = hand[:, :3, 3] + (hand[:, :3, :3] @ carried.expand(33, 3)[..., None])[..., 0]
    point = torch.linalg.solve(eye, torch.cat([places, torch.ones(33, 1).double()], 1)[..., None])[:, :3, 0]
    torch.testing.assert_close(body.hand_image(q, hand_offset=offset), model.project(point), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("name", MODELS)
def test_image_and_jacobian_keep_all_derivatives(name):
    body = looking(MODELS[name])
    q = in_front()[:2].clone().requires_grad_()
    offset = tensor(0.01, -0.005, 0.02).requires_grad_()
    # Images in pixels are thousands of times the joints.
    size = float(body.hand_image_jacobian(q.detach()).abs().max())

    def image(q, offset):
        return body.hand_image(q, hand_offset=offset) / size

    def jacobian(q, offset):
        return body.hand_image_jacobian(q, hand_offset=offset) / size

    for function in (image, jacobian):
        assert torch.autograd.gradcheck(function, (q, offset))
        assert torch.autograd.gradgradcheck(function, (q, offset), atol=1e-4)
    auto = torch.func.vmap(torch.func.jacrev(lambda x: body.hand_image(x, on_invisible="nan")))(q.detach())
    torch.testing.assert_close(auto, body.hand_image_jacobian(q.detach()), rtol=1e-10, atol=1e-10 * size)


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("batch", [(), (0,), (2, 3)])
def test_every_batch_shape_and_dtype_of_every_model(name, batch):
    model, body = MODELS[name], looking(MODELS[name])
    q = in_front()[0].expand(*batch, 5)
    for offset in (None, [0, 0, 0.01], torch.zeros(*batch, 3)):
        assert body.hand_image(q, hand_offset=offset).shape == (*batch, model.m)
        assert body.hand_image_jacobian(q, hand_offset=offset).shape == (*batch, model.m, 5)
        assert body.visible(q, hand_offset=offset).shape == batch
        assert body.hand_in_camera(q, hand_offset=offset).shape == (*batch, 3)
    single = body.hand_image(q.to(torch.float32))
    assert single.dtype == torch.float32
    torch.testing.assert_close(single.double(), body.hand_image(q), rtol=1e-4, atol=1e-4)


def test_a_bad_hand_offset_is_refused():
    body, q = infant(), in_front()[:4]
    for offset in ([0.0, 0.0], torch.zeros(3, 3), torch.zeros(2, 4, 3), [0.0, math.nan, 0.0], "tip"):
        for function in (body.hand_image, body.hand_image_jacobian, body.visible, body.hand_in_camera):
            with pytest.raises(InvalidArray, match="hand_offset"):
                function(q, hand_offset=offset)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("model", [SCREEN, PINHOLE, Pinhole(600.0, 600.0, 320.0, 240.0, BARREL), STEREO])
def test_where_there_is_no_image_it_raises_or_is_nan(model, compiled):
    body = looking(model)
    if not compiled:
        body.__dict__["_sight"] = None
    q = body.felt_robot.sample(3000, seed=3)
    point = body.hand_in_camera(q)
    expected = model.project(point).isnan()
    assert 0 < int(expected.any(1).sum()) < 3000
    image, jacobian = body.hand_image(q, on_invisible="nan"), body.hand_image_jacobian(q, on_invisible="nan")
    assert torch.equal(image.isnan(), expected)
    assert torch.equal(jacobian.isnan().any(2), expected)
    assert torch.equal(jacobian.isnan().all(2), expected)
    some = q[expected.any(1)][:5]
    for function in (body.hand_image, body.hand_image_jacobian):
        with pytest.raises(NotVisible, match=r"behind the camera plane.* in 5 of 5 postures.*on_invisible='nan'"):
            function(some)
        with pytest.raises(InvalidConfig, match="on_invisible='zero'"):
            function(some, on_invisible="zero")


def test_an_eye_in_the_hand_sees_what_moves_past_it():
    # The camera on the hand looks at a point of the head: motion of the arm is motion of the camera.
    robot, body = infant().robot, infant()
    down = transform(rpy_matrix((0.0, 0.0, 0.0)), (0.0, 0.0, 0.0))
    hand = dataclasses.replace(body.hand, link="head")
    swapped = dataclasses.replace(body, hand=hand, camera=Camera("left_hand", down, Tracker()))
    q = in_front()[:5]
    kin = bk.kinematics(robot, "pinocchio")
    full = body.full_posture(q)
    expected = torch.linalg.solve(kin.pose(full, "left_hand"), kin.pose(full, "head"))[:, :3, 3]
    torch.testing.assert_close(swapped.hand_image(q), expected, rtol=1e-12, atol=1e-14)
    jacobian = swapped.hand_image_jacobian(q)
    for posture, found in zip(q, jacobian, strict=True):
        torch.testing.assert_close(found, central(swapped.hand_image, posture), rtol=1e-7, atol=1e-9)
