"""Triangles stand where the joints put them, pictures keep their scale, and no file outside the folder is read."""

import warnings

import numpy as np
import pytest
import trimesh

from bodyimage_kin.errors import InvalidArray, InvalidConfig, InvalidGeometry, InvalidPosture, InvalidURDF, UnknownName
from bodyimage_kin.figures import drawing, style
from bodyimage_kin.robot import Robot

BOX = """<robot name="arm">
  <material name="blue"><color rgba="0.1 0.2 0.9 1"/></material>
  <link name="base"/>
  <link name="arm"><visual><origin xyz="0.1 0 0.02" rpy="0.3 -0.2 1.1"/><geometry><box size="0.2 0.04 0.06"/></geometry>
    <material name="blue"/></visual></link>
  <link name="slide"><visual><geometry><sphere radius="0.03"/></geometry></visual></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.5" rpy="0 0 0.4"/>
    <axis xyz="0 1 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="follow" type="prismatic"><parent link="arm"/><child link="slide"/><axis xyz="2 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/><mimic joint="turn" multiplier="0.5" offset="0.1"/></joint>
</robot>"""
MESH = """<robot name="m"><link name="base"><visual>
  <geometry><mesh filename="{}" scale="0.5 1 2"/></geometry></visual></link></robot>"""
FRONT = drawing.View((1.0, 0.0, 0.0))


def rotation(axis, angle):
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def rpy(roll, pitch, yaw):
    return rotation([0, 0, 1], yaw) @ rotation([0, 1, 0], pitch) @ rotation([1, 0, 0], roll)


def test_box_stands_where_the_joint_puts_it():
    surface = drawing.triangles(BOX, {"turn": 0.7}, links=["arm"])
    corners = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.02, 0.02) for z in (-0.03, 0.03)])
    in_link = corners @ rpy(0.3, -0.2, 1.1).T + [0.1, 0, 0.02]
    expected = in_link @ (rpy(0, 0, 0.4) @ rotation([0, 1, 1], 0.7)).T + [0, 0, 0.5]
    distances = np.linalg.norm(surface.corners.reshape(-1, 1, 3) - expected, axis=2)
    assert surface.corners.shape == (12, 3, 3)
    np.testing.assert_allclose(distances.min(1), 0, atol=1e-12)
    np.testing.assert_allclose(distances.min(0), 0, atol=1e-12)
    np.testing.assert_allclose(surface.colours, np.tile([0.1, 0.2, 0.9, 1], (12, 1)), atol=1e-12)
    volume = (
        np.einsum("ij,ij->i", surface.corners[:, 0], np.cross(surface.corners[:, 1], surface.corners[:, 2])).sum() / 6
    )
    np.testing.assert_allclose(volume, 0.2 * 0.04 * 0.06, rtol=1e-12, err_msg="counterclockwise from outside")


def test_mimic_joint_follows_along_its_normalised_axis():
    surface = drawing.triangles(Robot.from_urdf(BOX), {"turn": 0.7}, links=["slide"])
    middle = (surface.corners.reshape(-1, 3).max(0) + surface.corners.reshape(-1, 3).min(0)) / 2
    expected = rpy(0, 0, 0.4) @ rotation([0, 1, 1], 0.7) @ [0.5 * 0.7 + 0.1, 0, 0] + [0, 0, 0.5]
    np.testing.assert_allclose(middle, expected, atol=1e-4)
    assert {surface.link_names[index] for index in surface.links} == {"slide"}


