"""Laws of the taxel grid."""

import dataclasses

import numpy as np
import pytest
import torch

from bodyimage_kin.body.skin import Patch, Skin
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.robot.shapes import Shape

SPHERE = Shape("sphere", (0.07,), np.eye(4))
PATCH = Patch((5, 7), (0.04, 0.06), np.array([0.1, 0.0, 0.0]), np.array([1.0, 0, 0]), np.array([0.0, -1.0, 0.0]))


def lay(patch=PATCH, shapes=(SPHERE,)):
    return Skin.lay("head", patch, shapes, torch.eye(4, dtype=torch.float64), {"nose": 17}, 17, 17)


def test_rows_go_down_and_columns_go_right():
    skin = lay()
    positions = skin.positions.reshape(5, 7, 3).numpy()
    # The robot looks along x with y to its left and z up: right is -y, down is -z.
    np.testing.assert_allclose(PATCH.down, [0, 0, -1])
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
    np.testing.assert_allclose(np.linalg.norm(skin.link_positions - skin.shapes[0].link_T_shape[:3, 3], axis=1), 0.0724)
    pose = body.kinematics.pose(body.felt_home, skin.link)
    torch.testing.assert_close(skin.root_T_link, pose)
    moved = torch.from_numpy(skin.link_positions) @ pose[:3, :3].T + pose[:3, 3]
    torch.testing.assert_close(skin.positions, moved)
    np.testing.assert_allclose(skin.link_normals @ pose[:3, :3].numpy().T, skin.normals.numpy(), atol=1e-15)


def test_whole_coordinates_are_taxels_and_halves_lie_between():
    skin = lay()
    points, normals = skin.surface(skin.coordinates(np.arange(35)))
    np.testing.assert_allclose(points, skin.link_positions, atol=1e-15)
    np.testing.assert_allclose(normals, skin.link_normals, atol=1e-15)
    between, _ = skin.surface(np.array([[2.0, 2.5]]))
    np.testing.assert_allclose(between[0, 1:], [0.005, 0.0], atol=1e-15)


def test_a_patch_larger_than_the_face_is_refused():
    with pytest.raises(InvalidConfig, match=r"taxels find no surface of link 'head'.*make 'size' smaller"):
        lay(dataclasses.replace(PATCH, size=(0.2, 0.2)))
    with pytest.raises(InvalidConfig, match="35 of 35 taxels"):
        lay(dataclasses.replace(PATCH, centre=np.array([-0.1, 0.0, 0.0])))


def test_one_taxel_is_a_skin_too():
    skin = lay(dataclasses.replace(PATCH, shape=(1, 1)))
    assert skin.touched(skin.link_positions + 0.02 * skin.link_normals, 0.02).tolist() == [0]


def test_the_taxel_under_the_hand_is_touched_and_nothing_beside_the_patch():
    skin, radius = lay(), 0.02
    centres = skin.link_positions + radius * skin.link_normals
    np.testing.assert_array_equal(skin.touched(centres, radius), np.arange(35))
    # On the surface, a little towards the next taxel.
    points, normals = skin.surface(skin.coordinates(np.arange(35)) + np.array([0.4, -0.4]) * 0.9)
    there = ~np.isnan(points[:, 0])
    np.testing.assert_array_equal(skin.touched(points + radius * normals, radius)[there], np.arange(35)[there])
    # Beyond the border by a whole step.
    points, normals = skin.surface(np.array([[-1.0, 3.0], [5.0, 3.0], [2.0, -1.0], [2.0, 7.0]]))
    np.testing.assert_array_equal(skin.touched(points + radius * normals, radius), -1)
    # In front by more than the tolerance, and nowhere at all.
    np.testing.assert_array_equal(skin.touched(centres + 0.0009 * skin.link_normals, radius), np.arange(35))
    np.testing.assert_array_equal(skin.touched(centres + 0.0011 * skin.link_normals, radius), -1)
    np.testing.assert_array_equal(skin.touched(np.full((3, 3), np.nan), radius), -1)
    np.testing.assert_array_equal(skin.touched(np.zeros((0, 3)), radius), np.zeros(0))
