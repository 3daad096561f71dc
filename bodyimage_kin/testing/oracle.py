"""An analytic oracle in plain numpy, which works from the spec of a robot and knows no URDF library.

It writes the pose as a product of matrices and differentiates that product factor by factor, instead of using the
cross products that kinematics libraries use: ``dT/dq_k = A (dM_k/dq_k) B``, and the twist is read off ``dT T^-1``.
Slow and plain on purpose.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from bodyimage_kin.testing._spec import Case, JointSpec, Vector

__all__ = ["Truth", "oracle"]

_Matrix = Float[np.ndarray, "4 4"]


class Truth(NamedTuple):
    """What the oracle says about a case, in ``local_world_aligned``.

    Attributes:
        pose: root_T_link (4, 4).
        jacobian: (6, n), rows linear then angular.
        hessian: (6, n, n); [:, i, k] is the derivative of column i by q[k].
    """

    pose: _Matrix
    jacobian: Float[np.ndarray, "6 n"]
    hessian: Float[np.ndarray, "6 n n"]


def oracle(case: Case) -> Truth:
    """Pose, Jacobian and hessian of a case, followers folded into what they follow.

    Args:
        case: The robot, the posture and the link.
    """
    folded = {joint.name: (k, multiplier, offset) for joint, k, multiplier, offset in case.robot.folded(case.link)}
    # Each moving joint's factor and its first two derivatives; fixed transforms go into what comes before.
    before, factors, moved = [np.eye(4)], [], []
    for joint in case.robot.path(case.link):
        before[-1] = before[-1] @ _origin(joint)
        if joint.kind != "fixed":
            k, multiplier, offset = folded[joint.name]
            factors.append(_motion(joint, multiplier * case.q[k] + offset))
            moved.append((k, multiplier))
            before.append(np.eye(4))

    def product(*derived: int) -> _Matrix:
        """The pose with the factors named differentiated, once for every time they are named."""
        result = before[0]
        for index, (factor, constant) in enumerate(zip(factors, before[1:], strict=True)):
            result = result @ factor[derived.count(index)] @ constant
        return result

    pose = product()
    to_root = pose[:3, :3].T
    n, count = case.robot.n, len(factors)
    jacobian, hessian = np.zeros((6, n)), np.zeros((6, n, n))
    first = [product(index) for index in range(count)]
    for i, (column, gain) in enumerate(moved):
        jacobian[:, column] += gain * _twist(first[i], first[i][:3, :3] @ to_root)
        for k, (by, gain_by) in enumerate(moved):
            second = product(i, k)
            # d (dR R^T) = d2R R^T + dR_i dR_k^T
            spin = second[:3, :3] @ to_root + first[i][:3, :3] @ first[k][:3, :3].T
            hessian[:, column, by] += gain * gain_by * _twist(second, spin)
    return Truth(pose, jacobian, hessian)


def _twist(derivative: _Matrix, spin: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "6"]:
    """Linear part from the last column of a pose's derivative, angular from a skew-symmetric matrix."""
    turn = (spin[2, 1] - spin[1, 2], spin[0, 2] - spin[2, 0], spin[1, 0] - spin[0, 1])
    return np.concatenate([derivative[:3, 3], np.array(turn) / 2.0])


def _origin(joint: JointSpec) -> _Matrix:
    """The fixed transform of a joint: roll about x first, then pitch about y, then yaw about z, all of the parent."""
    matrix = np.eye(4)
    for axis, angle in enumerate(joint.rpy or (0.0, 0.0, 0.0)):
        turn = np.eye(4)
        a, b = (axis + 1) % 3, (axis + 2) % 3
        turn[a, a] = turn[b, b] = math.cos(angle)
        turn[b, a], turn[a, b] = math.sin(angle), -math.sin(angle)
        matrix = turn @ matrix
    matrix[:3, 3] = joint.xyz or (0.0, 0.0, 0.0)
    return matrix


def _motion(joint: JointSpec, value: float) -> tuple[_Matrix, _Matrix, _Matrix]:
    """The transform of a joint's motion and its first and second derivative."""
    axis = _unit(joint.axis or (1.0, 0.0, 0.0))
    motion, first, second = np.eye(4), np.zeros((4, 4)), np.zeros((4, 4))
    if joint.kind == "prismatic":
        motion[:3, 3], first[:3, 3] = axis * value, axis
        return motion, first, second
    along = np.outer(axis, axis)
    x, y, z = axis
    around = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    c, s = math.cos(value), math.sin(value)
    motion[:3, :3] = along + c * (np.eye(3) - along) + s * around
    first[:3, :3] = c * around - s * (np.eye(3) - along)
    second[:3, :3] = -c * (np.eye(3) - along) - s * around
    return motion, first, second


def _unit(axis: Vector) -> Float[np.ndarray, "3"]:
    # Divided by the largest first, so that no square overflows or vanishes.
    direction = np.array(axis, dtype=np.float64) / max(map(abs, axis))
    return np.asarray(direction / math.sqrt(direction @ direction))
