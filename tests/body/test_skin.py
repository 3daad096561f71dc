"""Laws of skins: the taxel grid, and any other."""

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.robot.geometry import Box, Collision, Cylinder, Sphere

BALL = '<collision><geometry><sphere radius="0.07"/></geometry></collision>'
PATCH = {
    "shape": (5, 7), "size": (0.04, 0.06), "centre": (0.1, 0.0, 0.0), "forward": (1.0, 0.0, 0.0),
    "right": (0.0, -1.0, 0.0), "landmarks": {"nose": (2, 3)}, "reference": "nose", "eye": 17,
}  # fmt: skip


def head(shapes=BALL):
    return bk.Robot.from_urdf(f'<robot name="r"><link name="head">{shapes}</link></robot>')


def lay(robot=None, **changed):
    return bk.Skin.grid(robot or head(), "head", **(PATCH | changed))


def test_rows_go_down_and_columns_go_right():
    skin = lay()
    positions = skin.positions.reshape(5, 7, 3).numpy()
    # The robot looks along x with y to its left and z up: right is -y, down is -z.
    np.testing.assert_allclose(skin.down, [0, 0, -1])
    np.testing.assert_allclose(np.diff(positions[..., 2], axis=0), -0.01, atol=1e-15)
    np.testing.assert_allclose(np.diff(positions[..., 1], axis=1), -0.01, atol=1e-15)
    np.testing.assert_allclose(positions[2, 3], [0.07, 0, 0], atol=1e-15)
    assert skin.count == 35
    np.testing.assert_array_equal(
        skin.coordinates(np.array([0, 6, 7, 17, 34])), [[0, 0], [0, 6], [1, 0], [2, 3], [4, 6]]
    )


def test_taxels_lie_on_the_shape_and_normals_point_outward():
    skin = lay()
    torch.testing.assert_close(skin.positions.norm(dim=1), torch.full((35,), 0.07, dtype=torch.float64))
    torch.testing.assert_close(skin.normals, skin.positions / 0.07)


def test_a_moved_link_moves_its_taxels(body):
    skin = body.skin
    np.testing.assert_allclose(
        np.linalg.norm(skin.link_positions - skin.surface[0].link_T_shape[:3, 3], axis=1), 0.0724
    )
    pose = body.kinematics.pose(body.felt_home, skin.link)
    torch.testing.assert_close(skin.root_T_link, pose)
    moved = torch.from_numpy(skin.link_positions) @ pose[:3, :3].T + pose[:3, 3]
    torch.testing.assert_close(skin.positions, moved)
    np.testing.assert_allclose(skin.link_normals @ pose[:3, :3].numpy().T, skin.normals.numpy(), atol=1e-15)


def test_whole_coordinates_are_taxels_and_halves_lie_between():
    skin = lay()
    points, normals = skin.surface_at(skin.coordinates(np.arange(35)))
    np.testing.assert_allclose(points, skin.link_positions, atol=1e-15)
    np.testing.assert_allclose(normals, skin.link_normals, atol=1e-15)
    between, _ = skin.surface_at(np.array([[2.0, 2.5]]))
    np.testing.assert_allclose(between[0, 1:], [0.005, 0.0], atol=1e-15)


def test_a_patch_larger_than_the_face_is_refused():
    with pytest.raises(InvalidConfig, match=r"taxels find no surface of link 'head'.*make 'size' smaller"):
        lay(size=(0.2, 0.2))
    with pytest.raises(InvalidConfig, match="35 of 35 taxels"):
        lay(centre=(-0.1, 0.0, 0.0))


def test_one_taxel_is_a_skin_too():
    skin = lay(shape=(1, 1), landmarks=None, reference=None, eye=None)
    assert skin.touched(skin.link_positions + 0.02 * skin.link_normals, 0.02).tolist() == [0]


