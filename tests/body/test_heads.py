"""Heads of humanoids that exist carry a 21 x 21 grid, laid on the very meshes of their descriptions."""

import sysconfig
from pathlib import Path

import numpy as np
import pytest

import bodyimage_kin as bk

ROBOTS = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
# The visor of G1 and the face of iCub are parts of their own that the files do not have: the skin lies above them.
HEADS = {
    "g1_description/urdf/g1_29dof_rev_1_0.urdf": {
        "link": "head_link", "size": (0.04, 0.08), "centre": (0.2, 0.0, 0.484), "forward": (1.0, 0.0, 0.0),
        "right": (0.0, -1.0, 0.0),
    },
    "talos_data/robots/talos_reduced.urdf": {
        "link": "head_2_link", "size": (0.119, 0.109), "centre": (0.3, 0.0, 0.1824), "forward": (1.0, 0.0, 0.0),
        "right": (0.0, -1.0, 0.0),
    },
    "icub_description/robots/icub.urdf": {
        "link": "head", "size": (0.016, 0.06), "centre": (-0.3, -0.088, 0.0), "forward": (-1.0, 0.0, 0.0),
        "right": (0.0, 0.0, 1.0),
    },
    "romeo_description/urdf/romeo.urdf": {
        "link": "HeadRollLink", "size": (0.072, 0.062), "centre": (0.3, 0.0, 0.0273), "forward": (1.0, 0.0, 0.0),
        "right": (0.0, -1.0, 0.0),
    },
}  # fmt: skip


@pytest.mark.parametrize("file", HEADS, ids=lambda file: file.partition("/")[0])
def test_the_head_of_a_humanoid_carries_a_grid(file):
    if not (ROBOTS / file).is_file():
        pytest.skip("no robots here: example-robot-data is not installed; pip install 'bodyimage-kin[robots]'")
    skin = bk.Skin.grid(bk.Robot.from_urdf(ROBOTS / file), **HEADS[file])
    assert skin.shape == (21, 21)
    assert skin.count == 441
    assert (skin.link_normals @ skin.forward).min() > 0.0
    # One side of one head: neighbours are near each other.
    ends = skin.link_positions[skin.neighbours]
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).max() < 0.02
