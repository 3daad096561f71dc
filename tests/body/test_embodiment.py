"""Laws of embodiments: the hand's image and its Jacobian, sight, touch, and the TOML they are made from."""

import dataclasses
import functools
import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import central, postures

import bodyimage_kin as bk
from bodyimage_kin.body.cameras import VirtualScreen
from bodyimage_kin.body.file import embodiment_folder
from bodyimage_kin.errors import InvalidConfig, InvalidPosture, InvalidURDF, NotVisible, UnknownName, Unreachable
from bodyimage_kin.robot import transforms

TOML = (embodiment_folder() / "infant.toml").read_text()
URDF = (embodiment_folder() / "infant.urdf").resolve()
# torch 2.13 warns of itself in forward mode.
FORWARD_MODE = pytest.mark.filterwarnings("ignore:.torch.jit.script. is deprecated:DeprecationWarning")


@functools.cache
def infant():
    return bk.load_embodiment("infant")


def write(folder, *changes):
    """The infant's TOML with pieces replaced."""
    text = TOML.replace('urdf = "infant.urdf"', f'urdf = "{URDF}"')
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file = folder / "changed.toml"
    file.write_text(text)
    return file


@pytest.fixture(scope="session")
def gazing(tmp_path_factory):
    """An infant that also feels its neck, which carries both the eye and the face."""
    change = ('joints = ["left_shoulder_pitch"', 'joints = ["left_wrist", "neck", "left_shoulder_pitch"')
    return bk.load_embodiment(write(tmp_path_factory.mktemp("gazing"), change, ('_elbow", "left_wrist"]', '_elbow"]')))


@functools.cache
def in_front():
    """Postures in which the hand has an image."""
    body = infant()
    q = body.felt_robot.sample(400, seed=1)
    return q[body.hand_in_camera(q)[:, 2] > 0.02][:40]


# The image of the hand ------------------------------------------------------------------------------------------------


def test_the_embodiment_says_what_it_is(body):
    assert body.name == "infant"
    assert body.name in bk.embodiments()
    assert body.joints == tuple(
        f"left_{j}" for j in ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist")
    )
    assert (body.p, body.m, body.home.shape) == (5, 2, (body.robot.n,))
    assert (body.hand.link, body.hand.offset.shape, body.hand.radius) == ("left_hand", (3,), 0.02)
    assert (body.camera.link, body.camera.link_T_camera.shape) == ("right_eye", (4, 4))
    assert body.camera.model == VirtualScreen(0.04, near=0.05, half_angle=math.radians(60))
    assert body.skin.shape == (21, 21)
    assert body.skin.positions.shape == body.skin.normals.shape == (441, 3)
    assert set(body.skin.landmarks) == {"left_eye", "right_eye", "nose", "mouth"}
    assert body.felt_robot.joint_names == body.joints
    with pytest.raises(dataclasses.FrozenInstanceError):
        body.name = "other"


def test_the_image_by_hand(body):
    # Everything from poses of the whole robot: no felt robot, no shared formula.
    kin = bk.kinematics(body.robot, "pytorch_kinematics")
    q = in_front()
    full = body.full_posture(q)
    hand = kin.pose(full, body.hand.link) @ torch.cat([body.hand.offset, torch.ones(1)]).double()
    camera = kin.pose(full, body.camera.link) @ body.camera.link_T_camera
    point = torch.linalg.solve(camera, hand[..., None])[..., 0]
    image = 0.04 * point[:, :2] / point[:, 2:3]
    torch.testing.assert_close(body.hand_image(q), image, atol=1e-12, rtol=1e-12)
    torch.testing.assert_close(body.hand_position(q), hand[:, :3], atol=1e-14, rtol=0)


def test_the_camera_looks_ahead_and_not_mirrored(body):
    # The robot looks along x, its left is y and up is z: the image's right is -y, its down is -z.
    rotation = body.kinematics.pose(body.felt_home, body.camera.link)[:3, :3] @ body.camera.link_T_camera[:3, :3]
    expected = torch.tensor([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], dtype=torch.float64)
    torch.testing.assert_close(rotation, expected)
    assert float(torch.linalg.det(rotation)) == pytest.approx(1.0)


