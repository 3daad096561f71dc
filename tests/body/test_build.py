"""Bodies put together in code: as from a file, read back equal, with any eye, with a skin or without."""

import dataclasses
import functools
import inspect
import math
import pickle
import sys
import tomllib

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from robots import ARM, TRICKY, central

import bodyimage_kin as bk
from bodyimage_kin.errors import FoldedLens, InvalidConfig, ManyMistakes, NoSkin, UnknownName
from bodyimage_kin.robot.transforms import rpy_matrix, transform

ASIDE = transform(rpy_matrix((math.pi, 0.1, -0.2)), (0.25, 0.05, 1.2))
"""From above, looking down: a camera that stands in the world."""
PINHOLE = bk.Pinhole(615.0, 620.0, 322.5, 238.0, distortion=(-0.28, 0.09, 1.1e-3, -0.6e-3, -0.013), size=(640, 480))
MODELS = {
    "screen": bk.VirtualScreen(0.04, half_angle=1.0),
    "pinhole": PINHOLE,
    "pinhole of no size": bk.Pinhole(1e3, 1e3, 0.1, -3.3, near=0.1),
    "stereo": bk.Stereo(
        PINHOLE, dataclasses.replace(PINHOLE, fx=600.0), transform(rpy_matrix((0.0, 0.1, 0.0)), (0.06, 0.0, 0.0))
    ),
    "tracker": bk.Tracker(),
}


@functools.cache
def infant():
    return bk.load_embodiment("infant")


@functools.cache
def arm():
    return bk.Robot.from_urdf(ARM)


def planar(model=PINHOLE, **changes):
    """Two links in the plane, seen from above."""
    parts = {
        "joints": ["shoulder", "elbow"],
        "hand": bk.Hand("hand", offset=(0.05, 0.0, 0.01)),
        "camera": bk.Camera("base", ASIDE, model),
        "home": {"elbow": 0.5},
    }
    return bk.Embodiment.build(arm(), **parts | changes)


def unchecked(**changes):
    """As :func:`planar`, past the type checker of these tests: what users meet."""
    build = inspect.unwrap(bk.Embodiment.build.__func__)
    parts = {"joints": ["shoulder"], "hand": bk.Hand("hand"), "camera": bk.Camera("base", ASIDE, PINHOLE)}
    return build(bk.Embodiment, arm(), **parts | changes)


def rebuilt(body, **changes):
    """A body built again in code, from its parts."""
    parts = {name: getattr(body, name) for name in ("joints", "hand", "camera", "skin", "home", "name")}
    return bk.Embodiment.build(body.robot, **parts | changes)


# The same in code and in a file ---------------------------------------------------------------------------------------


def test_the_infant_built_in_code_is_the_one_of_its_file():
    body = infant()
    built = rebuilt(body, home=body.robot.named(body.home))
    assert built == body
    assert (built.sha256, hash(built)) == (body.sha256, hash(body))
    q = body.felt_robot.sample(200, seed=1)
    assert torch.equal(
        built.hand_image(q, on_invisible="nan").nan_to_num(9), body.hand_image(q, on_invisible="nan").nan_to_num(9)
    )
    assert torch.equal(built.visible(q), body.visible(q))
    assert torch.equal(built.touch_postures([0, 220]), body.touch_postures([0, 220]))


@pytest.mark.parametrize("name", MODELS)
def test_what_is_written_is_read_back_equal(tmp_path, name):
    body = planar(MODELS[name], name="two links")
    again = bk.load_embodiment(body.save(tmp_path / "mine.toml"))
    assert again == body
    assert again.sha256 == body.sha256
    assert again.to_toml("mine.urdf") == body.to_toml("mine.urdf")
    q = body.felt_robot.sample(20)
    assert torch.equal(
        again.hand_image(q, on_invisible="nan").nan_to_num(9), body.hand_image(q, on_invisible="nan").nan_to_num(9)
    )
    # A robot of no file is written beside it, byte by byte.
    assert (tmp_path / "mine.urdf").read_text() == ARM
    assert again.robot == body.robot


