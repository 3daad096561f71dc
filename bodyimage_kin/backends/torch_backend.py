"""Plain torch: what serves other devices than the CPU, machines without numba, and unknown link lengths and axes.

Structure of arrays: every quantity is one row of ``batch`` numbers, so that each torch operation works on whole rows.
Every joint turns about the z axis of its own frame, or slides along it; what is fixed in between is one matrix.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple, TypeAlias

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike, as_float_tensor
from bodyimage_kin.backends._protocol import Abilities
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.robot import Robot

__all__ = ["LinkChain", "TorchBackend", "chain_pose"]

Product: TypeAlias = Callable[[Tensor, Tensor], Tensor]
"""Of matrices."""
_BLOCK = 2048
"""Postures at a time on the CPU: few enough for all intermediate values to stay in its caches."""


def chain_pose(
    origins: ArrayLike, axes: ArrayLike, q: ArrayLike, prismatic: Sequence[bool] | None = None
) -> Float[Tensor, "*batch 4 4"]:
    """The pose of a chain's end, differentiable by lengths, axes and joint values alike, on any device.

    Plain torch operations: gradients of any order, ``torch.func`` transforms included, reach all three.

    Args:
        origins: (m, 4, 4) where each joint's frame is in that of the joint before at value zero [m], the first in the
            root; or (m + 1, 4, 4) with the end in the last joint's frame.
        axes: (m, 3) each joint's axis in its own frame, of any length but zero: only the direction matters.
        q: Joint values ``(*batch, m)`` [rad or m].
        prismatic: Which joints slide; None: all turn.

    Returns:
        root_T_end.

    Raises:
        InvalidArray: Shapes or kinds that do not fit together.
    """
    origins, axes, q = (
        as_float_tensor(values, what) for values, what in ((origins, "origins"), (axes, "axes"), (q, "q"))
    )
    m = axes.shape[0] if axes.ndim == 2 else -1
    if axes.shape != (m, 3) or origins.ndim != 3 or origins.shape[1:] != (4, 4) or len(origins) not in (m, m + 1):
        raise InvalidArray(
            f"origins {tuple(origins.shape)} and axes {tuple(axes.shape)} make no chain; give (m, 4, 4), or "
            "(m + 1, 4, 4) with the end's own, and (m, 3)"
        )
    if q.ndim == 0 or q.shape[-1] != m or (prismatic is not None and len(prismatic) != m):
        raise InvalidArray(f"q {tuple(q.shape)} and prismatic must have one entry for each of the {m} joints")
    batch = q.shape[:-1]
    steps = _aligned(origins, axes, _sums).to(q.dtype)
    rows = q.reshape(batch.numel(), m).T.contiguous()
    frame, _ = _run(steps, rows, [False] * m if prismatic is None else list(map(bool, prismatic)), _sums)
    return _pose(frame).T.reshape(*batch, 4, 4)


class TorchBackend:
    """Pose and Jacobian by torch operations, on the device and in the dtype of the postures."""

    abilities = Abilities(followers=True, devices=True)

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._chains: dict[tuple[str, torch.device, torch.dtype], LinkChain] = {}

    def pose_and_jacobian(
        self, q: Float[Tensor, "batch n"], link: str
    ) -> tuple[Float[Tensor, "batch 4 4"], Float[Tensor, "batch 6 n"]]:
        """See :meth:`Kinematics.pose_and_jacobian`."""
        key = link, q.device, q.dtype
        if key not in self._chains:
            self._chains[key] = LinkChain.to(self.robot, link).on(q)
        chain, n = self._chains[key], self.robot.n
        pose, jacobian = q.new_empty(len(q), 4, 4), q.new_empty(len(q), 6, n)
        size = _BLOCK if q.is_cpu else max(len(q), 1)
        with _without_autocast(q.device):
            for first in range(0, len(q), size):
                part = slice(first, first + size)
                frame, columns = _values(chain, q[part], n)
                # Two axes only: torch turns these around in blocks, and any more of them number by number.
                pose[part].view(-1, 16).copy_(_pose(frame).T)
                jacobian[part].view(len(columns.T), 6 * n).copy_(columns.T)
        return pose, jacobian


def _without_autocast(device: torch.device) -> AbstractContextManager[None]:
    """Matrix products in the dtype of their factors."""
    if torch.amp.is_autocast_available(device.type) and torch.is_autocast_enabled(device.type):
        return torch.autocast(device.type, enabled=False)
    return nullcontext()


def _sums(a: Float[Tensor, "*batch i j"], b: Float[Tensor, "*batch j k"]) -> Float[Tensor, "*batch i k"]:
    """The product of matrices as sums of products: autocast rounds none of it, on the way back neither."""
    return (a[..., :, :, None] * b[..., None, :, :]).sum(-2)


class LinkChain(NamedTuple):
    """The chain to a link, as one step after the other."""

    steps: Tensor
    """(m + 1, 4, 4): what is fixed before, between and behind joints that turn about, or slide along, their z axes."""
    columns: Tensor
    """Where the value of each joint stands in q."""
    sliding: list[bool]
    """Which joints slide."""
    turning: Tensor
    """(m, 1): which turn."""
    follow: tuple[Tensor, Tensor] | None
    """Multiplier and offset (m, 1) of every joint when one of them follows another, else None."""

    @classmethod
    def to(cls, robot: Robot, link: str) -> LinkChain:
        """That of a robot and one of its links."""
        fixed, origins, axes, columns, sliding, follow = np.eye(4), [], [], [], [], []
        for joint in robot.path(link):
            fixed = fixed @ joint.origin
            if joint.kind != "fixed":
                origins.append(fixed)
                axes.append(joint.axis)
                source, multiplier, offset = robot.source_of(joint.name)
                columns.append(robot.joint_index(source))
                follow.append((multiplier, offset))
                sliding.append(joint.kind == "prismatic")
                fixed = np.eye(4)
        steps = _aligned(
            torch.from_numpy(np.stack([*origins, fixed])), torch.tensor(axes, dtype=torch.float64).reshape(-1, 3)
        )
        turning = ~torch.tensor(sliding, dtype=torch.bool)[:, None]
        factors = torch.tensor(follow, dtype=torch.float64).reshape(-1, 2, 1).unbind(1)
        follows = any(pair != (1.0, 0.0) for pair in follow) or len(set(columns)) < len(columns)
        return cls(
            steps,
            torch.tensor(columns, dtype=torch.long),
            sliding,
            turning,
            (factors[0], factors[1]) if follows else None,
        )

    def on(self, q: Tensor) -> LinkChain:
        """The same on a tensor's device and in its dtype."""
        steps, columns, sliding, turning, follow = self
        if follow is not None:
            follow = follow[0].to(q), follow[1].to(q)
        return LinkChain(steps.to(q), columns.to(q.device), sliding, turning.to(q.device), follow)


