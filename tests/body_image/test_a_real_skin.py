"""A real NAO touches its torso: what direct sight of the hand makes of 250 real taxels, in under twenty lines.

Data of Rustler, Potocna, Polic, Stepanova and Hoffmann (2021). The nine numbers of hand and mount were fitted to the
same touches before; postures and active taxels are as the robot recorded them.
"""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
import scipy.io
import torch
from scipy.spatial.transform import Rotation

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.body import read_nao_taxels

ROWS = [
    (0, 0.1, -pi / 2, 0), (0, -0.098, pi / 2, 0), (-0.015, 0, pi / 2, pi / 2), (0, 0.105, -pi / 2, 0),
    (0, 0, pi / 2, 0), (0, 0.1137, -pi / 2, pi),
]  # fmt: skip
JOINTS = ["RShoulderPitch", "RShoulderRoll", "RElbowYaw", "RElbowRoll", "RWristYaw"]
PATCHES = [(*range(6), *range(8, 16)), (16, 17, 18, *range(24, 32))]
TIP, MOUNT = (0.00401, 0.01012, 0.06743), (0.06499, -0.00450, 0.05428, -0.01016, 0.09280, 0.02836)


@pytest.mark.real_data
def test_direct_sight_maps_the_torso_of_a_real_robot(real_data):
    records = scipy.io.loadmat(real_data / "nao" / "torso_rightFinger.mat", simplify_cells=True)["torso"]
    robot = bk.Robot.from_dh(ROWS, joints=["shoulder", *JOINTS], name="nao")
    mount = np.eye(4)
    mount[:3, :3], mount[:3, 3] = Rotation.from_rotvec(MOUNT[3:]).as_matrix(), MOUNT[:3]
    table = read_nao_taxels(real_data / "nao" / "Transformations" / "torso.txt", PATCHES)
    skin = table.skin(robot.root, mount)
    # The paper's virtual eye, 4 cm behind the rearmost taxel.
    middle = skin.link_positions.mean(0)
    behind = middle + (((skin.link_positions - middle) @ skin.forward).min() - 0.04) * skin.forward
    eye = np.eye(4)
    eye[:3] = np.stack([skin.right, skin.down, skin.forward, behind], axis=1)
    body = bk.Embodiment.build(
        robot,
        joints=JOINTS,
        hand=bk.Hand(robot.link_names[-1], offset=TIP),
        camera=bk.Camera(robot.root, eye, bk.VirtualScreen(0.1, near=0.01)),
        skin=skin,
    )
    touched = [[t for t in skin.taxels_of(np.atleast_1d(one["activatedTaxels"])) if t >= 0] for one in records]
    q = [[one["angles"][joint] for joint in JOINTS] for one in records]
    touches = bk.recording(q=q, touched=touched, joints=JOINTS, order="scattered")
    sight = body.hand_image(touches.q.values).numpy()
    maps = bk.BodyImage.learn(touches, sight, skin=skin, steps=8000)
    true = body.camera.model.project(torch.from_numpy((skin.link_positions - behind) @ eye[:3, :3])).numpy()
    found = metrics.scores(maps.tactile_map, true, maps.touch_counts > 0)
    assert len(records) == 1075
    assert skin.count == 250
    assert (maps.touch_counts > 0).sum() == 156
    away = [
        np.linalg.norm(point - skin.link_positions[felt].mean(0))
        for point, felt in zip(body.hand_in_skin(touches.q.values[0]).numpy(), touched, strict=True)
    ]
    assert np.median(away) == pytest.approx(2.8e-3, abs=0.1e-3)
    assert found["disparity"] <= 0.02
    assert found["neighbours_kept"] >= 0.70
    chance = []
    for seed in range(5):
        dealt = metrics.shuffled_touches(touches.touched.values, seed)
        shuffled = touches.assign(touched=(touches.touched.dims, dealt))
        one = bk.BodyImage.learn(shuffled, sight, skin=skin, steps=8000, seed=seed)
        chance.append(metrics.scores(one.tactile_map, true, one.touch_counts > 0))
    assert np.mean([one["disparity"] for one in chance]) == pytest.approx(0.91, abs=0.06)
    assert np.mean([one["neighbours_kept"] for one in chance]) == pytest.approx(0.18, abs=0.03)
    # Gamma that stays at 40, the paper's, draws the map together while its order seems perfect.
    wide = bk.BodyImage.learn(touches, sight, skin=skin, steps=8000, gamma_final=40.0)
    assert metrics.scores(wide.tactile_map, true, wide.touch_counts > 0)["scale"] < 0.75 < found["scale"]
