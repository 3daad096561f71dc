"""What a kinematics backend must offer."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Float

from bodyimage_kin.robot import Robot


@runtime_checkable
class Kinematics(Protocol):
    """One implementation of forward kinematics and its Jacobian, built as ``Class(robot)``.

    The robot it gets has no following (mimic) joints: these are set free before and folded afterwards by shared code,
    as are frames of reference, batch shapes, dtypes, checks, hessians and gradients (:class:`RobotKinematics`).
    """

    def pose_and_jacobian(
        self, q: Float[torch.Tensor, "batch n"], link: str
    ) -> tuple[Float[torch.Tensor, "batch 4 4"], Float[torch.Tensor, "batch 6 n"]]:
        """Pose and Jacobian of a link.

        Args:
            q: Postures, joints in the robot's canonical order, contiguous, finite, without a gradient.
            link: A link of the robot.

        Returns:
            root_T_link, and the Jacobian in ``local_world_aligned``: axes of the root, origin at the link, rows linear
            [m/rad] then angular [rad/rad]; columns of joints off the path are zero.
        """
        ...


class Abilities(NamedTuple):
    """What a backend does beyond the protocol. It says so in an attribute ``abilities``; none is needed."""

    followers: bool = False
    """It resolves followers itself, and so is built for the robot as it is. For derivatives along a path on which a
    joint follows another, one more is built, for ``robot.unfolded``."""
    out: bool = False
    """``pose_and_jacobian`` takes ``out=(pose, jacobian)``, float64, contiguous and of the right shapes."""
    finite: bool = False
    """It refuses postures that are not finite itself."""
    devices: bool = False
    """It computes on the device of q; there, unlike on the CPU, q is given in its own dtype."""
    gradient: bool = False
    """It has ``gradient(pose, jacobian, of_pose, of_jacobian, path)``, the formula of ``PoseAndJacobian.backward`` for
    float64 on the CPU; contiguous tensors, None for what has no gradient."""


def abilities(backend: object) -> Abilities:
    """What a backend says of itself."""
    return getattr(backend, "abilities", Abilities())


def moving_columns(robot: Robot, link: str) -> list[int]:
    """Where the moving joints of the path to a link stand in q, root first."""
    return [robot.joint_index(joint.name) for joint in robot.path(link) if joint.kind != "fixed"]