def _values(
    chain: LinkChain, q: Float[Tensor, "batch n"], n: int
) -> tuple[Float[Tensor, "4 3 batch"], Float[Tensor, "rows batch"]]:
    """The end's frame, and its Jacobian as 6 n rows."""
    steps, columns, sliding, turning, follow = chain
    values = q.T[columns]
    if follow is not None:
        values = values * follow[0] + follow[1]
    frame, joints = _run(steps, values, sliding)
    jacobian = q.new_zeros(6, n, len(q))
    if joints:
        # (3, m, batch): axes, and where they pass through.
        axis, origin = torch.stack([z for z, _ in joints], 1), torch.stack([o for _, o in joints], 1)
        linear = _cross(axis, frame[3][:, None] - origin)
        if any(sliding):
            linear = torch.where(turning, linear, axis)
            axis = torch.where(turning, axis, 0.0)
        if follow is None:
            jacobian[:3, columns], jacobian[3:, columns] = linear, axis
        else:
            jacobian[:3].index_add_(1, columns, linear * follow[0])
            jacobian[3:].index_add_(1, columns, axis * follow[0])
    return frame, jacobian.reshape(6 * n, len(q))


def _cross(a: Float[Tensor, "3 m batch"], b: Float[Tensor, "3 m batch"]) -> Float[Tensor, "3 m batch"]:
    """Written out: torch.linalg.cross 2.13 goes number by number along the first axis."""
    (a0, a1, a2), (b0, b1, b2) = a, b
    return torch.stack(
        [
            torch.addcmul(one * other, less, by, value=-1.0)
            for one, other, less, by in ((a1, b2, a2, b1), (a2, b0, a0, b2), (a0, b1, a1, b0))
        ]
    )


