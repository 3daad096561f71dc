"""Pinocchio, the oracle: the analytic truth that every learned Jacobian is held against."""

from __future__ import annotations

import numpy as np
import pinocchio
import torch
from jaxtyping import Float

from bodyimage_kin.backends._protocol import moving_columns, numbered_chain
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.tree import write_core


class PinocchioBackend:
    """Pose and Jacobian by Pinocchio, posture by posture, in float64.

    For each link that is asked for, Pinocchio gets the bare chain that leads to it: two to four times faster than a
    whole humanoid, and names that it would sort, reserve or confuse are ours (:func:`numbered_chain`).
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._chains: dict[str, _Chain] = {}

    def pose_and_jacobian(
        self, q: Float[torch.Tensor, "batch n"], link: str
    ) -> tuple[Float[torch.Tensor, "batch 4 4"], Float[torch.Tensor, "batch 6 n"]]:
        """See :meth:`Kinematics.pose_and_jacobian`."""
        return self._chain(link).pose_and_jacobian(q)

    def hessian(self, q: Float[torch.Tensor, "batch n"], link: str) -> Float[torch.Tensor, "batch 6 n n"]:
        """Pinocchio's own hessian, an independent check of the shared one: same layout and reference.

        Args:
            q: Postures (batch, n).
            link: A link of the robot.
        """
        return self._chain(link).hessian(q)

    def _chain(self, link: str) -> _Chain:
        """The chain to a link, built when it is first asked for."""
        if link not in self._chains:
            self._chains[link] = _Chain(self.robot, link)
        return self._chains[link]


class _Chain:
    """The Pinocchio model of one chain."""

    def __init__(self, robot: Robot, link: str) -> None:
        tree = numbered_chain(robot, link)
        self.model = pinocchio.buildModelFromXML(write_core(tree))
        self.data = self.model.createData()
        # An unknown frame id would crash the interpreter; this one exists, as the chain's end.
        self.frame = self.model.getFrameId(tree.links[-1], pinocchio.BODY)
        self.columns = moving_columns(robot, link)
        self.n = robot.n
        moving = [joint for joint in tree.joints if joint.kind != "fixed"]
        joints = [self.model.joints[self.model.getJointId(joint.name)] for joint in moving]
        self.in_velocity = [joint.idx_v for joint in joints]
        # A continuous joint is held as (cos, sin); every other one as its value.
        self.values = [(c, j.idx_q) for c, j in zip(self.columns, joints, strict=True) if j.nq == 1]
        self.circles = [(c, j.idx_q) for c, j in zip(self.columns, joints, strict=True) if j.nq == 2]

    def configuration(self, q: Float[torch.Tensor, "batch n"]) -> Float[np.ndarray, "batch nq"]:
        posture = q.numpy()
        configuration = np.empty((len(posture), self.model.nq))
        for column, index in self.values:
            configuration[:, index] = posture[:, column]
        for column, index in self.circles:
            configuration[:, index] = np.cos(posture[:, column])
            configuration[:, index + 1] = np.sin(posture[:, column])
        return configuration

    def pose_and_jacobian(
        self, q: Float[torch.Tensor, "batch n"]
    ) -> tuple[Float[torch.Tensor, "batch 4 4"], Float[torch.Tensor, "batch 6 n"]]:
        pose = np.empty((len(q), 4, 4))
        packed = np.empty((len(q), 6, self.model.nv))
        for index, configuration in enumerate(self.configuration(q)):
            # computeJointJacobians also computes the joints' placements; the frame's own follows.
            pinocchio.computeJointJacobians(self.model, self.data, configuration)
            pose[index] = pinocchio.updateFramePlacement(self.model, self.data, self.frame).homogeneous
            # pin 4.1.0 crashes the interpreter when asked for the Jacobian of a model in which nothing moves.
            if self.model.nv:
                jacobian = pinocchio.getFrameJacobian(self.model, self.data, self.frame, pinocchio.LOCAL_WORLD_ALIGNED)
                # With one velocity Pinocchio gives back (6,).
                packed[index] = jacobian.reshape(6, self.model.nv)
        jacobians = np.zeros((len(q), 6, self.n))
        jacobians[:, :, self.columns] = packed[:, :, self.in_velocity]
        return torch.from_numpy(pose), torch.from_numpy(jacobians)

    def hessian(self, q: Float[torch.Tensor, "batch n"]) -> Float[torch.Tensor, "batch 6 n n"]:
        hessians = np.zeros((len(q), 6, self.n, self.n))
        nv = self.model.nv
        if nv == 0:
            return torch.from_numpy(hessians)
        for index, configuration in enumerate(self.configuration(q)):
            pinocchio.computeJointJacobians(self.model, self.data, configuration)
            pinocchio.updateFramePlacement(self.model, self.data, self.frame)
            pinocchio.computeJointKinematicHessians(self.model, self.data, configuration)
            raw = pinocchio.getFrameKinematicHessian(self.model, self.data, self.frame, pinocchio.LOCAL_WORLD_ALIGNED)
            # pin 4.1.0 hands over column-major values in a C-ordered array: read them in the order they lie in.
            ordered = np.asarray(raw).ravel().reshape((6, nv, nv), order="F")
            block = ordered[:, self.in_velocity][:, :, self.in_velocity]
            hessians[index][:, np.array(self.columns)[:, None], np.array(self.columns)] = block
        return torch.from_numpy(hessians)
