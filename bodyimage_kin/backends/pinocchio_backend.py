"""Pinocchio, the oracle: the analytic truth that every learned Jacobian is held against."""

from __future__ import annotations

import threading

import numpy as np
import pinocchio
import torch
from jaxtyping import Float64
from torch import Tensor

from bodyimage_kin.backends._chains import ChainBackend
from bodyimage_kin.robot.tree import KinematicTree, write_core

__all__ = ["PinocchioBackend"]


class PinocchioBackend(ChainBackend):
    """Pose and Jacobian by Pinocchio, posture by posture, in float64.

    pin 4.1.0 keeps n^3 numbers beside a model of n joints.
    """

    def _build(self, tree: KinematicTree) -> _Chain:
        return _Chain(tree)


class _Chain:
    """The Pinocchio model of one chain."""

    def __init__(self, tree: KinematicTree) -> None:
        self.model = pinocchio.buildModelFromXML(write_core(tree))
        # An unknown frame id would crash the interpreter; this one exists, as the chain's end.
        self.frame = self.model.getFrameId(tree.links[-1], pinocchio.BODY)
        moving = [joint for joint in tree.joints if joint.kind != "fixed"]
        joints = [self.model.joints[self.model.getJointId(joint.name)] for joint in moving]
        self.in_velocity = [joint.idx_v for joint in joints]
        # A continuous joint is held as (cos, sin); every other one as its value.
        self.values = [(index, joint.idx_q) for index, joint in enumerate(joints) if joint.nq == 1]
        self.circles = [(index, joint.idx_q) for index, joint in enumerate(joints) if joint.nq == 2]
        # Pinocchio computes in memory beside the model: two threads in the same would give each other's results.
        self._memory = threading.local()

    @property
    def data(self) -> pinocchio.Data:
        if not hasattr(self._memory, "data"):
            self._memory.data = self.model.createData()
        return self._memory.data

    def configurations(self, values: Float64[Tensor, "batch p"]) -> Float64[np.ndarray, "batch nq"]:
        posture = values.numpy()
        configuration = np.empty((len(posture), self.model.nq))
        for column, index in self.values:
            configuration[:, index] = posture[:, column]
        for column, index in self.circles:
            configuration[:, index] = np.cos(posture[:, column])
            configuration[:, index + 1] = np.sin(posture[:, column])
        return configuration

    def pose_and_jacobian(
        self, values: Float64[Tensor, "batch p"]
    ) -> tuple[Float64[Tensor, "batch 4 4"], Float64[Tensor, "batch 6 p"]]:
        model, data, frame = self.model, self.data, self.frame
        pose = np.empty((len(values), 4, 4))
        packed = np.empty((len(values), 6, model.nv))
        for index, configuration in enumerate(self.configurations(values)):
            # computeJointJacobians also computes the joints' placements; the frame's own follows.
            pinocchio.computeJointJacobians(model, data, configuration)
            pose[index] = pinocchio.updateFramePlacement(model, data, frame).homogeneous
            # pin 4.1.0 crashes the interpreter when asked for the Jacobian of a model in which nothing moves.
            if model.nv:
                jacobian = pinocchio.getFrameJacobian(model, data, frame, pinocchio.LOCAL_WORLD_ALIGNED)
                # With one velocity Pinocchio gives back (6,).
                packed[index] = jacobian.reshape(6, model.nv)
        return torch.from_numpy(pose), torch.from_numpy(packed[:, :, self.in_velocity])