def test_the_hand_at_the_eye_is_seen_in_true_size(body):
    # While touching, z is about h_z: the projection is about 1:1.
    q = body.touch_postures([body.skin.reference])
    assert float(body.hand_in_camera(q)[0, 2]) == pytest.approx(0.04, rel=0.1)


@given(q=st.deferred(lambda: postures(infant().felt_robot)))
@settings(max_examples=60)
def test_the_image_jacobian_is_the_derivative_of_the_image(q):
    body = infant()
    point = body.hand_in_camera(q)
    if point[2] < 0.02:
        assert body.hand_image(q, on_invisible="nan").isnan().any() or point[2] > 0
        return
    jacobian = body.hand_image_jacobian(q)
    tolerance = {"atol": 1e-8 * float(jacobian.abs().max()), "rtol": 0}
    torch.testing.assert_close(torch.func.jacrev(body.hand_image)(q), jacobian, atol=1e-12, rtol=1e-11)
    torch.testing.assert_close(central(body.hand_image, q, 1e-4), jacobian, **tolerance)


@FORWARD_MODE
def test_a_moving_camera_is_accounted_for(gazing, body):
    # In the order of the file, which is not the robot's.
    assert gazing.joints == gazing.felt_robot.joint_names == ("left_wrist", "neck", *body.joints[:4])
    q = gazing.felt_robot.sample(300, seed=2)
    q = q[gazing.hand_in_camera(q)[:, 2] > 0.05][:20]
    assert len(q) == 20
    jacobian = gazing.hand_image_jacobian(q)
    assert jacobian.shape == (20, 2, 6)
    assert (jacobian[..., 1].norm(dim=1) > 1e-3).all()
    for derivative in (torch.func.jacrev, torch.func.jacfwd):
        # What raises depends on values, which vmap does not allow.
        auto = torch.func.vmap(derivative(lambda x: gazing.hand_image(x, on_invisible="nan")))(q)
        torch.testing.assert_close(auto, jacobian, atol=1e-12, rtol=1e-11)
    for posture, expected in zip(q, jacobian, strict=True):
        torch.testing.assert_close(central(gazing.hand_image, posture, 1e-4), expected, atol=1e-8, rtol=1e-7)
    # With the neck at home it is the infant that does not feel it.
    arm = in_front()
    home = torch.cat([arm[:, 4:], torch.zeros(len(arm), 1, dtype=torch.float64), arm[:, :4]], dim=1)
    torch.testing.assert_close(gazing.hand_image(home), body.hand_image(arm), atol=1e-14, rtol=0)
    same = gazing.hand_image_jacobian(home)[..., [2, 3, 4, 5, 0]]
    torch.testing.assert_close(same, body.hand_image_jacobian(arm))
    assert torch.equal(gazing.full_posture(home), body.full_posture(arm))


def test_what_the_skin_feels_does_not_depend_on_where_the_head_is_turned(gazing):
    q = gazing.felt_robot.sample(5, seed=0)
    position, jacobian = gazing.hand_in_front_and_jacobian(q)
    torch.testing.assert_close(position, gazing.hand_in_skin(q))
    for posture, expected in zip(q, jacobian, strict=True):
        torch.testing.assert_close(central(gazing.hand_in_skin, posture), expected, atol=1e-9, rtol=0)
    # The hand is on each taxel as the head carries it, whatever the neck does on the way.
    taxels = [0, 220, 440]
    reached = gazing.touch_postures(taxels)
    on_skin = gazing.skin.touched(gazing.hand_in_skin(reached).numpy(), gazing.hand.radius)
    assert on_skin.tolist() == taxels
    assert (reached[:, 1].abs() > 1e-3).any()


