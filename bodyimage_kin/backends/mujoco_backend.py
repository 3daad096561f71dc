"""MuJoCo, a third opinion: written by other people, in other formulas (quaternions and centres of mass)."""

from __future__ import annotations

import threading

import mujoco
import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from bodyimage_kin.backends._chains import ChainBackend
from bodyimage_kin.robot.tree import KinematicTree

__all__ = ["MujocoBackend"]


class MujocoBackend(ChainBackend):
    """Pose and Jacobian by MuJoCo, posture by posture, in float64.

    A model is built body by body and not from URDF text, which MuJoCo would fuse at fixed joints, and whose massless
    links it would refuse. mujoco 4.0.0 takes no more than 1,024 bodies in a row.
    """

    def _build(self, tree: KinematicTree) -> _Chain:
        return _Chain(tree)


class _Chain:
    """The MuJoCo model of one chain; its joints stand in qpos in the order of the path."""

    def __init__(self, tree: KinematicTree) -> None:
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        body = spec.worldbody
        for joint in tree.joints:
            orientation = np.empty(4)
            mujoco.mju_mat2Quat(orientation, joint.origin[:3, :3].ravel())
            # MuJoCo refuses moving bodies without mass; kinematics do not depend on it.
            body = body.add_body(name=joint.child, pos=joint.xyz, quat=orientation, mass=1.0, inertia=[1.0, 1.0, 1.0])
            body.explicitinertial = True
            if joint.kind != "fixed":
                kind = mujoco.mjtJoint.mjJNT_SLIDE if joint.kind == "prismatic" else mujoco.mjtJoint.mjJNT_HINGE
                body.add_joint(name=joint.name, type=kind, axis=joint.axis)
        self.model = spec.compile()
        # Bodies are numbered as they hang: the end of the chain is the last, and the world's own number is 0.
        self.body = self.model.nbody - 1
        # MuJoCo computes in memory beside the model: two threads in the same would give each other's results.
        self._memory = threading.local()

    @property
    def data(self) -> mujoco.MjData:
        if not hasattr(self._memory, "data"):
            self._memory.data = mujoco.MjData(self.model)
        return self._memory.data

    def pose_and_jacobian(
        self, values: Float64[Tensor, "batch p"]
    ) -> tuple[Float64[Tensor, "batch 4 4"], Float64[Tensor, "batch 6 p"]]:
        model, data, body = self.model, self.data, self.body
        poses = np.tile(np.eye(4), (len(values), 1, 1))
        packed = np.zeros((len(values), 6, model.nv))
        for index, posture in enumerate(values.numpy()):
            data.qpos[:] = posture
            mujoco.mj_kinematics(model, data)
            # The Jacobian is built from motion axes about the centre of mass, which this computes.
            mujoco.mj_comPos(model, data)
            poses[index, :3, :3] = data.xmat[body].reshape(3, 3)
            poses[index, :3, 3] = data.xpos[body]
            if model.nv:
                mujoco.mj_jac(model, data, packed[index, :3], packed[index, 3:], data.xpos[body], body)
        return torch.from_numpy(poses), torch.from_numpy(packed)
