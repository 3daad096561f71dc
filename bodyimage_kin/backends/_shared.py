"""What every backend shares: checks, batch shapes, dtypes, frames of reference, followers, hessians and gradients."""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

import torch
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike, as_postures, refuse_not_finite
from bodyimage_kin.backends import _derivatives
from bodyimage_kin.backends._protocol import Kinematics, moving_columns
from bodyimage_kin.errors import InvalidConfig, UnsupportedDevice
from bodyimage_kin.robot import Robot

Reference = Literal["local_world_aligned", "local", "world"]


class _Path(NamedTuple):
    """What the shared code has to know about the way to a link."""

    link: str
    columns: Tensor
    """Indices in the unfolded posture, root first."""
    folding: Tensor | None
    """(unfolded, n) when a joint of the path follows another, else None."""


class RobotKinematics:
    """Forward kinematics, Jacobians and their derivatives of one robot, computed by one backend.

    Every method takes postures ``q`` of any batch shape, ``(*batch, n)``, as tensor, array or list (lists become
    float64), and gives tensors of the dtype and on the device of ``q``, differentiable to any order.

    Attributes:
        robot: Whose kinematics these are.
        backend: The object that computes pose and Jacobian, built for ``robot.unfolded``.
        name: The backend's name.
    """

    def __init__(self, robot: Robot, backend: Kinematics, name: str) -> None:
        self.robot, self.backend, self.name = robot, backend, name
        self._paths: dict[str, _Path] = {}

    def __repr__(self) -> str:
        return f"RobotKinematics({self.robot.name!r}, backend={self.name!r})"

    def pose(self, q: ArrayLike, link: str) -> Float[Tensor, "*batch 4 4"]:
        """root_T_link: maps the link's coordinates [m] to the root's.

        Args:
            q: Postures ``(*batch, n)`` [rad or m].
            link: Name of the link.

        Raises:
            InvalidPosture: Wrong last axis, dtype, or a value that is not finite.
            UnknownName: No such link.
            UnsupportedDevice: A tensor that is not on the CPU, and a backend that computes nowhere else.
        """
        return self.pose_and_jacobian(q, link)[0]

    def jacobian(
        self, q: ArrayLike, link: str, reference: Reference | str = "local_world_aligned"
    ) -> Float[Tensor, "*batch 6 n"]:
        """The Jacobian of a link, rows linear [m/rad] then angular [rad/rad] ([m/m] and 0 for prismatic joints).

        Args:
            q: Postures ``(*batch, n)`` [rad or m].
            link: Name of the link.
            reference: ``"local_world_aligned"``: axes of the root, origin at the link. ``"local"``: axes of the link,
                origin at the link. ``"world"``: the spatial Jacobian, axes and origin of the root (Pinocchio's names;
                Murray, Li and Sastry 1994, section 3.4, for the spatial and body ones).

        Raises:
            InvalidConfig: Another reference.
            InvalidPosture: As in :meth:`pose`, and so for the other errors.
        """
        if reference not in get_args(Reference):
            raise InvalidConfig(f"no reference {reference!r}; valid: {', '.join(get_args(Reference))}")
        pose, jacobian = self.pose_and_jacobian(q, link)
        if reference == "local_world_aligned":
            return jacobian
        linear, angular = jacobian[..., :3, :], jacobian[..., 3:, :]
        if reference == "local":
            link_R_root = pose[..., :3, :3].transpose(-1, -2)
            return torch.cat([link_R_root @ linear, link_R_root @ angular], dim=-2)
        position = pose[..., :3, 3:].expand_as(angular)
        return torch.cat([linear + torch.linalg.cross(position, angular, dim=-2), angular], dim=-2)

    def pose_and_jacobian(
        self, q: ArrayLike, link: str
    ) -> tuple[Float[Tensor, "*batch 4 4"], Float[Tensor, "*batch 6 n"]]:
        """Both at the cost of one: root_T_link and the Jacobian in ``local_world_aligned``.

        Args:
            q: Postures ``(*batch, n)`` [rad or m].
            link: Name of the link.

        Raises:
            InvalidPosture: As in :meth:`pose`, and so for the other errors.
        """
        path = self._path(link)
        pose, unfolded = self._unfolded(q, path)
        if path.folding is None:
            return pose, unfolded
        return pose, unfolded @ path.folding.to(unfolded)

    def hessian(self, q: ArrayLike, link: str) -> Float[Tensor, "*batch 6 n n"]:
        """Derivative of the Jacobian: ``[..., i, k] = d jacobian(q, link)[..., i] / d q[k]``, ``local_world_aligned``.

        Args:
            q: Postures ``(*batch, n)`` [rad or m].
            link: Name of the link.

        Raises:
            InvalidPosture: As in :meth:`pose`, and so for the other errors.
        """
        path = self._path(link)
        hessian = _derivatives.hessian(self._unfolded(q, path)[1], path.columns)
        if path.folding is None:
            return hessian
        fold = path.folding.to(hessian)
        return fold.T @ hessian @ fold

    def _unfolded(self, q: ArrayLike, path: _Path) -> tuple[Tensor, Tensor]:
        """Pose, and one column for each joint of the unfolded robot."""
        q = as_postures(q, self.robot.n)
        if q.device.type != "cpu":
            raise UnsupportedDevice(
                f"posture q is on '{q.device}', and backend '{self.name}' computes on the CPU; "
                "move it there yourself: q.cpu()"
            )
        if path.folding is not None:
            matrix, offset = self.robot.folding
            q = q @ matrix.to(q).T + offset.to(q)
        batch = q.shape[:-1]
        # Not -1: a robot in which nothing moves has postures without values.
        flat = q.reshape(batch.numel(), q.shape[-1])

        def evaluate(values: Tensor) -> tuple[Tensor, Tensor]:
            values = values.detach()
            refuse_not_finite(values)
            # float32 postures are computed in float64 and rounded once, at the end.
            pose, jacobian = self.backend.pose_and_jacobian(values.to(torch.float64).contiguous(), path.link)
            return pose.to(values.dtype), jacobian.to(values.dtype)

        if _nobody_differentiates(flat):
            pose, jacobian = evaluate(flat)
        else:
            pose, jacobian = _derivatives.pose_and_jacobian(flat, path.columns, evaluate)
        return pose.reshape(*batch, 4, 4), jacobian.reshape(*batch, 6, q.shape[-1])

    def _path(self, link: str) -> _Path:
        if (path := self._paths.get(link)) is None:
            self.robot.check_link(link)
            unfolded = self.robot.unfolded
            columns = moving_columns(unfolded, link)
            free = {name: index for index, name in enumerate(self.robot.joint_names)}
            follows = any(unfolded.joint_names[column] not in free for column in columns)
            folding = self.robot.folding[0] if follows or unfolded.n != self.robot.n else None
            path = self._paths[link] = _Path(link, torch.tensor(columns, dtype=torch.long), folding)
        return path


def _nobody_differentiates(q: Tensor) -> bool:
    """Whether autograd's bookkeeping can be spared: no backward, no forward mode, no transform of ``torch.func``."""
    backward = q.requires_grad and torch.is_grad_enabled()
    forward = torch.autograd.forward_ad._current_level >= 0
    return not (backward or forward or torch._C._functorch.peek_interpreter_stack() is not None)