def test_a_body_with_skin_is_read_back_equal_and_finds_its_robot(tmp_path):
    for body in (infant(), rebuilt(infant(), skin=dataclasses.replace(infant().skin, eye=None, reference=7))):
        again = bk.load_embodiment(body.save(tmp_path / "again.toml"))
        assert again == body
        assert torch.equal(again.skin.positions, body.skin.positions)
        assert (again.skin.landmarks, again.skin.eye) == (body.skin.landmarks, body.skin.eye)
        assert not (tmp_path / "again.urdf").exists()
        assert again.robot.file.samefile(body.robot.file)
    text = infant().to_toml()
    assert tomllib.loads(text)["camera"]["model"] == "virtual_screen"


def test_a_robot_whose_file_has_changed_is_written_anew(tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_text(ARM)
    robot = bk.Robot.from_urdf(file)
    body = rebuilt(planar(), name="arm")
    body = bk.Embodiment.build(robot, joints=body.joints, hand=body.hand, camera=body.camera, home=body.home)
    (tmp_path / "sub").mkdir()
    assert 'urdf = "arm.urdf"' in body.save(tmp_path / "one.toml").read_text()
    assert f'urdf = "{file.as_posix()}"' in body.save(tmp_path / "sub" / "two.toml").read_text()
    file.write_text(ARM.replace("0.3 0 0", "0.4 0 0"))
    assert bk.load_embodiment(body.save(tmp_path / "three.toml")) == body
    with pytest.raises(InvalidConfig, match=r"let it end in \.toml"):
        body.save(tmp_path / "four.json")


@given(name=st.text(min_size=1), numbers=st.lists(st.floats(-1e300, 1e300), min_size=3, max_size=3))
def test_any_name_and_number_survives_a_file_to_the_bit(name, numbers):
    body = planar(name=name, hand=bk.Hand("hand", numbers, radius=abs(numbers[0])))
    told = tomllib.loads(body.to_toml())
    assert told["name"] == name
    assert told["hand"] == {"link": "hand", "offset": numbers, "radius": abs(numbers[0])}


OWN = """
from dataclasses import dataclass
import torch

@dataclass(frozen=True)
class Orthographic:
    scale: float
    names: tuple = ("x", "y")
    m = 2
    unit = "mm"

    def project(self, points):
        return self.scale * points[..., :2]

    def derivative(self, points):
        return self.scale * torch.eye(3, dtype=points.dtype)[:2].expand(*points.shape[:-1], 2, 3)

    def visible(self, points):
        return points[..., 2] > 0

class Nothing:
    def __init__(self):
        raise SystemExit("built without being looked at")
"""


def test_a_model_of_ones_own_is_named_in_the_file_and_looked_at_before_it_is_built(tmp_path, monkeypatch):
    (tmp_path / "my_camera.py").write_text(OWN)
    file = planar(MODELS["tracker"]).save(tmp_path / "mine.toml")
    text = file.read_text()
    monkeypatch.setattr(sys, "path", sys.path.copy())
    file.write_text(text.replace('"tracker"', '"my_camera:Orthographic"\nscale = 1000.0\nnames = ["x", "y"]'))
    with pytest.raises(InvalidConfig, match=r"camera model.names=\['x', 'y'\]: give a tuple of 2 names"):
        bk.load_embodiment(file)
    file.write_text(text.replace('"tracker"', '"my_camera:Orthographic"\nscale = 1000.0'))
    body = bk.load_embodiment(file)
    assert (body.m, body.camera.model.unit, body.camera.model.scale) == (2, "mm", 1000.0)
    assert bk.load_embodiment(file).sha256 == body.sha256 == pickle.loads(pickle.dumps(body)).sha256
    file.write_text(text.replace('"tracker"', '"my_camera:Orthographic"\nscale = 999.0'))
    assert bk.load_embodiment(file) != body
    for model, message in {
        "my_camera:Nothing": "has no method project",
        "my_camera:Missing": "has no 'Missing'",
        "no_such_module:Camera": "put no_such_module.py into",
        "pinhloe": "no camera model 'pinhloe'; did you mean 'pinhole'",
        'my_camera:Orthographic"\nfocal = "3': "is not built of focal: ",
    }.items():
        file.write_text(text.replace('"tracker"', f'"{model}"'))
        with pytest.raises(InvalidConfig, match=message):
            bk.load_embodiment(file)


def test_what_no_file_can_hold_is_said_and_still_has_a_hash():
    class Closure:
        m, unit, names = 3, "m", ("x", "y", "z")

        def __init__(self, wrapped):
            self.project, self.derivative, self.visible = wrapped.project, wrapped.derivative, wrapped.visible

    body = planar(Closure(bk.Tracker()))
    assert body == planar(body.camera.model)
    assert len(body.sha256) == 64
    with pytest.raises(
        InvalidConfig, match=r"Closure: project is method, which no file can hold; let .* be a dataclass"
    ):
        body.to_toml()


@pytest.mark.parametrize("backend", ["numba", "torch", "pinocchio", "mujoco", "pytorch_kinematics"])
def test_a_pickled_body_is_equal_and_works(backend):
    body = rebuilt(infant(), backend=backend)
    q = body.touch_postures([3, 4])
    image = body.hand_image(q)
    again = pickle.loads(pickle.dumps(body))
    assert again == body
    assert (again.kinematics.name, hash(again)) == (backend, hash(body))
    assert torch.equal(again.hand_image(q), image)
    assert torch.equal(again.touch_postures([3, 4]), q)


def test_bodies_of_other_parts_are_not_equal():
    body = planar()
    for changes in (
        {"joints": ["elbow", "shoulder"]},
        {"joints": ["elbow"]},
        {"hand": bk.Hand("hand")},
        {"camera": bk.Camera("base", np.eye(4), PINHOLE)},
        {"camera": bk.Camera("base", ASIDE, MODELS["tracker"])},
        {"home": {"elbow": 0.6}},
        {"name": "other"},
    ):
        assert planar(**changes) != body
        assert planar(**changes).sha256 != body.sha256
    assert planar() == body
    assert body != "arm"


def test_a_body_says_what_it_is_in_one_line_and_in_a_table():
    assert repr(infant()) == (
        "Embodiment('infant': feels 5 of 25 joints, hand 'left_hand', "
        "VirtualScreen on 'right_eye', 441 taxels on 'head')"
    )
    assert repr(planar()).endswith("Pinhole on 'base', no skin)")
    page = planar(name="<b>x</b>")._repr_html_()
    assert "&lt;b&gt;x" in page
    assert "<b>x</b>" not in page
    assert "u, v [px]" in page


# Any order, any home --------------------------------------------------------------------------------------------------


def test_joints_stay_in_the_order_given():
    body = infant()
    order = [3, 0, 4, 2, 1]
    names = [body.joints[i] for i in order]
    turned = rebuilt(body, joints=names)
    assert turned.joints == turned.felt_robot.joint_names == tuple(names)
    q = body.touch_postures([0, 220, 440], distance=0.03)
    torch.testing.assert_close(turned.hand_image(q[:, order]), body.hand_image(q), rtol=1e-13, atol=1e-15)
    torch.testing.assert_close(
        turned.hand_image_jacobian(q[:, order]), body.hand_image_jacobian(q)[..., order], rtol=1e-11, atol=1e-14
    )
    assert torch.equal(turned.full_posture(q[:, order]), body.full_posture(q))
    torch.testing.assert_close(turned.touch_postures([0, 220, 440], distance=0.03), q[:, order], rtol=0, atol=1e-7)
    assert torch.equal(turned.felt_home, body.felt_home[order])
    with pytest.raises(bk.errors.InvalidPosture, match="joint 'left_elbow' is beyond its limits"):
        turned.check_felt([-0.1, 1.0, 0.0, 0.2, 0.5])


@pytest.mark.parametrize("dynamics", [False, True])
def test_recordings_are_in_that_order_too(dynamics):
    body = infant()
    turned = rebuilt(body, joints=body.joints[::-1])
    circle = bk.motions.Circle(turns=0.03, rest_spread=0.0)
    found = bk.simulate(turned, circle, seed=3, dynamics=dynamics)
    expected = bk.simulate(body, circle, seed=3, dynamics=dynamics)
    assert found.joint.values.tolist() == list(body.joints[::-1])
    np.testing.assert_allclose(found.q.values[..., ::-1], expected.q.values, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.true_hand_image, expected.true_hand_image, rtol=0, atol=1e-7)


def test_what_home_does_not_name_is_at_zero_or_at_the_limit_next_to_it():
    robot = bk.Robot.from_urdf(TRICKY)
    camera = bk.Camera("world", np.eye(4), bk.Tracker())
    body = bk.Embodiment.build(robot, joints=["base", "zulu"], hand=bk.Hand("tip"), camera=camera)
    assert robot.named(body.home) == {"zulu": 0.0, "slide": 0.0, "base": 0.0, "alpha": 0.25}
    posture = [0.1, 0.2, 0.3, 0.5]
    same = bk.Embodiment.build(robot, joints=["base", "zulu"], hand=bk.Hand("tip"), camera=camera, home=posture)
    assert same.home.tolist() == posture
    assert same == bk.Embodiment.build(
        robot, joints=["base", "zulu"], hand=bk.Hand("tip"), camera=camera, home=robot.named(posture)
    )
    # Followers of a felt joint move with it, by any order of the felt ones.
    q = body.felt_robot.sample(5)
    jacobian = body.hand_image_jacobian(q)
    for one, expected in zip(q, jacobian, strict=True):
        torch.testing.assert_close(central(body.hand_image, one), expected, rtol=1e-6, atol=1e-9)


# Eyes anywhere --------------------------------------------------------------------------------------------------------


def test_an_eye_that_stands_in_the_world_and_one_in_the_hand():
    # By hand: the planar arm stretched along x, a camera 1 m above the table that looks straight down.
    down = transform(np.diag([1.0, -1.0, -1.0]), (0.3, 0.0, 1.0))
    camera = bk.Pinhole(500.0, 500.0, 320.0, 240.0, size=(640, 480))
    body = planar(hand=bk.Hand("hand"), camera=bk.Camera("base", down, camera))
    # The hand is 0.5 m out: 0.2 m to the right of the axis.
    torch.testing.assert_close(body.hand_image([0.0, 0.0]), torch.tensor([420.0, 240.0]).double())
    # Turning the shoulder by d moves it by 0.5 d along y, which is up in the image; the elbow by 0.2 d.
    torch.testing.assert_close(
        body.hand_image_jacobian([0.0, 0.0]), torch.tensor([[0.0, 0.0], [-250.0, -100.0]]).double(), rtol=0, atol=1e-12
    )
    assert bool(body.visible([0.0, 0.0]))
    # The same eye in the hand looks at a mark on the table: what moved left now moves right.
    mark = planar(hand=bk.Hand("base", offset=(0.5, 0.0, 0.0)), camera=bk.Camera("hand", down, camera))
    assert mark.felt_robot.joint_names == ("shoulder", "elbow")
    found = mark.hand_image_jacobian([0.0, 0.0])
    torch.testing.assert_close(found, central(mark.hand_image, torch.zeros(2).double()), rtol=1e-7, atol=1e-6)
    assert float(found[1, 0]) > 100.0


# What is wrong --------------------------------------------------------------------------------------------------------


def test_everything_wrong_is_told_at_once():
    with pytest.raises(ManyMistakes) as caught:
        planar(
            joints=["shoulder", "elbwo", "wrist", "shoulder"],
            hand=bk.Hand("hnad"),
            camera=bk.Camera("baes", ASIDE, PINHOLE),
            home={"elbow": 9.0, "knee": 0.0, "shoulder": math.nan},
        )
    said = [str(mistake) for mistake in caught.value.mistakes]
    assert len(said) == 8
    for part in (
        "no joint 'elbwo'; did you mean 'elbow'? valid: shoulder, elbow",
        "joints: 'wrist' is fixed and cannot be felt",
        "joints: 'shoulder' stands twice",
        "no link 'hnad'; did you mean 'hand'",
        "no link 'baes'; did you mean 'base'",
        "home: joint 'elbow' is at 9, beyond its limits -3 to 3",
        "no joint 'knee'; valid: shoulder, elbow",
        "home: shoulder=nan: give a number",
    ):
        assert any(line.startswith(part) for line in said), part
    assert str(caught.value).startswith("embodiment 'arm': 8 mistakes:\n  ")
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"hand": "hand"}, InvalidConfig, "hand is str; give a bk.Hand"),
        ({"camera": PINHOLE}, InvalidConfig, "camera is Pinhole; give a bk.Camera"),
        ({"joints": []}, InvalidConfig, r"joints=\[\]: give a list of names of joints"),
        ({"joints": "shoulder"}, InvalidConfig, "joints='shoulder': give a list of names of joints"),
        ({"home": [0.0]}, bk.errors.InvalidPosture, r"base posture has shape \(1,\)"),
        ({"name": ""}, InvalidConfig, "name='': give a text that is not empty"),
        ({"joints": ["wrist"]}, InvalidConfig, "'wrist' is fixed"),
        ({"backend": "numbaa"}, UnknownName, "no backend 'numbaa'; did you mean 'numba'"),
    ],
)
def test_one_mistake_is_told_as_what_it_is(changes, error, message):
    with pytest.raises(error, match=message):
        unchecked(**changes)


