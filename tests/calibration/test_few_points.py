"""What little evidence must not turn over: a tracker that saw one plane, candidates that differ by a joint."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.calibration import Observed
from bodyimage_kin.calibration.problem import _Rows, _tracker
from bodyimage_kin.robot import transforms


@pytest.mark.parametrize("seed", range(8))
def test_a_tracker_of_three_points_is_never_a_mirror(body, seed):
    rng = np.random.default_rng(seed)
    q = body.felt_robot.sample(3, seed=seed).numpy()
    offset = np.zeros((3, 3))
    root_T_tracker = transforms.transform(transforms.rpy_matrix(rng.uniform(-3, 3, 3).tolist()), rng.uniform(-1, 1, 3))
    places = body.kinematics.pose(torch.from_numpy(q), body.hand.link).numpy()[:, :3, 3]
    values = (places - root_T_tracker[:3, 3]) @ root_T_tracker[:3, :3]
    # Of the recording they came from nothing is asked.
    seen = Observed(bk.recording(q, hand_position=values, joints=body.joints, order="scattered"))
    found = _tracker(body, _Rows("points", seen, np.arange(3), q, values, offset))
    np.testing.assert_allclose(found, root_T_tracker, atol=1e-9)


def test_candidates_that_differ_by_one_joint_are_apart(body):
    candidates = np.tile(body.felt_home.numpy(), (7, 1))
    candidates[:, 3] += np.linspace(-0.15, 0.15, 7)
    found = bk.next_postures(body, None, bk.probes.JointSpace(10), 3, candidates=candidates, apart=0.04)
    assert np.diff(np.sort(found.q[:, 3])).min() > 0.04