def test_the_taxel_under_the_hand_is_touched_and_nothing_beside_the_patch():
    skin, radius = lay(), 0.02
    centres = skin.link_positions + radius * skin.link_normals
    np.testing.assert_array_equal(skin.touched(centres, radius), np.arange(35))
    # On the surface, a little towards the next taxel.
    points, normals = skin.surface_at(skin.coordinates(np.arange(35)) + np.array([0.4, -0.4]) * 0.9)
    there = ~np.isnan(points[:, 0])
    np.testing.assert_array_equal(skin.touched(points + radius * normals, radius)[there], np.arange(35)[there])
    # Beyond the border by a whole step.
    points, normals = skin.surface_at(np.array([[-1.0, 3.0], [5.0, 3.0], [2.0, -1.0], [2.0, 7.0]]))
    np.testing.assert_array_equal(skin.touched(points + radius * normals, radius), -1)
    # In front by more than the tolerance, and nowhere at all.
    np.testing.assert_array_equal(skin.touched(centres + 0.0009 * skin.link_normals, radius), np.arange(35))
    np.testing.assert_array_equal(skin.touched(centres + 0.0011 * skin.link_normals, radius), -1)
    np.testing.assert_array_equal(skin.touched(np.full((3, 3), np.nan), radius), -1)
    np.testing.assert_array_equal(skin.touched(np.zeros((0, 3)), radius), np.zeros(0))


def test_a_grid_lies_on_a_stated_shape_without_any_of_the_links_own():
    on = {"sphere": Sphere(0.07), "cylinder": Collision(Cylinder(0.07, 0.2)), "box": Box((0.14, 0.2, 0.2))}
    skins = {name: lay(head(""), on=shape) for name, shape in on.items()}
    np.testing.assert_allclose(skins["sphere"].positions, lay().positions, atol=1e-15)
    np.testing.assert_allclose(np.hypot(*skins["cylinder"].positions.numpy().T[:2]), 0.07)
    np.testing.assert_allclose(skins["box"].positions[:, 0], 0.07)
    raised = lay(head(""), on=Collision(Sphere(0.07), xyz=(0.01, 0.0, 0.0)))
    np.testing.assert_allclose(raised.positions[17], [0.08, 0.0, 0.0], atol=1e-15)


def test_a_ray_that_misses_finds_the_nearest_place_and_where_there_is_none_the_grid_has_a_hole():
    wide = lay(shape=(9, 9), size=(0.144, 0.144), landmarks={"nose": (4, 4)}, eye=None)
    assert wide.shape is None
    assert wide.count < 81
    assert "have no taxel" in wide.notes[-1]
    mask = wide.mask
    assert mask.sum() == wide.count
    assert not mask[0, 0]
    assert mask[4].all(), "2 mm beyond the rim, less than half a step"
    assert "pass beside" in wide.notes[0]
    np.testing.assert_allclose(wide.positions.norm(dim=1), 0.07, rtol=1e-12)
    assert wide.landmarks["nose"] == mask.ravel()[:40].sum()
    # Its taxels know their neighbours across no hole.
    ends = wide.link_positions[wide.neighbours]
    step = np.linalg.norm((ends[:, 0] - ends[:, 1])[:, 1:], axis=1)
    assert step.max() < 0.0181
    with pytest.raises(InvalidConfig, match="where the grid has a hole"):
        lay(shape=(9, 9), size=(0.144, 0.144), landmarks={"ear": (0, 0)}, reference=None, eye=None)


ANGLES = np.stack(np.meshgrid(np.linspace(-0.5, 0.5, 6), np.linspace(-0.9, 0.9, 10)), -1).reshape(-1, 2)
PLACES = 0.07 * np.stack(
    [np.cos(ANGLES[:, 0]) * np.cos(ANGLES[:, 1]), np.cos(ANGLES[:, 0]) * np.sin(ANGLES[:, 1]), np.sin(ANGLES[:, 0])], 1
)


