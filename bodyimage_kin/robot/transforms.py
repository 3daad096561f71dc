"""Rigid transforms in numpy, for what is computed once: reading robots, welding joints, placing cameras."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

__all__ = [
    "Matrix3",
    "Matrix4",
    "Vector",
    "axis_angle_matrix",
    "matrix_rpy",
    "quaternion_matrix",
    "rpy_matrix",
    "transform",
]

Vector = tuple[float, float, float]
Matrix3 = Float[np.ndarray, "3 3"]
Matrix4 = Float[np.ndarray, "4 4"]


def rpy_matrix(rpy: Sequence[float]) -> Matrix3:
    """Rotation of fixed-axis roll, pitch, yaw [rad], as URDF defines them: ``Rz(yaw) Ry(pitch) Rx(roll)``."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def matrix_rpy(rotation: Matrix3) -> tuple[float, float, float]:
    """Roll, pitch, yaw [rad] of a rotation; the three fit together to rounding even at pitch = 90 degrees."""
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-rotation[2, 0], c * rotation[0, 0] + s * rotation[1, 0])
    # With yaw known, roll follows from the two columns that remain, where the textbook formula divides zero by zero.
    roll = np.arctan2(s * rotation[0, 2] - c * rotation[1, 2], c * rotation[1, 1] - s * rotation[0, 1])
    return float(roll), float(pitch), float(yaw)


def quaternion_matrix(xyzw: Sequence[float]) -> Matrix3:
    """Rotation of a quaternion (x, y, z, w) of any length but zero."""
    x, y, z, w = np.asarray(xyzw, dtype=np.float64) / math.hypot(*xyzw)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def axis_angle_matrix(axis: Sequence[float], angle: float) -> Matrix3:
    """Rotation by ``angle`` [rad] about the unit vector ``axis`` (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross))


def transform(rotation: Matrix3, translation: Sequence[float] | Float[np.ndarray, "3"]) -> Matrix4:
    """The 4x4 transform of a rotation and a translation [m]."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = translation
    return matrix