def test_a_follower_is_not_felt():
    robot = bk.Robot.from_urdf(TRICKY)
    with pytest.raises(InvalidConfig, match="joints: 'end' follows 'base' and is moved by it; name that one"):
        bk.Embodiment.build(robot, joints=["end"], hand=bk.Hand("tip"), camera=bk.Camera("world", ASIDE, bk.Tracker()))


@pytest.mark.parametrize(
    ("offset", "radius", "message"),
    [
        ((0.0, 0.0), 0.0, r"hand offset has shape \(2,\); give \(3,\)"),
        ((0.0, 0.0, math.inf), 0.0, "hand offset z=inf: give a number"),
        ("tip", 0.0, "hand offset"),
        ((0.0, 0.0, 0.0), -0.1, "hand radius=-0.1: give a number of at least 0"),
    ],
)
def test_bad_hands_are_refused(offset, radius, message):
    with pytest.raises(InvalidConfig, match=message):
        bk.Hand("hand", offset, radius)


FILE = """
name = "arm"
urdf = "arm.urdf"
joints = ["shoulder", "elbow"]
[hand]
link = "hand"
[camera]
link = "base"
model = "pinhole"
fx = 600
fy = 600
cx = 320
cy = 240
position = [0.3, 0, 1]
forward = [0, 0, -1]
right = [1, 0, 0]
"""


