"""Laws of rays and segments against primitive shapes, checked by looking at many points."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidGeometry, UnknownName
from bodyimage_kin.robot.shapes import Shape, blocked, cast, link_surface
from bodyimage_kin.robot.transforms import axis_angle_matrix, matrix_rpy, rpy_matrix, transform

PLACE = transform(rpy_matrix((0.3, -0.4, 0.5)), (0.01, 0.02, -0.03))
SHAPES = {
    "sphere": Shape("sphere", (0.07,), PLACE),
    "box": Shape("box", (0.05, 0.08, 0.03), PLACE),
    "cylinder": Shape("cylinder", (0.04, 0.09), PLACE),
    "capsule": Shape("capsule", (0.04, 0.06), PLACE),
}


def depth(shape, points):
    """How far points are inside a shape, negative outside, up to a factor."""
    p = (points - shape.link_T_shape[:3, 3]) @ shape.link_T_shape[:3, :3]
    if shape.kind == "sphere":
        return shape.size[0] - np.linalg.norm(p, axis=-1)
    if shape.kind == "box":
        return (np.array(shape.size) - np.abs(p)).min(-1)
    if shape.kind == "capsule":
        above = np.maximum(np.abs(p[..., 2]) - shape.size[1], 0.0)
        return shape.size[0] - np.hypot(np.hypot(p[..., 0], p[..., 1]), above)
    return np.minimum(shape.size[0] - np.linalg.norm(p[..., :2], axis=-1), shape.size[1] - np.abs(p[..., 2]))


angles = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi]) | st.floats(-4, 4)


@given(rpy=st.tuples(angles, angles, angles))
def test_roll_pitch_yaw_come_back_as_the_same_rotation(rpy):
    rotation = rpy_matrix(rpy)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(rpy_matrix(matrix_rpy(rotation)), rotation, atol=1e-15)


def test_turning_about_the_axes_by_hand():
    roll, pitch, yaw = (
        axis_angle_matrix(axis, angle) for axis, angle in zip(np.eye(3).tolist(), (0.1, 0.2, 0.3), strict=True)
    )
    np.testing.assert_allclose(rpy_matrix((0.1, 0.2, 0.3)), yaw @ pitch @ roll, atol=1e-15)
    np.testing.assert_allclose(axis_angle_matrix((0.0, 0.0, 1.0), np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)


@pytest.mark.parametrize("kind", SHAPES)
def test_rays_stop_where_they_first_meet_the_surface(kind):
    shape, rng = SHAPES[kind], np.random.default_rng(0)
    origins = rng.normal(size=(400, 3))
    origins *= 0.3 / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = rng.normal(size=(400, 3)) * 0.05 - origins
    points, normals = cast((shape,), origins, directions)
    way = origins[:, None] + np.linspace(0, 2, 2001)[:, None] * directions[:, None]
    deepest = depth(shape, way).max(1)
    clear = np.abs(deepest) > 1e-3
    hit = np.isfinite(points[:, 0])
    np.testing.assert_array_equal(hit[clear], deepest[clear] > 0)
    assert 50 < hit.sum() < 350
    np.testing.assert_allclose(depth(shape, points[hit]), 0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(normals[hit], axis=1), 1)
    # From outside: the surface faces the ray, and a step along the normal leaves the shape.
    assert ((normals * directions).sum(1)[hit] < 0).all()
    assert (depth(shape, points[hit] + 1e-4 * normals[hit]) < -5e-5).all()
    before = origins[hit, None] + np.linspace(0, 0.999, 50)[:, None] * (points - origins)[hit, None]
    assert (depth(shape, before) < 0).all()


def test_a_normal_is_perpendicular_to_the_surface():
    # On a sphere, a capsule and a cylinder's side the normal is the gradient of the depth.
    for kind in ("sphere", "cylinder", "capsule"):
        shape = SHAPES[kind]
        origins = PLACE[:3, 3] + np.array([[0.2, 0.05, 0.03], [-0.2, 0.1, 0.0], [0.1, 0.2, -0.02]])
        points, normals = cast((shape,), origins, PLACE[:3, 3] - origins)
        step = 1e-6 * np.eye(3)
        gradient = (depth(shape, points[:, None] + step) - depth(shape, points[:, None] - step)) / 2e-6
        np.testing.assert_allclose(normals, -gradient, atol=1e-8)


@pytest.mark.parametrize("kind", SHAPES)
def test_segments_are_blocked_by_what_lies_between(kind):
    shape, rng = SHAPES[kind], np.random.default_rng(1)
    starts, ends = rng.normal(size=(2, 600, 3)) * 0.08
    way = starts[:, None] + np.linspace(0, 1, 2001)[:, None] * (ends - starts)[:, None]
    deepest = depth(shape, way).max(1)
    clear = np.abs(deepest) > 1e-3
    through = blocked((shape,), starts, ends)
    np.testing.assert_array_equal(through[clear], deepest[clear] > 0)
    assert 100 < through.sum() < 500


def test_a_segment_that_starts_on_the_surface_and_leaves_is_free():
    sphere = (SHAPES["sphere"],)
    origins = PLACE[:3, 3] + np.random.default_rng(2).normal(size=(50, 3))
    points, normals = cast(sphere, origins, PLACE[:3, 3] - origins)
    assert not blocked(sphere, points, points + 0.1 * normals).any()
    assert blocked(sphere, points, points - 0.1 * normals).all()
    # No way at all is not through anything.
    assert not blocked(sphere, points, points).any()


@given(offset=st.floats(-0.2, 0.2), along=st.sampled_from([0, 1, 2]))
@settings(max_examples=60)
def test_rays_along_the_axes_of_a_box_meet_it_where_they_must(offset, along):
    # Parallel to two of its faces: where a ray library divides zero by zero.
    box = Shape("box", (0.05, 0.08, 0.03), np.eye(4))
    across = (along + 1) % 3
    origin, direction = np.zeros((1, 3)), np.zeros((1, 3))
    origin[0, along], origin[0, across], direction[0, along] = -1.0, offset, 1.0
    points, normals = cast((box,), origin, direction)
    if abs(offset) <= box.size[across]:
        np.testing.assert_allclose(points[0, along], -box.size[along])
        if abs(offset) < box.size[across] * 0.999:
            assert normals[0, along] == -1.0
    else:
        assert np.isnan(points).all()


def test_of_several_shapes_the_nearest_counts():
    near, far = (Shape("sphere", (0.01,), transform(np.eye(3), (x, 0.0, 0.0))) for x in (0.1, 0.2))
    points, _ = cast((far, near), np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(points, [[0.09, 0.0, 0.0]])


def link(collision):
    return bk.Robot.from_urdf(f'<robot name="r"><link name="head">{collision}</link></robot>')


def test_shapes_are_read_with_their_places():
    origin = '<origin xyz="0.01 0.02 -0.03" rpy="0.3 -0.4 0.5"/>'
    geometries = (
        '<sphere radius="0.07"/>', '<box size="0.1 0.16 0.06"/>', '<cylinder radius="0.04" length="0.18"/>',
        '<capsule radius="0.04" length="0.12"/>',
    )  # fmt: skip
    collisions = "".join(f"<collision>{origin}<geometry>{geometry}</geometry></collision>" for geometry in geometries)
    for shape, expected in zip(link_surface(link(collisions), "head").surface, SHAPES.values(), strict=True):
        assert shape.kind == expected.kind
        assert shape.size == pytest.approx(expected.size)
        np.testing.assert_allclose(shape.link_T_shape, PLACE, atol=1e-15)


def test_a_link_without_usable_shapes_is_refused():
    with pytest.raises(InvalidGeometry, match="'head' has no shape that a skin can lie on"):
        link_surface(link(""), "head")
    with pytest.raises(InvalidGeometry, match=r"'a.stl' of a robot given as XML; say where in mesh_folder"):
        link_surface(link('<collision><geometry><mesh filename="a.stl"/></geometry></collision>'), "head")
    with pytest.raises(UnknownName, match="no link 'heda'; did you mean 'head'"):
        link_surface(link(""), "heda")
