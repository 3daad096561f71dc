"""Skins in an embodiment's file: read, borne, saved and read back equal."""

import numpy as np
import pytest
import torch
import trimesh

import bodyimage_kin as bk
from bodyimage_kin.body import check_embodiment
from bodyimage_kin.errors import BodyImageKinError
from bodyimage_kin.robot.geometry import Collision, Cylinder

ARM = """
<robot name="r">
  <link name="base"/>
  <link name="head">{head}</link>
  <link name="upper"><inertial><mass value="0.2"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/>
  </inertial></link>
  <link name="lower"><inertial><mass value="0.2"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/>
  </inertial></link>
  <link name="hand"><inertial><mass value="0.1"/><inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/>
  </inertial></link>
  <joint name="neck" type="fixed"><parent link="base"/><child link="head"/><origin xyz="0 0 0.3"/></joint>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0.05 0.12 0.15"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="b" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" effort="1" velocity="1"/></joint>
  <joint name="c" type="revolute"><parent link="lower"/><child link="hand"/><origin xyz="0.15 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2.6" upper="2.6" effort="1" velocity="1"/></joint>
</robot>
"""
MESH = '<visual><geometry><mesh filename="head.stl"/></geometry></visual>'
TOP = """
name = "r"
urdf = "r.urdf"
joints = ["a", "b", "c"]
[home]
b = -0.6
c = -1.2
[hand]
link = "hand"
offset = [0.1, 0.0, 0.0]
radius = 0.01
[camera]
link = "head"
model = "virtual_screen"
distance = 0.04
near = 0.1
forward = [1.0, 0.0, 0.0]
right = [0.0, -1.0, 0.0]
"""
GRID = """
[skin]
link = "head"
shape = [5, 7]
size = [0.04, 0.06]
centre = [0.12, 0.0, 0.0]
forward = [1.0, 0.0, 0.0]
right = [0.0, -1.0, 0.0]
reference = [2, 3]
eye = "nose"
landmarks = { nose = [2, 3], mouth = [4, 3] }
"""
POINTS = """
[skin]
link = "head"
table = "taxels.csv"
reference = "nose"
eye = "nose"
landmarks = { nose = 12, ear = 0 }
"""
ANGLES = np.stack(np.meshgrid(np.linspace(-0.3, 0.3, 5), np.linspace(-0.4, 0.4, 6)), -1).reshape(-1, 2)
PLACES = 0.08 * np.stack(
    [np.cos(ANGLES[:, 0]) * np.cos(ANGLES[:, 1]), np.cos(ANGLES[:, 0]) * np.sin(ANGLES[:, 1]), np.sin(ANGLES[:, 0])], 1
)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "r.urdf").write_text(ARM.format(head=MESH), encoding="utf-8")
    trimesh.creation.icosphere(subdivisions=4, radius=0.08).export(tmp_path / "head.stl")
    np.savetxt(tmp_path / "taxels.csv", PLACES, delimiter=",", header="x,y,z", comments="")
    return tmp_path


def load(folder, skin):
    path = folder / "r.toml"
    path.write_text(TOP + skin, encoding="utf-8")
    return bk.load_embodiment(path)


def test_a_grid_on_a_mesh_is_the_one_of_code_and_is_read_back_equal(folder):
    body = load(folder, GRID)
    np.testing.assert_allclose(np.linalg.norm(body.skin.link_positions, axis=1), 0.08, rtol=3e-3)
    np.testing.assert_allclose(body.skin.positions[17], [0.08, 0.0, 0.3], atol=1e-4)
    skin = bk.Skin.grid(
        body.robot, "head", shape=(5, 7), size=(0.04, 0.06), centre=(0.12, 0, 0), forward=(1, 0, 0), right=(0, -1, 0),
        reference=(2, 3), eye="nose", landmarks={"nose": (2, 3), "mouth": (4, 3)},
    )  # fmt: skip
    parts = {"joints": body.joints, "hand": body.hand, "camera": body.camera, "home": body.home}
    built = bk.Embodiment.build(body.robot, **parts, skin=skin, name="r")
    assert built == body
    assert bk.load_embodiment(built.save(folder / "again.toml")) == body
    # Another head under the same URDF is another body.
    trimesh.creation.icosphere(subdivisions=4, radius=0.07).export(folder / "head.stl")
    assert load(folder, GRID) != body