def in_file(tmp_path, *changes):
    text = FILE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "arm.urdf").write_text(ARM)
    (tmp_path / "arm.toml").write_text(text)
    return tmp_path / "arm.toml"


def test_whole_numbers_are_numbers_and_all_but_hand_camera_and_joints_may_be_left_out(tmp_path):
    body = bk.load_embodiment(in_file(tmp_path))
    down = transform(np.diag([1.0, -1.0, -1.0]), (0.3, 0.0, 1.0))
    assert body == bk.Embodiment.build(
        arm(),
        joints=["shoulder", "elbow"],
        hand=bk.Hand("hand"),
        camera=bk.Camera("base", down, bk.Pinhole(600.0, 600.0, 320.0, 240.0)),
    )
    assert body.skin is None


def test_all_mistakes_of_a_file_are_told_at_once(tmp_path):
    bad = in_file(
        tmp_path,
        ('joints = ["shoulder", "elbow"]', 'joints = ["shoulder", "elbwo"]\nspeed = 3'),
        ('link = "hand"', 'link = "hnad"\nradius = -1\nsize = 2'),
        ('link = "base"', 'link = "base"\nnaer = 0.1'),
        ("fx = 600\n", ""),
        ("fy = 600", "fy = -600"),
        ("cx = 320", 'cx = "middle"'),
        ("right = [1, 0, 0]", "right = [1, 0, 1]\nsize = [640.5, 480]\n[home]\nelbow = 9"),
    )
    with pytest.raises(ManyMistakes) as caught:
        bk.load_embodiment(bad)
    said = [str(mistake) for mistake in caught.value.mistakes]
    for part in (
        "no field in arm.toml 'speed'; valid: camera, hand, home, joints, mesh_folder, name, skin, urdf",
        "arm.toml [hand]: radius=-1: give a number of at least 0",
        "no field in arm.toml [hand] 'size'; valid: link, offset, radius",
        "arm.toml [camera]: field 'fx' is missing; give a number",
        "arm.toml [camera]: fy=-600: give a number above 0",
        "arm.toml [camera]: cx='middle': give a number",
        "arm.toml [camera]: size[0]=640.5: give a whole number of at least 1",
        "arm.toml [camera]: 'forward' and 'right' must be orthogonal",
        "no field in arm.toml [camera] 'naer'; did you mean 'near'?",
        "no joint 'elbwo'; did you mean 'elbow'",
        "no link 'hnad'; did you mean 'hand'",
        "arm.toml home: joint 'elbow' is at 9, beyond its limits -3 to 3",
    ):
        assert any(line.startswith(part) for line in said), (part, said)
    assert len(said) == 12