@pytest.mark.parametrize("batch", [(), (0,), (2, 0, 3), (2, 3)])
def test_every_batch_shape(body, batch):
    q = in_front()[0].expand(*batch, 5)
    assert body.full_posture(q).shape == (*batch, body.robot.n)
    assert body.visible(q).shape == batch
    assert body.visible(q).dtype == torch.bool
    assert body.hand_image(q).shape == (*batch, 2)
    assert body.hand_image(q, on_invisible="nan").shape == (*batch, 2)
    assert body.hand_image_jacobian(q).shape == (*batch, 2, 5)
    assert body.hand_position(q).shape == body.hand_in_camera(q).shape == (*batch, 3)
    single = q.to(torch.float32)
    for function in (body.hand_image, body.hand_image_jacobian, body.full_posture):
        assert function(single).dtype == torch.float32
        torch.testing.assert_close(function(single).double(), function(q), atol=1e-5, rtol=1e-4)


def test_a_full_posture_leaves_the_rest_at_home(body):
    q = in_front()[:3]
    full = body.full_posture(q)
    columns = [body.robot.joint_index(name) for name in body.joints]
    assert torch.equal(full[:, columns], q)
    others = [i for i in range(body.robot.n) if i not in columns]
    assert torch.equal(full[:, others], body.home[others].expand(3, -1))
    assert torch.equal(body.full_posture(body.felt_home), body.home)


@pytest.mark.parametrize("q", [[0.0] * 4, [0.0] * 25, torch.zeros(5, dtype=torch.bool), [math.nan] * 5, "left", None])
def test_bad_postures_are_refused(body, q):
    for function in (body.hand_image, body.hand_image_jacobian, body.visible, body.hand_in_skin):
        with pytest.raises(InvalidPosture):
            function(q)


# Sight ----------------------------------------------------------------------------------------------------------------


def turned_round(body, **changes):
    """The infant with an eye in the back of its head."""
    turn = torch.from_numpy(transforms.transform(transforms.rpy_matrix((0.0, math.pi, 0.0)), (0.0, 0.0, 0.0)))
    model = dataclasses.replace(body.camera.screen, **changes)
    camera = dataclasses.replace(body.camera, link_T_camera=body.camera.link_T_camera @ turn, model=model)
    return dataclasses.replace(body, camera=camera)


def test_a_hand_behind_the_camera_plane_has_no_image(body):
    behind = turned_round(body)
    q = in_front()[:4]
    with pytest.raises(NotVisible, match=r"behind the camera plane in 4 of 4 postures.*on_invisible='nan'"):
        behind.hand_image(q)
    with pytest.raises(NotVisible):
        behind.hand_image_jacobian(q)
    assert behind.hand_image(q, on_invisible="nan").isnan().all()
    assert not behind.visible(q).any()
    with pytest.raises(InvalidConfig, match="on_invisible='zero': give one of 'raise', 'nan'"):
        body.hand_image(q, on_invisible="zero")


@pytest.mark.parametrize(("around", "near", "half_angle"), [(False, 0.05, 1.05), (True, 1e-3, 1.55), (False, 0.1, 0.5)])
def test_the_hand_is_seen_in_the_cone_and_not_through_the_head(body, around, near, half_angle):
    body = turned_round(body) if around else body
    model = dataclasses.replace(body.camera.screen, near=near, half_angle=half_angle)
    body = dataclasses.replace(body, camera=dataclasses.replace(body.camera, model=model))
    q = body.felt_robot.sample(3000, seed=3)
    x, y, z = body.hand_in_camera(q).T
    in_cone = (z >= near) & (torch.atan2(torch.hypot(x, y), z) <= half_angle)
    # A head that is one sphere: how deep the line of sight goes, by looking at many points of it.
    eye = torch.from_numpy(body.skin.link_positions[body.skin.eye])
    sight = eye + torch.linspace(0, 1, 501, dtype=torch.float64)[:, None] * (body.hand_in_skin(q) - eye)[:, None]
    (head,) = body.skin.surface
    centre, radius = torch.from_numpy(head.link_T_shape[:3, 3].copy()), head.size[0]
    deepest = (radius - (sight - centre).norm(dim=-1)).amax(1)
    clear = ((deepest - 1e-5).abs() > 1e-4) | (deepest.abs() < 1e-12)
    expected = in_cone & (deepest < 1e-5)
    assert torch.equal(body.visible(q)[clear], expected[clear])
    assert clear.sum() > 2000
    if around:
        assert (in_cone & (deepest > 1e-3)).sum() > 100
    else:
        assert expected.any()


