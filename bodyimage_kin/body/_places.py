"""Links and points of a body in its root, and how the felt joints move them."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin.backends import RobotKinematics


class Places:
    """Poses, points and their Jacobians; of a link that no felt joint moves they are computed once."""

    def __init__(self, kinematics: RobotKinematics, home: Float[Tensor, "p"]) -> None:
        self._kinematics, self._home = kinematics, home
        self._fixed: dict[str, Tensor | None] = {}

    def fixed_pose(self, link: str) -> Float[Tensor, "4 4"] | None:
        """root_T_link of a link that no felt joint moves; None of one that moves."""
        if link not in self._fixed:
            moves = any(joint.kind != "fixed" for joint in self._kinematics.robot.path(link))
            self._fixed[link] = None if moves else self._kinematics.pose(self._home, link)
        return self._fixed[link]

    def pose_and_jacobian(
        self, q: Float[Tensor, "*batch p"], link: str
    ) -> tuple[Float[Tensor, "*batch 4 4"], Float[Tensor, "*batch 6 p"]]:
        """root_T_link and the link's Jacobian in ``local_world_aligned``."""
        fixed = self.fixed_pose(link)
        if fixed is None:
            return self._kinematics.pose_and_jacobian(q, link)
        batch = q.shape[:-1]
        return fixed.to(q).expand(*batch, 4, 4), q.new_zeros(()).expand(*batch, 6, len(self._home))

    def point(
        self, q: Float[Tensor, "*batch p"], link: str, offset: Float[Tensor, "*given 3"]
    ) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch 3 3"], Float[Tensor, "*batch 6 p"]]:
        """A point fixed in a link: its position and the link's orientation in the root, and the point's Jacobian.

        Args:
            q: Postures.
            link: The link.
            offset: The point in the link [m]: (3,), or one a posture.
        """
        pose, jacobian = self.pose_and_jacobian(q, link)
        rotation = pose[..., :3, :3]
        arm = (rotation @ offset.to(pose)[..., None])[..., 0]
        linear, angular = jacobian[..., :3, :], jacobian[..., 3:, :]
        moved = linear - torch.linalg.cross(arm[..., None].expand_as(angular), angular, dim=-2)
        return pose[..., :3, 3] + arm, rotation, torch.cat([moved, angular], dim=-2)