CAMERA_FILES = {
    "no pose": (
        [("forward = [0, 0, -1]\nright = [1, 0, 0]", "")],
        "give 'link_T_camera', four rows of four numbers, or",
    ),
    "two poses": (
        [("right =", "link_T_camera = [[1]]\nright =")],
        "give 'link_T_camera' or position, forward, right, not both",
    ),
    "folds": (
        [("cx = 320", "distortion = [-0.9, 0, 0, 0]\nsize = [640, 480]\ncx = 320")],
        r"\[camera\]: distortion .*folds",
    ),
    "no model": (
        [('model = "pinhole"\n', "")],
        "field 'model' is missing; give one of 'virtual_screen', 'pinhole', 'stereo'",
    ),
    "stereo of one": ([('"pinhole"', '"stereo"')], r"\[camera\]: field 'left' is missing; give a table \[left\]"),
    "camera is a number": (
        [('name = "arm"', 'camera = 3\nname = "arm"'), (FILE[FILE.index("[camera]") :], "")],
        "camera=3: give a table",
    ),
    "deep": ([('"pinhole"', "[" * 3000 + "]" * 3000)], "no valid TOML"),
}


@pytest.mark.parametrize("bad", CAMERA_FILES)
def test_bad_cameras_of_a_file_are_told_with_their_place(tmp_path, bad):
    changes, message = CAMERA_FILES[bad]
    with pytest.raises(InvalidConfig, match=message) as caught:
        bk.load_embodiment(in_file(tmp_path, *changes))
    if bad == "folds":
        assert isinstance(caught.value, FoldedLens)