def test_no_touch_is_seen_and_the_hand_at_home_is(body):
    assert bool(body.visible(body.felt_home))
    assert not body.visible(body.touch_postures(range(body.skin.count))).any()
    assert body.visible(body.touch_postures(range(body.skin.count), distance=0.03)).all()


# Touch ----------------------------------------------------------------------------------------------------------------


def least_displaced(body, q):
    """How far a posture is from the Karush-Kuhn-Tucker condition of least displacement from home [rad]."""
    _, jacobian = body.hand_in_front_and_jacobian(q)
    lower, upper, worst = body.felt_robot.lower, body.felt_robot.upper, 0.0
    for posture, J in zip(q, jacobian, strict=True):
        low, high = posture < lower + 1e-12, posture > upper - 1e-12
        free = ~(low | high)
        away = posture - body.felt_home
        force = torch.linalg.lstsq(J[:, free].T, away[free], driver="gelsd").solution
        rest = away - J.T @ force
        # Free joints: in the row space of J. Held ones: the limit pushes them inward.
        worst = max([worst, *rest[free].abs().tolist(), *(-rest[low]).tolist(), *rest[high].tolist()])
    return worst


@pytest.mark.parametrize("distance", [0.0, 0.03])
def test_every_taxel_is_reached_with_the_least_displacement(body, distance):
    taxels = np.arange(body.skin.count)
    q = body.touch_postures(taxels, distance=distance)
    assert q.shape == (441, 5)
    assert (q >= body.felt_robot.lower).all()
    assert (q <= body.felt_robot.upper).all()
    target = body.skin.positions + body.hand.radius * body.skin.normals
    forward = body.skin.root_T_link[:3, :3] @ torch.from_numpy(body.skin.forward)
    target = target + distance * forward
    assert float((body.hand_position(q) - target).norm(dim=1).max()) < 1e-9
    assert least_displaced(body, q) < 1e-6
    if distance == 0.0:
        touched = body.skin.touched(body.hand_in_skin(q).numpy(), body.hand.radius)
        np.testing.assert_array_equal(touched, taxels)


def test_limits_that_hold_a_joint_back_are_kept(body, tmp_path):
    # A narrow elbow: home is at its upper limit, which the least displacement would pass.
    robot = body.robot
    free = body.touch_postures(range(0, 441, 20))
    elbow = body.joints.index("left_elbow")
    assert (free[:, elbow] > body.felt_home[elbow]).any()
    text = URDF.read_text()
    joint = text.index('<joint name="left_elbow"')
    old = text[text.index("<limit", joint) : text.index("/>", text.index("<limit", joint))]
    new = f'<limit lower="0" upper="{float(body.felt_home[elbow])}" effort="1" velocity="1"'
    urdf = tmp_path / "narrow.urdf"
    urdf.write_text(text[:joint] + text[joint:].replace(old, new, 1))
    narrow = bk.load_embodiment(write(tmp_path, (str(URDF), str(urdf))))
    assert narrow.robot.n == robot.n
    q, reached = narrow.reach(narrow.touch_centres(list(range(0, 441, 20))))
    held = reached & (q[:, elbow] > narrow.felt_robot.upper[elbow] - 1e-12)
    assert (q <= narrow.felt_robot.upper).all()
    assert held.sum() >= 2
    assert least_displaced(narrow, q[reached]) < 1e-6


def test_taxels_out_of_reach_are_named(body):
    with pytest.raises(
        Unreachable, match=r"1\.0 m in front of taxels \[0, 440\] \(2 of 2\) within the joint limits"
    ) as caught:
        body.touch_postures([0, 440], distance=1.0)
    assert caught.value.taxels == (0, 440)


@pytest.mark.parametrize(
    ("taxels", "error"),
    [
        ([441], UnknownName),
        ([0, -1], UnknownName),
        ([0.5], InvalidConfig),
        (["nose"], InvalidConfig),
        ([[0]], InvalidConfig),
    ],
)
def test_bad_taxels_are_refused(body, taxels, error):
    with pytest.raises(error):
        body.touch_postures(taxels)


