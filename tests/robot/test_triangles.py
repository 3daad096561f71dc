"""Laws of rays and nearest points on triangles: those of the shapes that they tile, and of each other."""

import numpy as np
import pytest
import trimesh

import bodyimage_kin as bk
from bodyimage_kin.body.collisions import vertices_of
from bodyimage_kin.errors import InvalidGeometry
from bodyimage_kin.figures.visuals import link_surfaces
from bodyimage_kin.robot.shapes import Shape, blocked, cast, link_parts, link_surface
from bodyimage_kin.robot.triangles import Triangles

RNG = np.random.default_rng(0)
BALL = Triangles.of(trimesh.creation.icosphere(subdivisions=4, radius=0.1), np.eye(4))
BOX = Triangles.of(trimesh.creation.box(extents=(0.2, 0.1, 0.3)), np.eye(4))


def test_rays_meet_a_tiled_box_where_they_meet_the_box():
    shape = Shape("box", (0.1, 0.05, 0.15), np.eye(4))
    origins, targets = RNG.uniform(-0.5, 0.5, (500, 3)), RNG.uniform(-0.12, 0.12, (500, 3))
    # Along edges and through corners too.
    origins[:3], targets[:3] = [[1, 0.05, 0.0], [1, 0.05, 0.15], [0, 1, 0]], [[0, 0.05, 0], [0, 0.05, 0.15], [0, 0, 0]]
    outside = (np.abs(origins) > [0.1, 0.05, 0.15]).any(1)
    directions = (targets - origins)[outside]
    found, expected = (cast((one,), origins[outside], directions) for one in (BOX, shape))
    np.testing.assert_allclose(found[0], expected[0], atol=1e-12)
    inside = ~np.isnan(expected[0][:, 0])
    assert 100 < inside.sum() < len(inside)
    # Where faces meet at a right angle each keeps its own normal.
    np.testing.assert_allclose(found[1][3:], expected[1][3:], atol=1e-12)


def test_normals_of_a_smooth_mesh_run_smoothly():
    directions = RNG.standard_normal((300, 3))
    origins = -directions
    points, normals = cast((BALL,), origins, directions)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 0.1, rtol=2e-3)
    assert (normals * points).sum(1).min() > 0.1 * (1 - 2e-3)


def test_the_nearest_point_is_nearer_than_any_other_and_signed():
    points = RNG.uniform(-0.3, 0.3, (300, 3))
    surface, normals, distance = BOX.nearest(points)
    size = np.array([0.1, 0.05, 0.15])
    beyond = np.abs(points) - size
    expected = np.where((beyond > 0).any(1), np.linalg.norm(np.maximum(beyond, 0), axis=1), beyond.max(1))
    np.testing.assert_allclose(distance, expected, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(surface - points, axis=1), np.abs(expected), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)


def test_a_segment_is_blocked_by_what_lies_between_its_ends():
    starts = np.array([[0.2, 0.0, 0.0]] * 4)
    ends = np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0], [0.2, 0.2, 0.2], [-0.2, 0.0, 0.0]])
    assert blocked((BOX,), starts, ends).tolist() == [False, True, False, True]
    # From the surface outward it is free, through the body it is not.
    assert blocked((BOX,), ends[[0, 0]], np.array([[0.3, 0.05, 0.0], [-0.3, 0.0, 0.0]])).tolist() == [False, True]


def test_the_hull_of_a_convex_mesh_is_its_surface():
    bowl = trimesh.creation.icosphere(subdivisions=3, radius=0.1).slice_plane([0, 0, 0.03], [0, 0, -1])
    open_bowl = Triangles.of(bowl, np.eye(4))
    assert open_bowl.border > 0
    assert BOX.border == BOX.hull.border == open_bowl.hull.border == 0
    points = RNG.uniform(-0.3, 0.3, (100, 3))
    np.testing.assert_allclose(BOX.hull.nearest(points)[2], BOX.nearest(points)[2], atol=1e-12)
    # Over the bowl's opening there is a lid.
    assert open_bowl.hull.nearest(np.array([[0.0, 0.0, 0.05]]))[2] == pytest.approx(0.02, abs=2e-3)


def robot(folder, mesh, element="collision", name="head.stl"):
    if mesh is not None:
        mesh.export(folder / name)
    shape = f'<{element}><origin xyz="0.01 0 0"/><geometry><mesh filename="{name}"/></geometry></{element}>'
    path = folder / "r.urdf"
    path.write_text(f'<robot name="r"><link name="head">{shape}</link></robot>', encoding="utf-8")
    return bk.Robot.from_urdf(path)