# Without a skin -------------------------------------------------------------------------------------------------------


def test_without_a_skin_all_works_that_needs_none_and_the_rest_says_so():
    body = planar()
    q = body.felt_robot.sample(50)
    assert torch.equal(body.visible(q), PINHOLE.visible(body.hand_in_camera(q)))
    assert 0 < int(body.visible(q).sum()) < 50
    assert body.hand_image_jacobian(q).shape == (50, 2, 2)
    for needs_one in (
        body.require_skin,
        lambda: body.hand_in_skin(q),
        lambda: body.touch_postures([0]),
        lambda: body.touch_centres([0]),
    ):
        with pytest.raises(NoSkin, match="embodiment 'arm' has no skin") as caught:
            needs_one()
        assert caught.value.embodiment == "arm"
        assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_a_circle_stands_in_front_of_the_skin_or_of_the_camera():
    body = infant()
    frame = body.circle_frame(0.03)
    assert body.front_link == "head"
    np.testing.assert_array_equal(frame.origin, body.touch_centres([220], 0.03)[0])
    for found, expected in zip(frame[1:], (body.skin.right, body.skin.down, body.skin.forward), strict=True):
        np.testing.assert_array_equal(found, expected)
    bare = rebuilt(body, skin=None)
    frame = bare.circle_frame(0.1)
    assert bare.front_link == "right_eye"
    q, reached = bare.reach(
        torch.from_numpy(frame.origin[None] + 0.02 * np.stack([frame.right, frame.down, -frame.right]))
    )
    assert bool(reached.all())
    point = bare.hand_in_camera(q)
    expected = torch.tensor([[0.02, 0.0, 0.1], [0.0, 0.02, 0.1], [-0.02, 0.0, 0.1]], dtype=torch.float64)
    torch.testing.assert_close(point, expected, rtol=0, atol=1e-9)
    position, jacobian = bare.hand_in_front_and_jacobian(q)
    for one, moved in zip(q, jacobian, strict=True):
        torch.testing.assert_close(
            central(lambda x: bare.hand_in_front_and_jacobian(x)[0], one), moved, rtol=1e-7, atol=1e-9
        )
    assert position.shape == (3, 3)
    with pytest.raises(
        InvalidConfig, match=r"'infant' has no skin.* in front of its camera; distance=0.0: give .* above 0"
    ):
        bare.circle_frame(0.0)
