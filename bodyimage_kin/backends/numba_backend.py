"""numba: every chain through one kernel compiled for the processor at hand, on blocks of postures.

Compiling takes some ten seconds the first time, and says so. The result is kept beside the module; where that folder
is not writable, in the user's cache folder; in the folder ``NUMBA_CACHE_DIR`` if that is set. Where none can be written
to, each process compiles anew.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Float64, Int64
from numba import config
from torch import Tensor

from bodyimage_kin._arrays import refuse_not_finite
from bodyimage_kin.backends import _numba_kernels as kernels
from bodyimage_kin.backends._protocol import Abilities
from bodyimage_kin.backends.torch_backend import TorchBackend
from bodyimage_kin.errors import InvalidArray, InvalidConfig, InvalidPosture, NotDifferentiable
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.transforms import Matrix3, Matrix4, transform
from bodyimage_kin.robot.tree import Joint

__all__ = ["HandImage", "NumbaBackend"]

_POSTURES_A_THREAD = 8192
"""Starting a thread costs as much time as some two thousand postures."""


class NumbaBackend:
    """Pose and Jacobian by compiled kernels, in float64, in as many threads as torch is allowed for large batches.

    Joints that follow others are resolved in the chain itself: the robot need not be unfolded. Postures on another
    device than the CPU stay there, and are worked off by :class:`TorchBackend`.
    """

    abilities = Abilities(followers=True, out=True, finite=True, devices=True, gradient=True)

    def __init__(self, robot: Robot) -> None:
        if getattr(config, "DISABLE_JIT", False):
            raise InvalidConfig("NUMBA_DISABLE_JIT=1 and backend 'numba' exclude each other; unset it, or use 'torch'")
        self.robot = robot
        self._chains: dict[str, _LinkChain] = {}

    @functools.cached_property
    def _elsewhere(self) -> TorchBackend:
        return TorchBackend(self.robot)

    def pose_and_jacobian(
        self,
        q: Float[Tensor, "batch n"],
        link: str,
        out: tuple[Float[Tensor, "batch 4 4"], Float[Tensor, "batch 6 n"]] | None = None,
    ) -> tuple[Float[Tensor, "batch 4 4"], Float[Tensor, "batch 6 n"]]:
        """See :meth:`Kinematics.pose_and_jacobian`.

        Args:
            q: Postures (batch, n).
            link: A link of the robot.
            out: Pose and Jacobian to write into, contiguous; None: new tensors.

        Raises:
            InvalidPosture: Another number of joints, not float64, or a value that is not finite.
            NotDifferentiable: Postures that require a gradient, which :class:`RobotKinematics` gives.
            InvalidArray: An ``out`` that cannot hold the result.
        """
        if not q.is_cpu:
            refuse_not_finite(q)
            return self._elsewhere.pose_and_jacobian(q, link)
        chain = self._chains.get(link)
        if chain is None:
            chain = self._chains[link] = _LinkChain.to(self.robot, link)
        values = _values(q, self.robot.n)
        shapes = (len(values), 4, 4), (len(values), 6, self.robot.n)
        pose, jacobian = _outputs(shapes, out)

        def run(part: slice) -> int:
            return kernels.pose_and_jacobian(values[part], *chain, pose[part], jacobian[part])

        if _in_threads(run, len(values)):
            refuse_not_finite(q)
        return out or (torch.from_numpy(pose), torch.from_numpy(jacobian))

    def gradient(
        self,
        pose: Float64[Tensor, "batch 4 4"],
        jacobian: Float64[Tensor, "batch 6 n"],
        of_pose: Float64[Tensor, "batch 4 4"] | None,
        of_jacobian: Float64[Tensor, "batch 6 n"] | None,
        path: Tensor,
    ) -> Float64[Tensor, "batch n"]:
        """See :class:`Abilities`."""
        n, joints = self.robot.n, len(path)
        rows = _gradient_rows(tuple(path.tolist()), n)
        arrays = [
            (jacobian.new_empty(0, *shape) if tensor is None else tensor).contiguous().numpy()
            for tensor, shape in ((pose, (4, 4)), (jacobian, (6, n)), (of_pose, (4, 4)), (of_jacobian, (6, n)))
        ]
        result = np.empty((len(jacobian), n))

        def run(part: slice) -> int:
            # Slices of what is not there are empty again.
            kernels.gradient(*(array[part] for array in arrays), *rows, joints, result[part])
            return 0

        _in_threads(run, len(result))
        return torch.from_numpy(result)

    def hand_image(
        self,
        hand_link: str,
        hand_offset: Sequence[float],
        camera_link: str,
        link_T_camera: Float[np.ndarray, "4 4"],
        lens: Sequence[float],
        columns: Sequence[int] | None = None,
    ) -> HandImage:
        """What computes the image of a hand in a camera, and its Jacobian, in one go.

        Args:
            hand_link: The link that carries the hand.
            hand_offset: The hand's centre in that link [m].
            camera_link: The link that carries the camera; it may move.
            link_T_camera: Where the camera is in its link: x right, y down, z forward.
            lens: One number: the distance of a virtual screen [m]. Ten: a pinhole's focal lengths and principal point
                [px], its distortion k1, k2, p1, p2 and k3, and the square of the tangent from which on it has no image.
                None at all: the image is the hand in the camera's axes [m].
            columns: Indices (p,) in q of the columns of the Jacobian; None: all n.
        """
        return HandImage(self.robot, hand_link, hand_offset, camera_link, link_T_camera, lens, columns)


class HandImage:
    """The image of a hand, compiled like the kinematics; built by :meth:`NumbaBackend.hand_image`."""

    def __init__(
        self,
        robot: Robot,
        hand_link: str,
        hand_offset: Sequence[float],
        camera_link: str,
        link_T_camera: Float[np.ndarray, "4 4"],
        lens: Sequence[float],
        columns: Sequence[int] | None = None,
    ) -> None:
        self._n = robot.n
        self._offset = np.array(hand_offset, dtype=np.float64)
        self._lens = np.array(lens, dtype=np.float64)
        self._m = 2 if len(lens) else 3
        to_hand, to_camera = robot.path(hand_link), robot.path(camera_link)
        # What carries both moves neither, as the camera sees it.
        common = 0
        while common < min(len(to_hand), len(to_camera)) and to_hand[common] is to_camera[common]:
            common += 1
        hand = _Chain.along(robot, to_hand[common:], transform(np.eye(3), hand_offset))
        camera = _Chain.along(robot, to_camera[common:], np.asarray(link_T_camera, dtype=np.float64))
        joints = np.concatenate([hand.joints, camera.joints])
        _share_columns(joints)
        every = _column_rows(joints, robot.n, kernels.IMAGE_SLOTS, range(self._m))
        rows = every if columns is None else every[:, list(columns)]
        self._p = rows.shape[1]
        self._chains = hand.constants, camera.constants, joints
        self._rows = rows.reshape(-1) * kernels.L

    def image_and_jacobian(
        self,
        q: Float64[Tensor, "batch n"],
        out: tuple[Float64[Tensor, "batch m"], Float64[Tensor, "batch"], Float64[Tensor, "batch m p"]] | None = None,
        offsets: Float64[Tensor, "batch 3"] | None = None,
    ) -> tuple[Float64[Tensor, "batch m"], Float64[Tensor, "batch"], Float64[Tensor, "batch m p"]]:
        """Where the hand is seen, how deep it is, and how motion moves its image (equations 17 to 19).

        Args:
            q: Postures (batch, n) [rad or m].
            out: Tensors to write into, contiguous; None: new ones.
            offsets: The observed point of each posture, in the hand's link [m]; None: the hand's centre.

        Returns:
            Image [m on the screen, px, or m], depth [m] along the camera's axis, and the Jacobian of the image. Where a
            pinhole sees nothing both are NaN; where the depth is not positive, those of a virtual screen mean nothing:
            the caller has to look.

        Raises:
            InvalidPosture: Another number of joints, not float64, or a value that is not finite.
            NotDifferentiable: Postures that require a gradient, which :class:`RobotKinematics` gives.
            InvalidArray: An ``out`` that cannot hold the result.
        """
        values = _values(q, self._n)
        batch = len(values)
        image, depth, jacobian = _outputs(((batch, self._m), (batch,), (batch, self._m, self._p)), out)
        aside = np.empty((0, 3)) if offsets is None else offsets.contiguous().numpy() - self._offset

        def run(part: slice) -> int:
            return kernels.image_and_jacobian(
                values[part], aside[part], *self._chains, self._lens, self._rows, image[part], depth[part],
                jacobian[part],
            )  # fmt: skip

        if _in_threads(run, batch):
            refuse_not_finite(q)
        return out or (torch.from_numpy(image), torch.from_numpy(depth), torch.from_numpy(jacobian))


class _Chain(NamedTuple):
    """A chain as the kernels read it: the tables described there."""

    constants: Float64[np.ndarray, "rows constants"]
    joints: Int64[np.ndarray, "moving 3"]

    @classmethod
    def along(cls, robot: Robot, path: Sequence[Joint], end: Matrix4) -> _Chain:
        """The chain of these joints of the robot; ``end`` is what is fixed to the last of them."""
        fixed, between, moving = np.eye(4), [], []
        for joint in path:
            fixed = fixed @ joint.origin
            if joint.kind != "fixed":
                aligned = _z_to(joint.axis)
                between.append(fixed @ transform(aligned, np.zeros(3)))
                fixed = transform(aligned.T, np.zeros(3))
                moving.append(joint)
        between.append(fixed @ end)
        constants = np.zeros((len(moving) + 2, kernels.CONSTANTS))
        constants[0] = between[0][:3].T.reshape(-1)
        joints = np.zeros((len(moving), 3), dtype=np.int64)
        before = 1.0 + 0.0j
        for index, (joint, step) in enumerate(zip(moving, between[1:], strict=True)):
            first, tilt, last = _euler_zxz(step[:3, :3])
            phase = before * first
            # The step's translation, seen from axes already turned by its first angle.
            across = complex(step[0, 3], step[1, 3]) * first.conjugate()
            source, multiplier, offset = robot.source_of(joint.name)
            constants[index + 1, [kernels.SIN_PHASE, kernels.COS_PHASE]] = phase.imag, phase.real
            constants[index + 1, [kernels.STEP_X, kernels.STEP_Y, kernels.STEP_Z]] = (
                across.real,
                across.imag,
                step[2, 3],
            )
            constants[index + 1, [kernels.SIN_TILT, kernels.COS_TILT]] = tilt.imag, tilt.real
            constants[index + 1, [kernels.MULTIPLIER, kernels.OFFSET]] = multiplier, offset
            joints[index, kernels.COLUMN] = robot.joint_index(source)
            joints[index, kernels.PRISMATIC] = joint.kind == "prismatic"
            before = last
        constants[-1, :2] = before.imag, before.real
        _share_columns(joints)
        return cls(constants, joints)


class _LinkChain(NamedTuple):
    """The chain to a link, and which rows of the kernel's scratch make up its pose and its Jacobian."""

    constants: Float64[np.ndarray, "rows constants"]
    joints: Int64[np.ndarray, "moving 3"]
    pose_rows: Int64[np.ndarray, "16"]
    jacobian_rows: Int64[np.ndarray, "rows"]

    @classmethod
    def to(cls, robot: Robot, link: str) -> _LinkChain:
        chain = _Chain.along(robot, robot.path(link), np.eye(4))
        frame = np.array([kernels.X, kernels.Y, kernels.Z, kernels.ORIGIN])
        bottom = [kernels.ZERO, kernels.ZERO, kernels.ZERO, kernels.ONE]
        pose = np.stack([frame, frame + 1, frame + 2, bottom])
        jacobian = _column_rows(chain.joints, robot.n, kernels.SLOTS, (3, 4, 5, 0, 1, 2))
        return cls(*chain, pose.reshape(-1) * kernels.L, jacobian.reshape(-1) * kernels.L)


