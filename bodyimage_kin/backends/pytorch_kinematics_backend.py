"""pytorch-kinematics, the differentiable twin, made exact in float64."""

from __future__ import annotations

import pytorch_kinematics
import torch
from jaxtyping import Float64
from pytorch_kinematics.transforms import Transform3d
from torch import Tensor

from bodyimage_kin.backends._chains import ChainBackend
from bodyimage_kin.robot.tree import KinematicTree, write_core

__all__ = ["PytorchKinematicsBackend"]


class PytorchKinematicsBackend(ChainBackend):
    """Pose and Jacobian by pytorch-kinematics, batched, in float64.

    ``chain.to(dtype=torch.float64)`` converts offsets and axes that were built in float32 (0.10.0: 1e-8 to 2e-6 off),
    so they are overwritten with the URDF's own numbers. Second derivatives through its forward kinematics are silently
    zero or wrong; here they come from shared code, which differentiates by the Jacobian.
    """

    # 0.10.0 recurses from link to link, several calls deep at each, and copies all that follows each.
    most_joints = 24

    def _build(self, tree: KinematicTree) -> _Chain:
        return _Chain(tree)


class _Chain:
    """The exact model of one chain; none for a single link, of which 0.10.0 fails to build a robot."""

    def __init__(self, tree: KinematicTree) -> None:
        self.chain: pytorch_kinematics.SerialChain | None = None
        if tree.joints:
            chain = pytorch_kinematics.build_chain_from_urdf(write_core(tree).encode()).to(dtype=torch.float64)
            _make_exact(chain, tree)
            self.chain = pytorch_kinematics.SerialChain(chain, tree.links[-1], dtype=torch.float64)

    def pose_and_jacobian(
        self, values: Float64[Tensor, "batch p"]
    ) -> tuple[Float64[Tensor, "batch 4 4"], Float64[Tensor, "batch 6 p"]]:
        if self.chain is None:
            return torch.eye(4, dtype=values.dtype).repeat(len(values), 1, 1), values.new_zeros(len(values), 6, 0)
        jacobian, pose = self.chain.jacobian_tensor(values, ret_eef_pose=True)
        # A view of all frames would stay alive with them, and torch 2.13 fails on it in forward mode.
        return pose.clone(), jacobian


def _make_exact(chain: pytorch_kinematics.chain.Chain, tree: KinematicTree) -> None:
    """Overwrites every offset and axis, built in float32, with the URDF's float64 numbers."""
    for joint in tree.joints:
        frame = chain.find_frame(joint.child)
        frame.joint.offset = Transform3d(matrix=torch.tensor(joint.origin)[None], dtype=torch.float64)
        frame.joint.axis = torch.tensor(joint.axis, dtype=torch.float64)