def test_a_stated_shape_and_a_frame_of_touch_of_ones_own(folder):
    body = load(
        folder,
        GRID
        + "touch_forward = [0.8, 0.0, 0.6]\ntouch_right = [0.0, -1.0, 0.0]\n"
        + '[skin.on]\nkind = "cylinder"\nradius = 0.09\nlength = 0.3\nxyz = [0.005, 0.0, 0.0]\n',
    )
    np.testing.assert_allclose(np.hypot(body.skin.link_positions[:, 0] - 0.005, body.skin.link_positions[:, 1]), 0.09)
    assert body.skin.stated == Collision(Cylinder(0.09, 0.3), xyz=(0.005, 0.0, 0.0))
    frame = body.circle_frame(0.03)
    np.testing.assert_allclose(frame.forward, [0.8, 0.0, 0.6])
    np.testing.assert_allclose(frame.origin, [0.095 + 0.01 + 0.024, 0.0, 0.018])
    assert bk.load_embodiment(body.save(folder / "again.toml")) == body


def test_points_of_a_table_are_those_of_arrays_and_are_read_back_equal(folder):
    body = load(folder, POINTS)
    np.testing.assert_array_equal(body.skin.link_positions, PLACES)
    skin = bk.Skin.points(PLACES, link="head", reference="nose", eye="nose", landmarks={"nose": 12, "ear": 0})
    parts = {"joints": body.joints, "hand": body.hand, "camera": body.camera, "home": body.home}
    built = bk.Embodiment.build(body.robot, **parts, skin=skin, name="r")
    assert built == body
    moved = bk.Embodiment.build(body.robot, **parts, skin=skin.moved(MOVE), name="r")
    assert moved != body
    for one in (built, moved):
        assert bk.load_embodiment(one.save(folder / "again.toml")) == one
    places = "reference = 12\neye = 12\nlandmarks = {nose = 12, ear = 0}\n"
    written = f"[skin]\nlink = 'head'\npositions = {PLACES.tolist()}\n{places}"
    assert load(folder, written) == body


MOVE = np.array([[0.0, -1.0, 0.0, 0.001], [1.0, 0.0, 0.0, 0.002], [0.0, 0.0, 1.0, 0.003], [0.0, 0.0, 0.0, 1.0]])


def test_a_moved_grid_is_another_body_and_is_read_back_equal(folder):
    body = load(folder, GRID)
    parts = {"joints": body.joints, "hand": body.hand, "camera": body.camera, "home": body.home, "name": "r"}
    moved = bk.Embodiment.build(body.robot, **parts, skin=body.skin.moved(MOVE))
    expected = body.skin.link_positions @ MOVE[:3, :3].T + MOVE[:3, 3]
    np.testing.assert_allclose(moved.skin.link_positions, expected, atol=1e-15)
    whole, normals = moved.skin.surface_at(moved.skin.coordinates(np.arange(35)))
    np.testing.assert_allclose(whole, expected, atol=1e-15)
    np.testing.assert_allclose(normals, moved.skin.link_normals, atol=1e-15)
    assert moved != body
    again = bk.load_embodiment(moved.save(folder / "again.toml"))
    assert again == moved
    np.testing.assert_allclose(again.skin.link_positions, expected, atol=1e-15)


@pytest.mark.parametrize("skin", [GRID, POINTS])
def test_motions_touches_and_sight_work_on_any_skin(folder, skin):
    body = load(folder, skin)
    taxels = np.arange(body.skin.count)
    q, reached = body.reach(body.touch_centres(taxels))
    assert reached.all()
    touching = body.skin.touched(body.hand_in_skin(q).numpy(), body.hand.radius)
    np.testing.assert_array_equal(touching, taxels)
    for dynamics in (False, True):
        touch = bk.simulate(body, bk.motions.RandomTouch(duration=40.0, silence=0.0), dynamics=dynamics)
        felt = touch["touched"].values.ravel()
        assert (felt >= 0).mean() > (0.95 if dynamics else 0.999)
        assert len(np.unique(felt[felt >= 0])) > 0.6 * body.skin.count
        # The hand is where its taxel is.
        there = body.hand_in_skin(torch.from_numpy(touch["true_q"].values[0])).numpy()[felt >= 0]
        away = np.linalg.norm(there - body.touch_centres(felt[felt >= 0]).numpy(), axis=1)
        assert away.max() < 0.012
    circle = bk.simulate(body, bk.motions.Circle(radius=0.03), dynamics=False)
    assert np.isfinite(circle["hand_image"].values).all()


