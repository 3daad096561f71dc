"""Triangles stand where the joints put them, and no file outside the folder is read."""

import os
import re
import warnings

import numpy as np
import pytest
import trimesh

from bodyimage_kin.errors import InvalidGeometry, InvalidPosture, UnknownName
from bodyimage_kin.figures import visuals
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


def triangles(urdf, posture, **options):
    return visuals.triangles(Robot.from_urdf(urdf), posture, **options)


def rotation(axis, angle):
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def rpy(roll, pitch, yaw):
    return rotation([0, 0, 1], yaw) @ rotation([0, 1, 0], pitch) @ rotation([1, 0, 0], roll)


def test_box_stands_where_the_joint_puts_it():
    surface = triangles(BOX, {"turn": 0.7}, links=["arm"])
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
    surface = triangles(BOX, {"turn": 0.7}, links=["slide"])
    middle = (surface.corners.reshape(-1, 3).max(0) + surface.corners.reshape(-1, 3).min(0)) / 2
    expected = rpy(0, 0, 0.4) @ rotation([0, 1, 1], 0.7) @ [0.5 * 0.7 + 0.1, 0, 0] + [0, 0, 0.5]
    np.testing.assert_allclose(middle, expected, atol=1e-4)
    assert {surface.link_names[index] for index in surface.links} == {"slide"}


def test_meshes_are_read_scaled_and_only_from_their_folder(tmp_path, monkeypatch):
    folder = tmp_path / "robot"
    (folder / "pkg").mkdir(parents=True)
    cube = trimesh.creation.box(extents=[1, 1, 1])
    for place in (folder / "pkg", tmp_path):
        cube.export(place / "cube.stl")
    urdf = folder / "robot.urdf"
    for name in ("pkg/cube.stl", "package://pkg/cube.stl"):
        urdf.write_text(MESH.format(name))
        assert np.ptp(triangles(urdf, {}).corners, axis=(0, 1)) == pytest.approx([0.5, 1, 2])
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
            triangles(urdf, {})
    urdf.write_text(MESH.format("../cube.stl"))
    assert len(triangles(urdf, {}, mesh_folder=tmp_path).corners) == 12
    monkeypatch.chdir(folder)
    assert len(triangles("robot.urdf", {}, mesh_folder=tmp_path).corners) == 12
    with pytest.raises(InvalidGeometry, match="mesh_folder"):
        triangles(MESH.format("cube.stl"), {})


def test_errors_name_what_is_wrong():
    with pytest.raises(UnknownName, match="trun"):
        triangles(BOX, {"trun": 0.1})
    with pytest.raises(UnknownName, match="follow"):
        triangles(BOX, {"follow": 0.1})
    with pytest.raises(InvalidPosture, match="finite"):
        triangles(BOX, {"turn": float("nan")})
    with pytest.raises(UnknownName, match="ram"):
        triangles(BOX, {}, links=["ram"])