def test_a_links_mesh_is_its_surface_and_what_is_odd_of_it_is_noted(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.08)
    found = link_surface(robot(tmp_path, ball), "head")
    assert found.notes == ()
    points, _ = cast(found.surface, np.array([[1.0, 0.0, 0.0]]), np.array([[-1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(points, [[0.09, 0.0, 0.0]], atol=1e-6)
    turned = ball.copy()
    turned.invert()
    (surface,) = link_surface(robot(tmp_path, turned), "head").surface
    assert surface.nearest(np.array([[0.2, 0.0, 0.0]]))[1][0, 0] > 0.9
    seen = link_surface(robot(tmp_path, ball, "visual"), "head")
    assert "no collision shape" in seen.notes[0]
    large = link_surface(robot(tmp_path, ball.copy().apply_scale(1000)), "head")
    assert "taken to be in millimetres" in large.notes[0]
    assert np.ptp(large.surface[0].vertices[:, 0]) == pytest.approx(0.16, rel=1e-2)
    opened = ball.copy()
    opened.update_faces(np.arange(len(ball.faces)) > 3)
    assert "is open (" in link_surface(robot(tmp_path, opened), "head").notes[0]
    (tmp_path / "head.stl").unlink()
    with pytest.raises(InvalidGeometry, match=r"mesh 'head\.stl' is not in"):
        link_surface(robot(tmp_path, None), "head")


def test_a_mesh_in_millimetres_is_mended_wherever_it_is_read(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.08)
    ours = robot(tmp_path, ball.copy().apply_scale(1000))
    (corners,) = vertices_of(ours, "head")
    np.testing.assert_allclose(np.ptp(corners, axis=0), 0.16, atol=1e-3)
    (surface,) = link_surface(ours, "head").surface
    np.testing.assert_allclose(np.ptp(surface.vertices, axis=0), np.ptp(corners, axis=0), atol=1e-9)
    seen = link_surfaces(robot(tmp_path, ball.copy().apply_scale(1000), "visual"))["head"]
    np.testing.assert_allclose(np.ptp(seen.corners.reshape(-1, 3), axis=0), 0.16, atol=1e-3)


TWO = """<robot name="r"><link name="hand">
  <visual><geometry><sphere radius="0.05"/></geometry></visual>
  <collision><origin {place}/><geometry><sphere radius="0.05"/></geometry></collision></link></robot>"""


def test_collisions_far_beside_what_is_seen_of_a_link_do_not_stand_for_it():
    slip = bk.Robot.from_urdf(TWO.format(place='xyz="0 1.57 0"'))
    meant = bk.Robot.from_urdf(TWO.format(place='rpy="0 1.57 0"'))
    elements, notes = link_parts(slip, "hand")
    assert elements == slip.geometry["hand"].visuals
    assert "lie 1.47 m beside what is seen of it" in notes[0]
    assert "xyz and rpy exchanged" in notes[0]
    np.testing.assert_allclose(vertices_of(slip, "hand")[0], vertices_of(meant, "hand")[0], atol=0.1)
    assert link_surface(slip, "hand").notes == notes
    assert link_parts(meant, "hand") == (meant.geometry["hand"].collisions, ())
    assert link_parts(bk.Robot.from_urdf(TWO.format(place='xyz="0 0.4 0"')), "hand").notes != ()
    assert link_parts(bk.Robot.from_urdf(TWO.format(place='xyz="0 0.25 0"')), "hand").notes == ()


LIMB = """<link name="{name}"><inertial><mass value="1"/><origin xyz="{mass}"/></inertial>
  <visual><geometry><mesh filename="limb.dae"/></geometry></visual></link>"""


def limbs(folder, mass, said):
    mesh = trimesh.creation.box(extents=(0.06, 0.4, 0.06)).apply_translation([0.0, 0.2, 0.0])
    text = mesh.export(file_type="dae").decode()
    assert "Y_UP" in text
    (folder / "limb.dae").write_text(text.replace("Y_UP", said), encoding="utf-8")
    links = "".join(LIMB.format(name=name, mass=mass) for name in "abc")
    joints = "".join(
        f'<joint name="{one}" type="fixed"><parent link="{one[0]}"/><child link="{one[1]}"/></joint>'
        for one in ("ab", "ac")
    )
    path = folder / "r.urdf"
    path.write_text(f'<robot name="r">{links}{joints}</robot>', encoding="utf-8")
    return bk.Robot.from_urdf(path)


@pytest.mark.parametrize(
    ("mass", "said", "long_axis"),
    [("0 0 0.2", "Y_UP", 2), ("0 0.2 0", "Y_UP", 1), ("0 0 0.2", "Z_UP", 1), ("0 0 0", "Y_UP", 1)],
)
def test_files_with_y_up_are_turned_where_the_masses_say_so_and_never_else(tmp_path, mass, said, long_axis):
    ours = limbs(tmp_path, mass, said)
    (corners,) = vertices_of(ours, "b")
    assert np.ptp(corners, axis=0).argmax() == long_axis
    assert corners.max() == pytest.approx(0.4)
    seen = link_surfaces(ours)["b"].corners.reshape(-1, 3)
    np.testing.assert_allclose(np.ptp(seen, axis=0), np.ptp(corners, axis=0), atol=1e-9)
    found = link_surface(ours, "b")
    np.testing.assert_allclose(found.surface[0].vertices.max(0), corners.max(0), atol=1e-9)
    assert ("is turned" in " ".join(found.notes)) == (long_axis == 2)
