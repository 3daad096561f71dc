"""Pictures are true to scale, what is in front covers what is behind, and a view is chosen by what it shows."""

import dataclasses

import numpy as np
import pytest

import bodyimage_kin as bk
from bodyimage_kin import figures
from bodyimage_kin.body.cameras import Camera, Tracker
from bodyimage_kin.errors import InvalidGeometry
from bodyimage_kin.figures import visuals
from bodyimage_kin.figures._rasteriser import draw_surface, render
from bodyimage_kin.figures._views import View, clearest, facing, hidden, project, window_of
from bodyimage_kin.figures.visuals import Surface

FRONT = View(np.zeros(3), 0.0, 0.0)
BALL = """<robot name="r"><link name="base"/><link name="ball"><visual><origin xyz="0.2 0 0.5"/>
  <geometry><sphere radius="0.03"/></geometry></visual></link>
  <joint name="weld" type="fixed"><parent link="base"/><child link="ball"/></joint></robot>"""


def triangles(urdf, **options):
    return visuals.triangles(bk.Robot.from_urdf(urdf), {}, **options)


def boxes(*places):
    """A link of boxes: x and width [m], name and colour."""
    visuals = "".join(
        f'<visual><origin xyz="{x} 0 0"/><geometry><box size="0.1 {width} {width}"/></geometry>'
        f'<material name="{name}"><color rgba="{colour} 1"/></material></visual>'
        for x, width, name, colour in places
    )
    return triangles(f'<robot name="r"><link name="b">{visuals}</link></robot>')


def test_picture_is_true_to_scale_with_depth_away_from_the_viewer():
    flat, depth = project(np.array([[0.1, 0.2, 0.3], [-0.1, 0.2, 0.3]]), FRONT)
    np.testing.assert_allclose(flat, [[0.2, 0.3], [0.2, 0.3]], atol=1e-15)
    np.testing.assert_allclose(depth, [-0.1, 0.1], atol=1e-15)
    around = View(np.array([1.0, 2, 3]), 90, 30)
    np.testing.assert_allclose(-around.axes()[2], [0, 3**0.5 / 2, 0.5], atol=1e-12)


@pytest.mark.parametrize("azimuth", [0.0, 70.0, -160.0])
@pytest.mark.parametrize("elevation", [-90.0, -20.0, 0.0, 45.0, 90.0])
def test_every_view_has_a_right_handed_frame(azimuth, elevation):
    right, up, forward = View(np.zeros(3), azimuth, elevation).axes()
    np.testing.assert_allclose(np.stack([right, up, forward]) @ np.stack([right, up, forward]).T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.cross(right, up), -forward, atol=1e-12)
    assert right[2] == 0
    assert up[2] >= -1e-12


def test_points_behind_the_robot_are_hidden():
    surface = triangles(BALL, links=["ball"])
    centre = surface.corners.mean((0, 1))
    view = View(centre, 70, -20)
    towards = -view.axes()[2]
    points = centre + np.outer([0.031, 0.0, -0.031, -0.5], towards)
    assert hidden(points, surface, view).tolist() == [False, True, True, True]
    assert not hidden(points + 0.07 * view.axes()[0], surface, view).any()
    tilted = np.array([[[0.0, -1, -1], [-10.0, 3, -1], [0.0, -1, 3]]])
    plane = Surface(tilted, tilted, np.ones((1, 4)), np.zeros(1, dtype=int), ("plane",))
    on_plane, sight = tilted[0].mean(0), np.array([-1.0, 0, 0])
    points = np.stack([on_plane - 1e-2 * sight, on_plane + 1e-2 * sight])
    assert hidden(points, plane, FRONT).tolist() == [False, True]
    from_behind = View(np.zeros(3), 180, 0)
    assert clearest([from_behind, FRONT], [(plane, points[:1])]) is FRONT
    assert clearest([from_behind, FRONT], [(plane, points[1:])]) is from_behind


def test_drawing_shows_the_near_side_in_front(tmp_path):
    surface = boxes((-0.2, 0.4, "far", "1 0 0"), (0.2, 0.2, "near", "0 0 1"))
    with figures.style():
        figure, grid = figures.panels(width=2, height=2)
        figure.set_layout_engine("none")
        axes = grid[0, 0]
        axes.set_position((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        draw_surface(axes, surface, FRONT)
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
    assert figures.save(figure, tmp_path, "boxes")[0].stat().st_size < 300_000


def test_shapes_that_intersect_meet_where_they_do():
    crossed = "".join(
        f'<visual><origin rpy="0 0 {angle}"/><geometry><box size="1 0.001 1"/></geometry>'
        f'<material name="{name}"><color rgba="{colour} 1"/></material></visual>'
        for angle, name, colour in ((1.0, "a", "1 0 0"), (-1.0, "b", "0 0 1"))
    )
    surface = triangles(f'<robot name="r"><link name="b">{crossed}</link></robot>')
    image = render(surface, FRONT, window_of(project(surface.corners, FRONT)[0]))
    # Two thin plates cross like an X seen from above: each is in front on one side, up to the line where they cross.
    row = image[image.shape[0] // 2]
    red, blue = np.flatnonzero(row[:, 0] > 2 * row[:, 2]), np.flatnonzero(row[:, 2] > 2 * row[:, 0])
    middle = len(row) / 2
    assert {bool((red < middle + 2).all()), bool((red > middle - 2).all())} == {True, False}
    assert {bool((blue < middle + 2).all()), bool((blue > middle - 2).all())} == {True, False}
    assert len(red) > 200
    assert len(blue) > 200


def test_a_window_holds_its_points_with_a_margin():
    points = np.array([[0.0, 0.0], [0.2, 0.1], [np.nan, np.nan]])
    assert window_of(points, 0.1) == pytest.approx((-0.02, 0.22, -0.02, 0.12))
    assert window_of(points, 0.1, below=3.0) == pytest.approx((-0.02, 0.22, -0.06, 0.12))
    left, right, bottom, top = window_of(points, 0.0, square=True)
    assert (right - left, (bottom + top) / 2) == pytest.approx((top - bottom, 0.05))


def test_the_face_looks_where_its_skin_does(body):
    azimuth, elevation = facing(body)
    normal = body.skin.normals.numpy().mean(0)
    forward = -View(np.zeros(3), azimuth, elevation).axes()[2]
    assert forward @ normal / np.linalg.norm(normal) > 0.99


def test_a_face_that_looks_up_is_seen_from_above(body):
    up = np.eye(4)
    up[2, 3] = 1.0
    bare = dataclasses.replace(body, skin=None, camera=Camera(body.robot.root, up, Tracker()))
    assert facing(bare) == (0.0, 90.0)


def test_nothing_to_draw_is_told():
    with pytest.raises(InvalidGeometry, match="nothing to draw"):
        render(triangles(BALL, links=["base"]), FRONT, (-1.0, 1.0, -1.0, 1.0))
