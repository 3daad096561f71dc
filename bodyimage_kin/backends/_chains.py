"""What backends share that build a model of the bare chain to each link they are asked for."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Float64
from torch import Tensor

from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.tree import Joint, KinematicTree


@runtime_checkable
class Chain(Protocol):
    """A library's model of one chain, to be used by any number of threads at a time."""

    def pose_and_jacobian(
        self, values: Float64[Tensor, "batch p"]
    ) -> tuple[Float64[Tensor, "batch 4 4"], Float64[Tensor, "batch 6 p"]]:
        """Pose and Jacobian of the end, in the axes of the root.

        Args:
            values: Of the p moving joints, root first.
        """
        ...


class _Piece(NamedTuple):
    """A stretch of the path to a link: its model, and where its moving joints stand in q."""

    chain: Chain
    columns: list[int]


class ChainBackend(ABC):
    """Pose and Jacobian from models of bare chains, built when they are first asked for.

    A chain is two to four times faster than a whole humanoid, and names that a library would sort, reserve or confuse
    are ours (:func:`numbered_chain`).

    Attributes:
        robot: Whose kinematics these are.
        most_joints: Of one model. Longer chains are put together from several: no library is made for them.
    """

    most_joints: ClassVar[int] = 128

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._pieces: dict[str, list[_Piece]] = {}
        self._building = threading.Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        """Models are built anew in another process."""
        return type(self), (self.robot,)

    @abstractmethod
    def _build(self, tree: KinematicTree) -> Chain:
        """The model of a chain; it has at most ``most_joints`` joints, and none of them follows another."""

    def pose_and_jacobian(
        self, q: Float64[Tensor, "batch n"], link: str
    ) -> tuple[Float64[Tensor, "batch 4 4"], Float64[Tensor, "batch 6 n"]]:
        """See :meth:`Kinematics.pose_and_jacobian`."""
        first, *others = self._path(link)
        pose, packed = first.chain.pose_and_jacobian(q[:, first.columns])
        columns = first.columns
        for piece in others:
            place, moved = piece.chain.pose_and_jacobian(q[:, piece.columns])
            pose, packed = _followed_by(pose, packed, place, moved)
            columns = columns + piece.columns
        jacobian = q.new_zeros(len(q), 6, self.robot.n)
        jacobian[:, :, columns] = packed
        return pose, jacobian

    def _path(self, link: str) -> list[_Piece]:
        pieces = self._pieces.get(link)
        if pieces is None:
            with self._building:
                pieces = self._pieces.get(link) or self._built(link)
                self._pieces[link] = pieces
        return pieces

    def _built(self, link: str) -> list[_Piece]:
        path, most = self.robot.path(link), self.most_joints
        stretches = [path[first : first + most] for first in range(0, len(path), most)] or [path]
        return [
            _Piece(
                self._build(numbered_chain(stretch)),
                [self.robot.joint_index(joint.name) for joint in stretch if joint.kind != "fixed"],
            )
            for stretch in stretches
        ]


def numbered_chain(joints: Sequence[Joint]) -> KinematicTree:
    """A bare chain of these joints, its links and joints renamed to numbers.

    Libraries sort joints by name, keep words for themselves (``universe``, ``world``) or mix up a link and a joint of
    one name. None of that can happen to a chain whose names are ours.

    Args:
        joints: Each hangs from the one before.

    Returns:
        Links ``link0`` (the root) to ``linkN`` (the end), joints ``joint1`` to ``jointN``.
    """
    renamed = tuple(
        replace(joint, name=f"joint{index}", parent=f"link{index - 1}", child=f"link{index}", mimic=None)
        for index, joint in enumerate(joints, start=1)
    )
    return KinematicTree("chain", "link0", tuple(f"link{index}" for index in range(len(joints) + 1)), renamed)


def _followed_by(
    pose: Float64[Tensor, "batch 4 4"],
    jacobian: Float64[Tensor, "batch 6 p"],
    place: Float64[Tensor, "batch 4 4"],
    moved: Float64[Tensor, "batch 6 r"],
) -> tuple[Float64[Tensor, "batch 4 4"], Float64[Tensor, "batch 6 s"]]:
    """Pose and Jacobian of the end of a chain that goes on from the end of another."""
    rotation = pose[:, :3, :3]
    end = pose @ place
    # What turns the first end carries the second one along.
    arm = (end[:, :3, 3:] - pose[:, :3, 3:]).expand(-1, -1, jacobian.shape[-1])
    carried = jacobian[:, :3] + torch.linalg.cross(jacobian[:, 3:], arm, dim=1)
    first = torch.cat([carried, jacobian[:, 3:]], dim=1)
    second = torch.cat([rotation @ moved[:, :3], rotation @ moved[:, 3:]], dim=1)
    return end, torch.cat([first, second], dim=2)
