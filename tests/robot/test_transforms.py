"""Laws of rotations written in other words: what is read back is the same rotation, to rounding, everywhere."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bodyimage_kin.robot import transforms

PITCHES = [0.0, 1.0, *(side * (math.pi / 2 - off) for side in (1, -1) for off in (0.0, 1e-16, 1e-12, 1e-8, 1e-4))]


@pytest.mark.parametrize("pitch", PITCHES)
def test_roll_pitch_and_yaw_give_the_rotation_back_where_two_axes_fall_together_too(pitch):
    rng = np.random.default_rng(0)
    for roll, yaw in [*rng.uniform(-math.pi, math.pi, (40, 2)), (0.0, 0.0), (math.pi, -math.pi)]:
        rotation = transforms.rpy_matrix((roll, pitch, yaw))
        # As a product it has rounding of its own, of which the textbook's quotient of two zeros makes any angle.
        before = transforms.rpy_matrix((0.3, 0.4, 0.5))
        for one in (rotation, before @ (before.T @ rotation)):
            again = transforms.rpy_matrix(transforms.matrix_rpy(one))
            np.testing.assert_allclose(again, one, rtol=0, atol=2e-15)


def test_a_quaternion_of_any_length_is_the_turn_about_its_axis():
    rng = np.random.default_rng(1)
    for axis, angle in zip(rng.normal(size=(20, 3)), rng.uniform(-math.pi, math.pi, 20), strict=True):
        axis = axis / np.linalg.norm(axis)
        xyzw = 3.7 * np.array([*(math.sin(angle / 2) * axis), math.cos(angle / 2)])
        expected = transforms.axis_angle_matrix(axis.tolist(), angle)
        np.testing.assert_allclose(transforms.quaternion_matrix(xyzw.tolist()), expected, rtol=0, atol=1e-15)
