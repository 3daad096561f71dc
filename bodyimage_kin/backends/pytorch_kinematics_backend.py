"""pytorch-kinematics, the differentiable twin, made exact in float64."""

from __future__ import annotations

import pytorch_kinematics
import torch
from jaxtyping import Float
from pytorch_kinematics.transforms import Transform3d

from bodyimage_kin.backends._protocol import moving_columns, numbered_chain
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.tree import KinematicTree, write_core


class PytorchKinematicsBackend:
    """Pose and Jacobian by pytorch-kinematics, batched, in float64.

    ``chain.to(dtype=torch.float64)`` converts offsets and axes that were built in float32 (0.10.0: 1e-8 to 2e-6 off),
    so they are overwritten with the URDF's own numbers. Second derivatives through its forward kinematics are silently
    zero or wrong; here they come from shared code, which differentiates by the Jacobian.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._chains: dict[str, tuple[pytorch_kinematics.SerialChain | None, list[int]]] = {}

    def pose_and_jacobian(
        self, q: Float[torch.Tensor, "batch n"], link: str
    ) -> tuple[Float[torch.Tensor, "batch 4 4"], Float[torch.Tensor, "batch 6 n"]]:
        """See :meth:`Kinematics.pose_and_jacobian`."""
        if link not in self._chains:
            self._chains[link] = _build(self.robot, link), moving_columns(self.robot, link)
        chain, columns = self._chains[link]
        jacobian = q.new_zeros(len(q), 6, self.robot.n)
        if chain is None:
            return torch.eye(4, dtype=q.dtype).repeat(len(q), 1, 1), jacobian
        packed, pose = chain.jacobian_tensor(q[:, columns], ret_eef_pose=True)
        jacobian[:, :, columns] = packed
        return pose, jacobian


def _build(robot: Robot, link: str) -> pytorch_kinematics.SerialChain | None:
    """The exact chain to a link; None for the root, as 0.10.0 fails to build a robot of one link."""
    tree = numbered_chain(robot, link)
    if not tree.joints:
        return None
    chain = pytorch_kinematics.build_chain_from_urdf(write_core(tree).encode()).to(dtype=torch.float64)
    _make_exact(chain, tree)
    return pytorch_kinematics.SerialChain(chain, tree.links[-1], dtype=torch.float64)


def _make_exact(chain: pytorch_kinematics.chain.Chain, tree: KinematicTree) -> None:
    """Overwrites every offset and axis, built in float32, with the URDF's float64 numbers."""
    for joint in tree.joints:
        frame = chain.find_frame(joint.child)
        frame.joint.offset = Transform3d(matrix=torch.tensor(joint.origin)[None], dtype=torch.float64)
        frame.joint.axis = torch.tensor(joint.axis, dtype=torch.float64)