def test_normals_are_those_of_the_shape():
    surface = triangles(BOX, {"turn": 0.7})
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=-1), 1, atol=1e-12)
    flat = np.cross(surface.corners[:, 1] - surface.corners[:, 0], surface.corners[:, 2] - surface.corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    box, ball = surface.links == 1, surface.links == 2
    np.testing.assert_allclose(surface.normals[box], np.repeat(flat[box, None], 3, 1), atol=1e-12)
    assert (np.einsum("tci,ti->tc", surface.normals[ball], flat[ball]) > 0.99).all()
    tube = '<visual><geometry><cylinder radius="2" length="3"/></geometry></visual>'
    surface = triangles(f'<robot name="t"><link name="b">{tube}</link></robot>', {})
    cap = (np.abs(surface.normals[..., 2]) > 0.5).all(1)
    np.testing.assert_allclose(np.abs(surface.normals[cap]), np.tile([0, 0, 1], (cap.sum(), 3, 1)), atol=1e-12)
    np.testing.assert_allclose(surface.normals[~cap] * 2, surface.corners[~cap] * [1, 1, 0], atol=1e-12)


def test_nothing_is_logged_or_warned(caplog):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        triangles(BOX, {})
    assert not caught
    assert not caplog.records


def test_capsules_are_drawn_round():
    capsule = '<visual><geometry><capsule radius="0.1" length="0.4"/></geometry></visual>'
    surface = triangles(f'<robot name="t"><link name="b">{capsule}</link></robot>', {})
    middle = np.clip(surface.corners[..., 2:], -0.2, 0.2) * [0.0, 0.0, 1.0]
    np.testing.assert_allclose(np.linalg.norm(surface.corners - middle, axis=-1), 0.1, atol=1e-12)
    np.testing.assert_allclose(surface.corners - middle, 0.1 * surface.normals, atol=1e-12)
    np.testing.assert_allclose(np.abs(surface.corners[..., 2]).max(), 0.3, atol=1e-12)
    corners = surface.corners
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    np.testing.assert_allclose(volume, np.pi * 0.1**2 * (0.4 + 4 / 3 * 0.1), rtol=0.01)


def test_an_odd_visual_is_left_out_and_the_others_are_drawn():
    odd = BOX.replace('<sphere radius="0.03"/>', "<blob/>")
    assert set(triangles(odd, {}).links.tolist()) == {1}
    assert "(the visual is left out)" in Robot.from_urdf(odd).notes[0]


def test_meshes_of_packages_are_found_where_the_environment_says(tmp_path, monkeypatch):
    name = "package://pkg/meshes/cube.stl"
    urdf = MESH.format(name)
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)
    with pytest.raises(InvalidGeometry, match="not in any package; set mesh_folder or ROS_PACKAGE_PATH"):
        triangles(urdf, {})
    for index, (variable, place, value) in enumerate([
        ("ROS_PACKAGE_PATH", "src/pkg", "src"),
        ("ROS_PACKAGE_PATH", "here/pkg", "here/pkg"),
        ("AMENT_PREFIX_PATH", "install/share/pkg", "install"),
    ]):  # fmt: skip
        folder = tmp_path / str(index)
        (folder / place / "meshes").mkdir(parents=True)
        trimesh.creation.box(extents=[1, 1, 1]).export(folder / place / "meshes" / "cube.stl")
        trimesh.creation.box(extents=[1, 1, 1]).export((folder / place).parent / "cube.stl")
        with monkeypatch.context() as patch:
            patch.setenv(variable, f"/nowhere{os.pathsep}{folder / value}")
            assert len(triangles(urdf, {}).corners) == 12
            with pytest.raises(InvalidGeometry, match="outside"):
                triangles(urdf.replace("meshes/", "../"), {})
    around = tmp_path / "pkg" / "urdf" / "robot.urdf"
    around.parent.mkdir(parents=True)
    around.write_text(urdf)
    (tmp_path / "0" / "src" / "pkg" / "meshes").rename(tmp_path / "pkg" / "meshes")
    assert len(triangles(around, {}).corners) == 12


def test_a_robot_without_visuals_is_rods_between_its_joints():
    bare = re.sub("<visual>.*?</visual>", "", BOX, flags=re.DOTALL)
    surface = triangles(bare, {"turn": 0.7})
    assert {surface.link_names[index] for index in surface.links} == {"base", "arm", "slide"}
    base = surface.corners[surface.links == 0].reshape(-1, 3)
    # From the root to the joint half a metre above it, and no farther than the rod is thick.
    assert base[:, 2].max() == pytest.approx(0.5, abs=1e-6)
    assert np.abs(base[:, :2]).max() < 0.05
    volume = np.einsum("ij,ij->i", surface.corners[:, 0], np.cross(surface.corners[:, 1], surface.corners[:, 2])).sum()
    assert volume > 0, "counterclockwise from outside"
    x, y, z = (0.3, -0.2, 0.1)
    slanted = triangles(bare.replace('<origin xyz="0 0 0.5" rpy="0 0 0.4"/>', f'<origin xyz="{x} {y} {z}"/>'), {})
    rod = slanted.corners[slanted.links == 0].reshape(-1, 3)
    along = np.array([x, y, z]) / np.linalg.norm([x, y, z])
    assert (rod @ along).max() == pytest.approx(np.linalg.norm([x, y, z]), abs=1e-6)


def test_rods_are_as_thick_whatever_else_hangs_on_the_robot():
    bare = re.sub("<visual>.*?</visual>", "", BOX, flags=re.DOTALL)
    finger = '<link name="f{0}"/><joint name="f{0}" type="fixed"><parent link="base"/><child link="f{0}"/>'
    fingers = "".join(finger.format(one) + '<origin xyz="0 0.1 0"/></joint>' for one in range(30))
    one, other = (
        triangles(urdf, {}, links=["slide"]) for urdf in (bare, bare.replace("</robot>", f"{fingers}</robot>"))
    )
    np.testing.assert_allclose(np.ptp(other.corners, axis=(0, 1)), np.ptp(one.corners, axis=(0, 1)), rtol=1e-9)


def test_black_is_drawn_grey_for_it_shows_no_shape():
    assert "0.1 0.2 0.9 1" in BOX
    surface = triangles(BOX.replace("0.1 0.2 0.9 1", "0 0 0 0.5"), {}, links=["arm"])
    np.testing.assert_allclose(surface.colours, np.tile([0.5, 0.5, 0.5, 0.5], (12, 1)))