def test_meshes_are_read_scaled_and_only_from_their_folder(tmp_path):
    folder = tmp_path / "robot"
    (folder / "pkg").mkdir(parents=True)
    cube = trimesh.creation.box(extents=[1, 1, 1])
    for place in (folder / "pkg", tmp_path):
        cube.export(place / "cube.stl")
    urdf = folder / "robot.urdf"
    for name in ("pkg/cube.stl", "package://pkg/cube.stl"):
        urdf.write_text(MESH.format(name))
        assert np.ptp(drawing.triangles(urdf, {}).corners, axis=(0, 1)) == pytest.approx([0.5, 1, 2])
    (folder / "link.stl").symlink_to(tmp_path / "cube.stl")
    (folder / "note.txt").write_text("x")
    (folder / "broken.stl").write_bytes(b"")
    for name, reason in {
        "../cube.stl": "outside",
        str(tmp_path / "cube.stl"): "outside",
        f"file://{tmp_path}/cube.stl": "outside",
        "link.stl": "outside",
        "missing.stl": "is not in",
        "http://example.org/cube.stl": "is not in",
        "note.txt": "none of",
        "broken.stl": "cannot be read",
    }.items():
        urdf.write_text(MESH.format(name))
        with pytest.raises(InvalidGeometry, match=reason):
            drawing.triangles(urdf, {})
    urdf.write_text(MESH.format("../cube.stl"))
    assert len(drawing.triangles(urdf, {}, mesh_folder=tmp_path).corners) == 12
    with pytest.raises(InvalidGeometry, match="mesh_folder"):
        drawing.triangles(MESH.format("cube.stl"), {})


def test_errors_name_what_is_wrong():
    with pytest.raises(UnknownName, match="trun"):
        drawing.triangles(BOX, {"trun": 0.1})
    with pytest.raises(UnknownName, match="follow"):
        drawing.triangles(BOX, {"follow": 0.1})
    with pytest.raises(InvalidPosture, match="finite"):
        drawing.triangles(BOX, {"turn": float("nan")})
    with pytest.raises(UnknownName, match="ram"):
        drawing.triangles(BOX, {}, links=["ram"])
    with pytest.raises(InvalidURDF):
        drawing.triangles("/nowhere/robot.urdf", {})
    with pytest.raises(InvalidConfig, match="up"):
        drawing.project([[0.0, 0, 0]], drawing.View((0.0, 0.0, 1.0)))
    with pytest.raises(InvalidArray, match="x, y, z"):
        drawing.project([0.0, 1.0], FRONT)
    with pytest.raises(InvalidGeometry, match="nothing to draw"):
        drawing.draw_robot(style.new_figure(2, 2).subplots(), BOX, {}, view=FRONT, links=["base"])


def test_picture_is_true_to_scale_with_depth_away_from_the_viewer():
    flat, depth = drawing.project([[0.1, 0.2, 0.3], [-0.1, 0.2, 0.3]], FRONT)
    np.testing.assert_allclose(flat, [[0.2, 0.3], [0.2, 0.3]], atol=1e-15)
    np.testing.assert_allclose(depth, [-0.1, 0.1], atol=1e-15)
    flat, depth = drawing.project(
        [[0.5, 0.2, 0.3], [0.0, 0.2, 0.3], [2, 0, 0]], drawing.View((1.0, 0, 0), perspective=True)
    )
    np.testing.assert_allclose(flat[:2], [[0.4, 0.6], [0.2, 0.3]], atol=1e-15)
    np.testing.assert_allclose(depth, [0.5, 1.0, np.nan])
    around = drawing.View.around([1.0, 2, 3], azimuth=90, elevation=30, distance=2)
    np.testing.assert_allclose(around.look_from, [1, 2 + 3**0.5, 4], atol=1e-12)


@pytest.mark.parametrize("perspective", [False, True])
def test_points_behind_the_robot_are_hidden(perspective):
    surface = drawing.triangles(BOX, {}, links=["slide"])
    centre = surface.corners.mean((0, 1))
    view = drawing.View.around(centre, azimuth=70, elevation=-20, perspective=perspective)
    towards = np.subtract(view.look_from, view.look_to)
    points = centre + np.outer([0.031, 0.0, -0.031, -0.5], towards) + [[0, 0, 0]]
    aside = points + 0.07 * view.axes()[0]
    assert drawing.hidden(points, surface, view).tolist() == [False, True, True, True]
    assert not drawing.hidden(aside, surface, view).any()
    tilted = np.array([[[0.0, -1, -1], [-10.0, 3, -1], [0.0, -1, 3]]])
    plane = drawing.Surface(tilted, tilted, np.ones((1, 4)), np.zeros(1, dtype=int), ("plane",))
    on_plane = tilted[0].mean(0)
    eye = drawing.View((1.0, 0.0, 0.0), perspective=perspective)
    line_of_sight = on_plane - np.asarray(eye.look_from) if perspective else np.array([-1.0, 0, 0])
    ahead, behind = on_plane - 1e-2 * line_of_sight, on_plane + 1e-2 * line_of_sight
    assert drawing.hidden([ahead, behind], plane, eye).tolist() == [False, True]