def _share_columns(joints: Int64[np.ndarray, "moving 3"]) -> None:
    """Let every joint's column be added to that of the first one moved by the same element of q."""
    columns = joints[:, kernels.COLUMN].tolist()
    joints[:, kernels.INTO] = [columns.index(column) for column in columns]


def _column_rows(
    joints: Int64[np.ndarray, "moving 3"], n: int, slots: int, rows_in_slot: Sequence[int]
) -> Int64[np.ndarray, "rows n"]:
    """Which rows of the scratch make up a Jacobian; columns that move nothing are read from the row of zeros."""
    rows = np.full((len(rows_in_slot), n), kernels.ZERO, dtype=np.int64)
    for index, (column, _, into) in enumerate(joints.tolist()):
        if into == index:
            rows[:, column] = slots + kernels.SLOT * index + np.array(rows_in_slot)
    return rows


@functools.lru_cache
def _gradient_rows(path: tuple[int, ...], n: int) -> tuple[np.ndarray, ...]:
    """Where in the scratch of a gradient: a pose, its gradient, the Jacobian and its gradient, and the result."""
    columns = 3 * np.arange(3) + np.arange(3)[:, None]
    poses = np.full((2, 4, 4), kernels.NOBODY)
    poses[0, :3, :3], poses[1, :3, :3] = kernels.TURN + columns, kernels.OF_TURN + columns
    poses[1, :3, 3] = kernels.OF_ORIGIN + np.arange(3)
    jacobians = np.full((2, 6, n), kernels.NOBODY)
    result = np.full(n, kernels.NONE)
    for index, column in enumerate(path):
        slot = kernels.GRADIENT_SLOTS + kernels.GRADIENT_SLOT * index
        jacobians[:, :, column] = slot + np.arange(12).reshape(2, 6)
        result[column] = slot + kernels.OF_ANGLE
    return tuple(kernels.L * rows for rows in (*poses.reshape(2, 16), jacobians.reshape(2, 6 * n), result))