def test_points_get_normals_a_graph_and_a_frame():
    skin = bk.Skin.points(PLACES, link="head")
    assert skin.count == 60
    assert (skin.link_normals * PLACES).sum(1).min() > 0.07 * 0.9
    np.testing.assert_allclose(np.linalg.norm(skin.link_normals, axis=1), 1.0)
    away = np.linalg.norm(PLACES[:, None] - PLACES, axis=-1)
    np.fill_diagonal(away, np.inf)
    spacing = np.median(away.min(1))
    assert skin.spacing == pytest.approx(spacing)
    assert {tuple(edge) for edge in skin.neighbours} == {(i, j) for i, j in np.argwhere(away < 2 * spacing) if i < j}
    assert skin.forward[0] > 0.9
    np.testing.assert_allclose([skin.right @ skin.forward, skin.right[2]], 0.0, atol=1e-12)
    assert skin.down[2] < 0
    assert skin.shape is None
    assert skin.mask is None


def test_what_can_be_mended_is_mended_and_noted_and_the_rest_refused_in_one_line():
    normals = PLACES / 0.07
    normals[3], normals[4] = 0.0, 0.5 * normals[4]
    doubled = np.concatenate([PLACES, PLACES[:1], [[0.5, 0.0, 0.0]]])
    skin = bk.Skin.points(PLACES, normals, link="head")
    assert "taxels 3 have no direction" in skin.notes[0]
    assert "not of length 1 (0.5 to 1)" in skin.notes[1]
    np.testing.assert_allclose(np.linalg.norm(skin.link_normals, axis=1), 1.0)
    notes = " ".join(bk.Skin.points(doubled, link="head").notes)
    assert "1 places bear more than one taxel, first of each 0" in notes
    assert "taxels 61 have no neighbour" in notes
    for positions, match in (
        (np.zeros((0, 3)), r"positions have shape \(0, 3\)"),
        (PLACES[:, :2], r"give \(taxels, 3\)"),
        (np.where(np.arange(60)[:, None] == 5, np.nan, PLACES), "taxels 5 have no place"),
    ):
        with pytest.raises(InvalidConfig, match=match):
            bk.Skin.points(positions, link="head")
    for settings, match in (
        ({"neighbours": [[0, 60]]}, "pairs of two different taxels, 0 to 59"),
        ({"neighbours": [[1, 1]]}, "pairs of two different taxels"),
        ({"normals": normals[:4]}, r"give \(60, 3\)"),
        ({"ids": np.zeros(60, int)}, "name a taxel twice"),
        ({"reference": 60}, "reference=60"),
        ({"landmarks": {"nose": -1}}, "landmark 'nose'=-1"),
        ({"forward": (0.0, 0.0, 0.0)}, "orthogonal and not zero"),
    ):
        with pytest.raises(InvalidConfig, match=match):
            bk.Skin.points(PLACES, link="head", **settings)


def test_makers_numbers_lead_to_taxels():
    skin = bk.Skin.points(PLACES[:3], link="head", ids=[12, 7, 300])
    np.testing.assert_array_equal(skin.taxels_of([[7, 12], [300, 8]]), [[1, 0], [2, -1]])
    np.testing.assert_array_equal(bk.Skin.points(PLACES[:3], link="head").taxels_of([2, 3, -1]), [2, -1, -1])


def test_distances_on_a_grid_are_in_its_units_and_elsewhere_along_the_graph_in_spacings():
    grid = lay()
    assert grid.distances[0, 8] == pytest.approx(np.sqrt(2))
    ring = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0, 2 * np.pi, 12, endpoint=False)])
    skin = bk.Skin.points(ring, ring, [(i, i + 1) for i in range(11)], link="head", forward=(1, 0, 0), right=(0, -1, 0))
    np.testing.assert_allclose(skin.distances[0], np.arange(12), rtol=1e-12)
    assert skin.way(2, 5) == [2, 3, 4, 5]
    apart = bk.Skin.points(
        ring, ring, [(i, i + 1) for i in range(11) if i != 5], link="head", forward=(1, 0, 0), right=(0, -1, 0)
    )
    assert apart.pieces == 2
    assert apart.distances[0, 6] == pytest.approx(2.0 / skin.spacing)
    assert apart.way(0, 6) == [0, 6]