def test_drawing_shows_the_near_side_in_front(tmp_path):
    boxes = "".join(
        f'<visual><origin xyz="{x} 0 0"/><geometry><box size="0.1 {w} {w}"/></geometry>'
        f'<material name="{n}"><color rgba="{c} 1"/></material></visual>'
        for x, w, n, c in ((-0.2, 0.4, "far", "1 0 0"), (0.2, 0.2, "near", "0 0 1"))
    )
    with style.style():
        figure = style.new_figure(2, 2)
        figure.set_layout_engine("none")
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        drawing.draw_robot(axes, f'<robot name="r"><link name="b">{boxes}</link></robot>', {}, view=FRONT)
        figure.canvas.draw()
    image = np.asarray(figure.canvas.buffer_rgba()).astype(int)
    red, blue = image[..., 0] > image[..., 2] + 50, image[..., 2] > image[..., 0] + 50
    assert blue[100, 100]
    assert red[100, 25]
    assert not blue[100, 25]
    # The side turned to the viewer and the light is drawn: twice as bright as the one behind.
    assert image[100, 100, 2] > 0.8 * 255
    # Orthographic: the areas are as 0.2 squared to 0.4 squared, however far the boxes are.
    assert blue.sum() / (red | blue).sum() == pytest.approx(0.25, abs=0.02)
    assert axes.get_aspect() == 1
    svg, _ = style.save(figure, tmp_path, "boxes")
    assert svg.stat().st_size < 300_000


def test_normals_are_those_of_the_shape():
    surface = drawing.triangles(BOX, {"turn": 0.7})
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=-1), 1, atol=1e-12)
    flat = np.cross(surface.corners[:, 1] - surface.corners[:, 0], surface.corners[:, 2] - surface.corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    box, ball = surface.links == 1, surface.links == 2
    np.testing.assert_allclose(surface.normals[box], np.repeat(flat[box, None], 3, 1), atol=1e-12)
    assert (np.einsum("tci,ti->tc", surface.normals[ball], flat[ball]) > 0.99).all()
    tube = '<visual><geometry><cylinder radius="2" length="3"/></geometry></visual>'
    surface = drawing.triangles(f'<robot name="t"><link name="b">{tube}</link></robot>', {})
    cap = (np.abs(surface.normals[..., 2]) > 0.5).all(1)
    np.testing.assert_allclose(np.abs(surface.normals[cap]), np.tile([0, 0, 1], (cap.sum(), 3, 1)), atol=1e-12)
    np.testing.assert_allclose(surface.normals[~cap] * 2, surface.corners[~cap] * [1, 1, 0], atol=1e-12)


def test_shapes_that_intersect_meet_where_they_do():
    crossed = "".join(
        f'<visual><origin rpy="0 0 {angle}"/><geometry><box size="1 0.001 1"/></geometry>'
        f'<material name="{name}"><color rgba="{colour} 1"/></material></visual>'
        for angle, name, colour in ((1.0, "a", "1 0 0"), (-1.0, "b", "0 0 1"))
    )
    with style.style():
        axes = style.new_figure(2, 2).subplots()
        surface = drawing.triangles(f'<robot name="r"><link name="b">{crossed}</link></robot>', {})
        image = np.asarray(drawing.draw_surface(axes, surface, FRONT).get_array())
    # Two thin plates cross like an X seen from above: each is in front on one side, up to the line where they cross.
    row = image[image.shape[0] // 2]
    red, blue = np.flatnonzero(row[:, 0] > 2 * row[:, 2]), np.flatnonzero(row[:, 2] > 2 * row[:, 0])
    middle = len(row) / 2
    assert {bool((red < middle + 2).all()), bool((red > middle - 2).all())} == {True, False}
    assert {bool((blue < middle + 2).all()), bool((blue > middle - 2).all())} == {True, False}
    assert len(red) > 200
    assert len(blue) > 200


def test_nothing_is_logged_or_warned(caplog):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        drawing.triangles(BOX, {})
    assert not caught
    assert not caplog.records