def _z_to(axis: Sequence[float]) -> Matrix3:
    """A rotation that takes z to a unit vector."""
    z = np.asarray(axis, dtype=np.float64)
    z = z / np.linalg.norm(z)
    x = np.eye(3)[np.argmin(np.abs(z))]
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _euler_zxz(rotation: Matrix3) -> tuple[complex, complex, complex]:
    """The angles of ``Rz(a) Rx(b) Rz(c)``, each as cos + i sin."""
    side = complex(-rotation[1, 2], rotation[0, 2])
    a = side / abs(side) if abs(side) > 1e-15 else 1.0 + 0.0j
    b = complex(rotation[2, 2], abs(side))
    # c is what a and b leave over: where b is small, rounding spoils a and c each, but not what they give together.
    c = complex(
        a.real * rotation[0, 0] + a.imag * rotation[1, 0],
        a.real * rotation[0, 1] + a.imag * rotation[1, 1],
    ).conjugate()
    return a, b / abs(b), c / abs(c)


def _values(q: Tensor, n: int) -> Float64[np.ndarray, "batch n"]:
    """The postures as the kernels need them: they check nothing, and would read beyond the end."""
    if q.dtype != torch.float64 or q.ndim != 2 or q.shape[1] != n:
        raise InvalidPosture(f"posture q is {q.dtype} {tuple(q.shape)}; the numba kernels take float64 (batch, {n})")
    if q.requires_grad:
        raise NotDifferentiable("the numba kernels keep no gradient; use bodyimage_kin.kinematics(robot), which does")
    return q.contiguous().numpy()