@pytest.mark.parametrize(
    ("skin", "match"),
    [
        (POINTS.replace("taxels.csv", "none.csv"), r"table: cannot read '.*none\.csv'"),
        (POINTS + "shape = [5, 6]\n", "'shape' is of a grid, 'table' of points"),
        (POINTS.replace("12", "99"), "landmarks.*nose=99.*at most 29"),
        (POINTS.replace("head", "haed"), "no link 'haed'; did you mean 'head'"),
        ("[skin]\nlink = 'head'\npositions = []\nreference = 0\n", "a list of rows of 3 numbers"),
        ("[skin]\nlink = 'head'\npositions = [[0.0, 1.0]]\nreference = 0\n", "3 numbers"),
        (GRID + "[skin.on]\nkind = 'cone'\n", "kind='cone': give one of 'sphere', 'box', 'cylinder', 'capsule'"),
        (GRID + "[skin.on]\nkind = 'sphere'\n", "field 'radius' is missing"),
        (GRID + "mesh_folder = 3\n", "mesh_folder=3: give a text"),
        (GRID.replace("head", "base"), "link 'base' has no shape that a skin can lie on; state one"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_table_is_said_in_a_line(folder, skin, match):
    with pytest.raises(BodyImageKinError, match=match):
        load(folder, skin)


def test_points_on_a_link_without_its_mesh_work_and_say_what_is_missing(folder):
    (folder / "head.stl").unlink()
    body = load(folder, POINTS)
    assert "nothing of link 'head' hides the hand" in body.skin.notes[-1]
    assert body.visible(body.felt_home).ndim == 0
    with pytest.raises(BodyImageKinError, match="has no shape that a hand can be dragged on"):
        bk.simulate(body, bk.motions.RandomTouch(duration=1.0))
    bk.simulate(body, bk.motions.RandomTouch(duration=1.0), dynamics=False)


def test_a_look_at_a_body_tells_of_its_skin(folder):
    assert not [one for one in check_embodiment(load(folder, POINTS)) if one.about == "skin" and one.level == "error"]
    turned = PLACES.copy() / 0.08
    turned[[3, 7]] *= -1.0
    body = load(folder, POINTS)
    parts = {"joints": body.joints, "hand": body.hand, "camera": body.camera, "home": body.home, "name": "r"}
    edges = [edge for edge in body.skin.neighbours.tolist() if 29 not in edge]
    skin = bk.Skin.points(PLACES, turned, edges, link="head", reference=12)
    for surface in (True, False):
        if not surface:
            (folder / "head.stl").unlink()
        robot = bk.Robot.from_urdf(folder / "r.urdf")
        found = [
            one.text for one in check_embodiment(bk.Embodiment.build(robot, **parts, skin=skin)) if one.about == "skin"
        ]
        assert any("the normals of 2 of 30 taxels point inward (first 3, 7)" in text for text in found)
        assert any("its graph is in 2 pieces" in text and "taxels 29 have no neighbour" in text for text in found)


def test_a_study_scores_maps_of_a_skin_that_is_no_grid(folder):
    ball = '<collision><geometry><sphere radius="0.08"/></geometry></collision>'
    (folder / "r.urdf").write_text(ARM.format(head=ball), encoding="utf-8")
    body = load(folder, POINTS)
    touch, circle = bk.motions.RandomTouch(duration=20.0), bk.motions.Circle(radius=0.02, turns=1.0)
    near = bk.study.Simulation(circle, use=touch, tour=touch, dynamics=False)
    scores = ["map_error", "map_disparity", "map_topological_error"]
    study = bk.Study(body, {"near": near}, [bk.estimators.LeastSquares()], seeds=1, scores=scores)
    results = study.run(folder / "out")
    assert np.isfinite(results["map_disparity"]).all()
    assert np.isfinite(results["map_error"]).all()
    assert np.isnan(results["map_topological_error"]).all()
