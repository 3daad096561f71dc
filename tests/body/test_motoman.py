"""A real robot seen by real cameras: Denavit and Hartenberg's rows, pixels and markers, through the public face."""

import math

import numpy as np
import pytest
import scipy.io

import bodyimage_kin as bk
from bodyimage_kin.robot.transforms import rpy_matrix, transform

QUARTER, TILT = math.pi / 2, math.radians(15.0)
EYES = {
    1: (
        [(0.0741, 1.8034, -2.5086, -2.7753), (0.0, -0.5670, 0.0, 0.2863)],
        bk.Pinhole(8185.397, 8170.401, 2009.318, 2963.960, distortion=(-0.021, -0.206, -0.002, -0.001, 0.719)),
    ),
    2: (
        [(0.2315, 1.8602, 2.5486, 0.0860), (0.0, -0.4982, 0.0, -3.0618)],
        bk.Pinhole(8110.478, 8098.218, 1949.921, 2991.727, distortion=(-0.023, -0.213, -0.001, -0.001, 0.662)),
    ),
}
# Centres of the faces of the icosahedron at the end effector: five of a ring at each of four heights [m].
FACES = """
.0320 0 -.04189  .00989 .03043 -.04189  -.02589 .01881 -.04189  -.02589 -.01881 -.04189  .00989 -.03043 -.04189
.05178 0 -.00989  .016 .04924 -.00989  -.04189 .03043 -.00989  -.04189 -.03043 -.00989  .016 -.04924 -.00989
.04189 -.03043 .00989  .04189 .03043 .00989  -.016 .04924 .00989  -.05178 0 .00989  -.016 -.04924 .00989
.02589 -.01881 .04189  .02589 .01881 .04189  .00989 .03043 .04189  -.0320 0 .04189  .00989 -.03043 .04189
"""
JOINTS = ("E", "S", "L", "U", "R", "B", "T")


def row_transform(a, d, alpha, offset):
    """One classic row at zero."""
    turned = transform(rpy_matrix((0.0, 0.0, offset)), (0.0, 0.0, d))
    return turned @ transform(rpy_matrix((alpha, 0.0, 0.0)), (a, 0.0, 0.0))


def body(arm, eye):
    """One arm of the robot and one of its eyes, both carried by the external axis."""
    rows = [
        (0.0, -0.263, TILT if arm == 1 else -TILT, -QUARTER),
        (0.150, 1.4159, -QUARTER, 0.0),
        (0.614, 0.0, math.pi, -QUARTER),
        (0.200, 0.0, -QUARTER, 0.0),
        (0.0, -0.640, QUARTER, 0.0),
        (0.030, 0.0, QUARTER, -QUARTER),
        (0.0, 0.200, 0.0, 0.0),
        (0.0, 0.354, 0.0, 0.0),
    ]
    robot = bk.Robot.from_dh(rows, kinds=["revolute"] * 7 + ["fixed"], joints=(*JOINTS, "flange"))
    chain, lens = EYES[eye]
    pose = row_transform(*chain[0]) @ row_transform(*chain[1])
    return bk.Embodiment.build(robot, joints=JOINTS, hand=bk.Hand("link8"), camera=bk.Camera("E_turned", pose, lens))


def pixel_errors(real_data, name, arm, eye):
    data = scipy.io.loadmat(real_data / "motoman" / f"no_leica_{name}_dataset.mat", simplify_cells=True)["dataset"]
    data = data[(data[:, 2] == arm) & (data[:, 3] == eye)]
    q = data[:, [6, *(range(7, 13) if arm == 1 else range(13, 19))]]
    marker = np.array(FACES.split(), dtype=float).reshape(20, 3)[data[:, 1].astype(int) - 1]
    seen = body(arm, eye).hand_image(q, hand_offset=marker, on_invisible="nan").numpy()
    return np.linalg.norm(seen - data[:, 4:6], axis=1)


@pytest.mark.real_data
@pytest.mark.parametrize("eye", [1, 2])
@pytest.mark.parametrize(
    ("name", "arm"),
    [("higher_table1_5x5", 1), ("wall_table1_5x5", 1), ("self_lower1_4x4", 1), ("self_lower1_4x4", 2)],
)
def test_the_nominal_robot_sees_its_markers_within_what_its_makers_left_open(real_data, name, arm, eye):
    errors = pixel_errors(real_data, name, arm, eye)
    assert len(errors) > 400
    # 13 to 22 px, of images of 4,000 x 6,000: an axis, a sign or a coefficient astray gives hundreds.
    assert 12.0 < float(np.median(errors)) < 23.0
    assert float(np.quantile(errors, 0.9)) < 45.0
