"""A real humanoid touches its own chest: without any eye it knows where its finger is to less than half a taxel.

Data of Rustler, Potocna, Polic, Stepanova and Hoffmann (2021).
"""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
import scipy.io

import bodyimage_kin as bk
from bodyimage_kin.body import Skin
from bodyimage_kin.calibration import Observed, calibrate

ROWS = [
    (0, 0.1, -pi / 2, 0), (0, -0.098, pi / 2, 0), (-0.015, 0, pi / 2, pi / 2), (0, 0.105, -pi / 2, 0),
    (0, 0, pi / 2, 0), (0, 0.1137, -pi / 2, pi),
]  # fmt: skip
"""The right arm, its elbow's offset where the public URDF has it; the first row is the shoulder, which is fixed."""
JOINTS = ["RShoulderPitch", "RShoulderRoll", "RElbowYaw", "RElbowRoll", "RWristYaw"]
PATCHES = ([*range(6), *range(8, 16)], [16, 17, 18, *range(24, 32)])
PADS = (6, 10)


def places(path):
    """(384, 3) place of each taxel in the skin's own frame [m]; NaN of those that are none."""
    rows = np.loadtxt(path)
    mounted = [triangle for patch in PATCHES for triangle in patch]
    found = np.full((384, 3), np.nan)
    for place, triangle in enumerate(sorted(mounted)):
        at = mounted.index(triangle)
        origin = rows[0] + rows[1 + (at >= len(PATCHES[0]))] + rows[3 + at]
        taxels = [12 * triangle + number for number in range(12) if number not in PADS]
        found[taxels] = origin + rows[3 + len(mounted) + 10 * place :][:10]
    return found


@pytest.mark.real_data
@pytest.mark.slow
def test_an_arm_that_touched_its_chest(real_data):
    positions = places(real_data / "nao" / "Transformations" / "torso.txt")
    taxel = np.cumsum(np.isfinite(positions[:, 0])) - 1
    robot = bk.Robot.from_dh(ROWS, joints=["shoulder", *JOINTS], name="nao")
    skin = Skin.points(positions[np.isfinite(positions[:, 0])], link=robot.root)
    mount = np.eye(4)
    mount[:3, 3] = 0.0646, 0.0006, 0.0468
    body = bk.Embodiment.build(
        robot,
        joints=JOINTS,
        # The centre of the finger's tip is what touches.
        hand=bk.Hand(robot.link_names[-1], offset=(0, 0, 0.06), radius=1e-9),
        camera=bk.Camera(robot.root, np.eye(4), bk.Tracker()),
        skin=skin.moved(mount),
        home={},
    )
    records = scipy.io.loadmat(real_data / "nao" / "torso_rightFinger.mat", simplify_cells=True)["torso"]
    exp = bk.recording(
        q=[[one["angles"][joint] for joint in JOINTS] for one in records],
        touched=[
            [int(taxel[i]) for i in np.atleast_1d(one["activatedTaxels"]) if np.isfinite(positions[i, 0])]
            for one in records
        ],
        joints=JOINTS,
        order="scattered",
    )
    fit = calibrate(body, Observed(exp, use=["touches"]), free="auto")
    before, after = (1e3 * one.medians[0] for one in (fit.nominal, fit.held_out))
    print(f"median of what was held out [mm]: as drawn {before:.2f}, calibrated {after:.2f} with {fit.free} numbers")
    assert before > 10
    # The finger's tip and where the skin is mounted suffice; half a taxel's spacing is 3.2 mm.
    assert fit.groups == ("hand", "skin")
    assert after < 3.0