def test_taxels_may_be_none_one_or_a_tensor(body):
    assert body.touch_postures(np.array([], dtype=int)).shape == (0, 5)
    one = body.touch_postures([17])
    assert torch.equal(body.touch_postures(torch.tensor([17])), one)
    assert torch.equal(body.touch_postures(np.int64(17)), one)


def test_felt_postures_are_checked_against_the_limits(body):
    assert torch.equal(body.check_felt(body.felt_home), body.felt_home)
    with pytest.raises(InvalidPosture, match="joint 'left_elbow' is beyond its limits"):
        body.check_felt([1.0, 0.2, 0.5, -0.1, 0.0])
    # Each end of each joint, to a nanoradian.
    for bound, out in ((body.felt_robot.lower, -1.0), (body.felt_robot.upper, 1.0)):
        for index, joint in enumerate(body.joints):
            q = body.felt_home.clone()
            q[index] = bound[index] + 0.9e-9 * out
            body.check_felt(q)
            q[index] = bound[index] + 2e-9 * out
            with pytest.raises(InvalidPosture, match=f"joint '{joint}' is beyond its limits"):
                body.check_felt(q)


# The file -------------------------------------------------------------------------------------------------------------


def test_the_same_file_gives_the_same_body_by_any_backend(body, tmp_path):
    again = bk.load_embodiment(str(write(tmp_path)), backend="pytorch_kinematics")
    assert again.kinematics.name == "pytorch_kinematics"
    torch.testing.assert_close(again.hand_image(in_front()), body.hand_image(in_front()), atol=1e-12, rtol=1e-12)
    assert again.joints == body.joints
    # Where the file lies, what it is called and who computes is not what a body is.
    assert bk.load_embodiment("infant").sha256 == body.sha256 == again.sha256
    assert bk.load_embodiment(write(tmp_path)) == body != again
    for old, new in (
        ("radius = 0.02", "radius = 0.03"),
        ("left_elbow = 1.67", "left_elbow = 1.66"),
        ("0.04  ", "0.05  "),
    ):
        assert bk.load_embodiment(write(tmp_path, (old, new))) != body