def _aligned(
    origins: Float[Tensor, "origins 4 4"], axes: Float[Tensor, "m 3"], product: Product = torch.matmul
) -> Float[Tensor, "steps 4 4"]:
    """(m + 1, 4, 4): what is fixed before, between and behind joints that turn about, or slide along, their z axes."""
    m = len(axes)
    x, y, z = (axes / torch.linalg.vector_norm(axes, dim=-1, keepdim=True)).unbind(-1)
    # Turns z onto the axis the short way: I + [v]x + [v]x^2 / (1 + c). An axis that points down gets the frame of the
    # opposite one with y and z reversed, so that nothing is divided by something small.
    down = z < 0.0
    sign = torch.where(down, -1.0, 1.0).to(axes)
    u, v, w = sign * x, sign * y, sign * z
    k = 1.0 / (1.0 + w)
    rows = [1.0 - k * u * u, -k * u * v, u], [-k * u * v, 1.0 - k * v * v, v], [-u, -v, w]
    rotation = torch.stack([torch.stack([a, sign * b, sign * c], -1) for a, b, c in rows], -2)
    eye = torch.eye(4, dtype=origins.dtype, device=origins.device)
    align = torch.nn.functional.pad(rotation.to(origins), (0, 1, 0, 1))
    align = align + torch.diag(eye[3])
    if len(origins) == m:
        origins = torch.cat([origins, eye[None]])
    after = torch.cat([align, eye[None]])
    before = torch.cat([eye[None], align.mT])
    return product(product(before, origins), after)


def _run(
    steps: Float[Tensor, "steps 4 4"],
    q: Float[Tensor, "m batch"],
    sliding: Sequence[bool],
    product: Product = torch.matmul,
) -> tuple[Float[Tensor, "4 3 batch"], list[tuple[Float[Tensor, "3 batch"], Float[Tensor, "3 batch"]]]]:
    """The end's frame (axes x, y, z, then the origin, in the root), and every joint's axis and origin."""
    batch = q.shape[-1]
    sine, cosine = q.sin(), q.cos()
    # Columns of root_T_joint become rows of numbers: the transposed matrix multiplies from the left.
    mixing = steps.mT
    frame = mixing[0, :, :3, None].expand(4, 3, batch)
    joints = []
    for j, slides in enumerate(sliding):
        x, y, z, origin = frame
        joints.append((z, origin))
        if slides:
            turned = torch.stack([x, y, z, origin + q[j] * z])
        else:
            s, c = sine[j], cosine[j]
            turned = torch.stack([torch.addcmul(c * x, s, y), torch.addcmul(c * y, s, x, value=-1.0), z, origin])
        frame = product(mixing[j + 1], turned.reshape(4, 3 * batch)).reshape(4, 3, batch)
    return frame, joints


def _pose(frame: Float[Tensor, "4 3 batch"]) -> Float[Tensor, "16 batch"]:
    """The sixteen numbers of a pose."""
    zeros, ones = torch.zeros_like(frame[:3, :1]), torch.ones_like(frame[3:, :1])
    return torch.cat([frame, torch.cat([zeros, ones])], 1).transpose(0, 1).reshape(16, frame.shape[-1])
