"""pytorch-kinematics, the differentiable twin, made exact in float64."""

from __future__ import annotations

import pytorch_kinematics
import torch
from jaxtyping import Float
from pytorch_kinematics.transforms import Transform3d

from bodyimage_kin import _transforms
from bodyimage_kin._urdf import KinematicTree, write_core
from bodyimage_kin.backends._protocol import moving_columns, numbered_chain
from bodyimage_kin.robot import Robot


class PytorchKinematicsBackend:
    """Pose and Jacobian by pytorch-kinematics, batched, in float64.

    ``chain.to(dtype=torch.float64)`` converts offsets and axes that were built in float32 (0.10.0: 1e-8 to 2e-6 off),
    so they are overwritten with the URDF's own numbers. Second derivatives through its forward kinematics are silently
    zero or wrong; here they come from shared code, which differentiates by the Jacobian.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._chains: dict[str, tuple[pytorch_kinematics.SerialChain | None, list[int], torch.Tensor]] = {}

    def pose_and_jacobian(
        self, q: Float[torch.Tensor, "batch n"], link: str
    ) -> tuple[Float[torch.Tensor, "batch 4 4"], Float[torch.Tensor, "batch 6 n"]]:
        """See :meth:`Kinematics.pose_and_jacobian`."""
        if link not in self._chains:
            self._chains[link] = _build(self.robot, link)
        chain, columns, fixed = self._chains[link]
        jacobian = q.new_zeros(len(q), 6, self.robot.n)
        if chain is None or len(q) == 0:
            # It knows neither chains without a moving joint nor empty batches.
            return fixed.expand(len(q), 4, 4).clone(), jacobian
        packed, pose = chain.jacobian_tensor(q[:, columns], ret_eef_pose=True)
        jacobian[:, :, columns] = packed
        return pose, jacobian


def _build(robot: Robot, link: str) -> tuple[pytorch_kinematics.SerialChain | None, list[int], torch.Tensor]:
    """The exact chain to a link (None when nothing on it moves), its columns in q, and its pose where nothing moves."""
    tree = numbered_chain(robot, link)
    columns = moving_columns(robot, link)
    pose = torch.eye(4, dtype=torch.float64)
    if not columns:
        for joint in tree.joints:
            pose = pose @ torch.from_numpy(_transforms.transform(_transforms.rpy_matrix(joint.rpy), joint.xyz))
        return None, columns, pose
    chain = pytorch_kinematics.build_chain_from_urdf(write_core(tree).encode()).to(dtype=torch.float64)
    _make_exact(chain, tree)
    return pytorch_kinematics.SerialChain(chain, tree.links[-1], dtype=torch.float64), columns, pose


def _make_exact(chain: pytorch_kinematics.chain.Chain, tree: KinematicTree) -> None:
    """Overwrites every offset and axis, built in float32, with the URDF's float64 numbers."""
    for joint in tree.joints:
        frame = chain.find_frame(joint.child)
        matrix = _transforms.transform(_transforms.rpy_matrix(joint.rpy), joint.xyz)
        frame.joint.offset = Transform3d(matrix=torch.from_numpy(matrix)[None], dtype=torch.float64)
        frame.joint.axis = torch.tensor(joint.axis, dtype=torch.float64)