BAD_FILES = {
    "unknown joint": (
        [('"left_wrist"]', '"left_writs"]')],
        UnknownName,
        "no joint 'left_writs'; did you mean 'left_wrist'",
    ),
    "joint twice": (
        [('"left_wrist"]', '"left_elbow"]')],
        InvalidConfig,
        "joints: 'left_elbow' stands twice; name each once",
    ),
    "no joints": (
        [("joints = [", "joints = [] # [")],
        InvalidConfig,
        r"joints=\[\]: give a list of joint names",
    ),
    "unknown home joint": ([("left_wrist = 0", "left_wirst = 0")], UnknownName, "no joint 'left_wirst'"),
    "home beyond limits": (
        [("left_elbow = 1.67", "left_elbow = 9")],
        InvalidConfig,
        "home: joint 'left_elbow' is at 9, beyond its limits 0 to",
    ),
    "home is text": (
        [("left_elbow = 1.67", 'left_elbow = "up"')],
        InvalidConfig,
        "home: left_elbow='up': give a number",
    ),
    "home is NaN": (
        [("left_elbow = 1.67", "left_elbow = nan")],
        InvalidConfig,
        "home: left_elbow=nan: give a number",
    ),
    "unknown hand link": ([('link = "left_hand"', 'link = "left_hnad"')], UnknownName, "did you mean 'left_hand'"),
    "unknown camera link": ([('link = "right_eye"', 'link = "rigth_eye"')], UnknownName, "did you mean 'right_eye'"),
    "unknown skin link": ([('link = "head"', 'link = "heda"')], UnknownName, "no link 'heda'; did you mean 'head'"),
    "unknown landmark": (
        [('reference = "right_eye"', 'reference = "ear"')],
        UnknownName,
        "'reference' .*'ear'.*left_eye",
    ),
    "landmark off the skin": (
        [("nose = [10, 10]", "nose = [21, 10]")],
        InvalidConfig,
        r"\[skin.landmarks\]: nose row=21: give a whole number of at least 0 and at most 20",
    ),
    "landmark of one number": (
        [("nose = [10, 10]", "nose = [10]")],
        InvalidConfig,
        r"nose=\[10\]: give \[row, column\] within 21 x 21",
    ),
    "missing field": (
        [("distance = 0.04", "")],
        InvalidConfig,
        r"\[camera\]: field 'distance' is missing",
    ),
    "missing table": ([("[hand]", "[hnad]")], InvalidConfig, "field 'hand' is missing"),
    "unknown field": ([("near = ", "naer = 1.0\nnear = ")], InvalidConfig, "no field .* 'naer'; did you mean 'near'"),
    "unknown table": ([("[hand]", "[tail]\nx = 1\n[hand]")], InvalidConfig, "no field .* 'tail'; .*valid: .*hand"),
    "negative radius": (
        [("radius = 0.02", "radius = -0.02")],
        InvalidConfig,
        r"\[hand\]: radius=-0.02: give a number of at least 0",
    ),
    "radius is true": ([("radius = 0.02", "radius = true")], InvalidConfig, "radius=True: give a number"),
    "half angle": (
        [("half_angle_degrees = 60.0", "half_angle_degrees = 90.0")],
        InvalidConfig,
        "half_angle_degrees=90.0: give a number above 0 and below 90",
    ),
    "axes not orthogonal": (
        [("right = [0.0, -1.0, 0.0]", "right = [1.0, -1.0, 0.0]")],
        InvalidConfig,
        "must be orthogonal",
    ),
    "axis zero": (
        [("right = [0.0, -1.0, 0.0]", "right = [0.0, 0.0, 0.0]")],
        InvalidConfig,
        "must be orthogonal and not zero",
    ),
    "no rows": (
        [("shape = [21, 21]", "shape = [0, 21]")],
        InvalidConfig,
        "shape rows=0: give a whole number of at least 1",
    ),
    "size is text": (
        [("size = [0.06, 0.06]", 'size = "big"')],
        InvalidConfig,
        "size='big': give 2 numbers",
    ),
    "size negative": (
        [("size = [0.06, 0.06]", "size = [-0.06, 0.06]")],
        InvalidConfig,
        r"size\[0\]=-0.06: give a number above 0",
    ),
    "rows without end": (
        [("shape = [21, 21]", f"shape = [{10**30}, 21]")],
        InvalidConfig,
        "rows=1000000000000000000000000000000: give a whole number of at least 1 and at most 1000000",
    ),
    "taxels without end": ([("shape = [21, 21]", "shape = [10000, 10000]")], InvalidConfig, "at most 1000000 taxels"),
    "axis too long": (
        [("right = [0.0, -1.0, 0.0]     # direction", "right = [0.0, 1e308, 1e308]  # direction")],
        InvalidConfig,
        "'right' is too long for a float64; give unit vectors",
    ),
    "size beyond the face": ([("size = [0.06, 0.06]", "size = [0.6, 0.6]")], InvalidConfig, "make 'size' smaller"),
    "malformed": ([("[hand]", "[hand")], InvalidConfig, "is no valid TOML"),
    "no such robot": ([(str(URDF), "nowhere.urdf")], InvalidURDF, "cannot read .*nowhere.urdf"),
}


@pytest.mark.parametrize("bad", BAD_FILES)
def test_a_bad_file_names_the_field_and_what_is_valid(tmp_path, bad):
    changes, error, message = BAD_FILES[bad]
    with pytest.raises(error, match=message):
        bk.load_embodiment(write(tmp_path, *changes))


@pytest.mark.usefixtures("unchecked")
def test_what_is_neither_name_nor_path_is_refused():
    for odd in (3, None, ["infant"]):
        with pytest.raises(InvalidConfig, match=f"by its name or from a path, not from {type(odd).__name__}"):
            bk.load_embodiment(odd)


def test_an_unknown_embodiment_lists_the_known(tmp_path):
    with pytest.raises(UnknownName, match=r"no embodiment 'infnat'; did you mean 'infant'\? valid: .*infant"):
        bk.load_embodiment("infnat")
    with pytest.raises(InvalidConfig, match="cannot read embodiment"):
        bk.load_embodiment(tmp_path / "missing.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InvalidConfig, match="no valid TOML"):
        bk.load_embodiment(tmp_path / "binary.toml")
