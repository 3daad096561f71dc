"""MuJoCo, a third opinion: written by other people, in other formulas (quaternions and centres of mass)."""

from __future__ import annotations

import mujoco
import numpy as np
import torch
from jaxtyping import Float

from bodyimage_kin.backends._protocol import moving_columns, numbered_chain
from bodyimage_kin.robot import Robot


class MujocoBackend:
    """Pose and Jacobian by MuJoCo, posture by posture, in float64.

    Each link that is asked for gets a model of the bare chain that leads to it. The model is built body by body and
    not from URDF text, which MuJoCo would fuse at fixed joints, and whose massless links it would refuse.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._chains: dict[str, _Chain] = {}

    def pose_and_jacobian(
        self, q: Float[torch.Tensor, "batch n"], link: str
    ) -> tuple[Float[torch.Tensor, "batch 4 4"], Float[torch.Tensor, "batch 6 n"]]:
        """See :meth:`Kinematics.pose_and_jacobian`."""
        chain = self._chains.get(link)
        if chain is None:
            chain = self._chains[link] = _Chain(self.robot, link)
        return chain.pose_and_jacobian(q)


class _Chain:
    """The MuJoCo model of one chain; its joints stand in q in the order of the path."""

    def __init__(self, robot: Robot, link: str) -> None:
        self.columns = moving_columns(robot, link)
        self.n = robot.n
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        body = spec.worldbody
        for joint in numbered_chain(robot, link).joints:
            orientation = np.empty(4)
            mujoco.mju_mat2Quat(orientation, joint.origin[:3, :3].ravel())
            # MuJoCo refuses moving bodies without mass; kinematics do not depend on it.
            body = body.add_body(name=joint.child, pos=joint.xyz, quat=orientation, mass=1.0, inertia=[1.0, 1.0, 1.0])
            body.explicitinertial = True
            if joint.kind != "fixed":
                kind = mujoco.mjtJoint.mjJNT_SLIDE if joint.kind == "prismatic" else mujoco.mjtJoint.mjJNT_HINGE
                body.add_joint(name=joint.name, type=kind, axis=joint.axis)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        # Bodies are numbered as they hang: the end of the chain is the last, and the world's own number is 0.
        self.body = self.model.nbody - 1

    def pose_and_jacobian(
        self, q: Float[torch.Tensor, "batch n"]
    ) -> tuple[Float[torch.Tensor, "batch 4 4"], Float[torch.Tensor, "batch 6 n"]]:
        model, data, body = self.model, self.data, self.body
        postures = q.numpy()[:, self.columns]
        poses = np.tile(np.eye(4), (len(postures), 1, 1))
        packed = np.zeros((len(postures), 6, model.nv))
        for index, posture in enumerate(postures):
            data.qpos[:] = posture
            mujoco.mj_kinematics(model, data)
            # The Jacobian is built from motion axes about the centre of mass, which this computes.
            mujoco.mj_comPos(model, data)
            poses[index, :3, :3] = data.xmat[body].reshape(3, 3)
            poses[index, :3, 3] = data.xpos[body]
            if model.nv:
                mujoco.mj_jac(model, data, packed[index, :3], packed[index, 3:], data.xpos[body], body)
        jacobians = np.zeros((len(postures), 6, self.n))
        jacobians[:, :, self.columns] = packed
        return torch.from_numpy(poses), torch.from_numpy(jacobians)