def _outputs(shapes: Sequence[tuple[int, ...]], out: Sequence[Tensor] | None) -> list[np.ndarray]:
    """Arrays to write into, of these shapes: new ones, or the memory of ``out``."""
    if out is None:
        return [np.empty(shape) for shape in shapes]
    for tensor, shape in zip(out, shapes, strict=True):
        if tensor.dtype != torch.float64 or tuple(tensor.shape) != shape or not tensor.is_contiguous():
            raise InvalidArray(f"out must hold contiguous float64 tensors of shapes {', '.join(map(str, shapes))}")
    return [tensor.numpy() for tensor in out]


def _in_threads(run: Callable[[slice], int], batch: int) -> int:
    """Run the parts of a batch in threads, as many as torch is allowed; small batches in this one. Adds the results."""
    # Plain threads, as the kernels release the interpreter: numba's own pool must not be forked, nor be shared by
    # threads where its threading layer is `workqueue`, and would have to be compiled for.
    threads = min(torch.get_num_threads(), batch // _POSTURES_A_THREAD) if batch >= 2 * _POSTURES_A_THREAD else 1
    if threads < 2:
        return run(slice(0, batch))
    size = -(-batch // (threads * kernels.L)) * kernels.L
    with ThreadPoolExecutor(threads - 1) as pool:
        others = [pool.submit(run, slice(first, first + size)) for first in range(size, batch, size)]
        return run(slice(0, size)) + sum(other.result() for other in others)
