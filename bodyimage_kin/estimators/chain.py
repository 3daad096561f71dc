"""The way from camera to hand as a chain of joints, whose geometry is a handful of vectors that can be fitted.

Written in the camera's axes at the robot's zero posture, every chain is a product of exponentials (Murray, Li and
Sastry 1994, section 3.2)::

    c(q) = o_0 + R_1 (o_1 + R_2 (o_2 + ... R_k o_k)),    R_i = exp(v_i [a_i]x),    v = mix q + shift

with axes a_i and offsets o_i from one joint to the next; a prismatic joint has R = 1 and adds ``v_i a_i``. Joints that
carry the camera come first, turned backwards. Sliding an offset's end along an axis and scaling all offsets together
change no image: so much of the geometry cannot be known from images, and need not be.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.estimators._kept import Kept
from bodyimage_kin.robot.tree import Joint

__all__ = ["Chain"]

_NEAREST = 1e-3
"""Depth below which a fit must not divide by it [m]."""


@dataclass(frozen=True, eq=False)
class Chain(Kept):
    """A chain from camera to hand.

    Attributes:
        axes: (k, 3) axes in those of the camera, of any length.
        offsets: (k + 1, 3) from the camera to the first joint, from joint to joint, from the last one to the hand [m].
        mix: (k, p) joint values of the chain from felt ones; -1 for a joint that carries the camera.
        shift: (k,) what is added to them [rad or m].
        revolute: (k,) whether a joint turns; else it slides.
        screen_distance: Of the camera [m].
    """

    axes: Float[Tensor, "k 3"]
    offsets: Float[Tensor, "links 3"]
    mix: Float[Tensor, "k p"]
    shift: Float[Tensor, "k"]
    revolute: Bool[Tensor, "k"]
    screen_distance: float

    kind = "chain"

    def __post_init__(self) -> None:
        if len(self.offsets) != len(self.axes) + 1:
            raise InvalidArray(
                f"a chain of {len(self.axes)} axes has {len(self.offsets)} offsets; give one more than axes"
            )
        _checks.number("screen_distance", self.screen_distance, above=0.0)

    @classmethod
    def of(cls, body: Embodiment) -> Chain:
        """The body's own chain.

        Raises:
            InvalidConfig: No joint stands between camera and hand.
        """
        robot = body.felt_robot.unfolded
        to_camera, to_hand = robot.path(body.camera.link), robot.path(body.hand.link)
        shared = sum(one.name == other.name for one, other in zip(to_camera, to_hand, strict=False))
        camera, carrying = _walk(to_camera)
        hand, placed = _walk(to_hand)
        # A joint placed on the way to the camera, seen from the camera, turns the world the other way round.
        ways = [(joint, -1.0, carrying[joint.name]) for joint in reversed(to_camera[shared:])]
        ways += [(joint, 1.0, placed[joint.name]) for joint in to_hand[shared:]]
        ways = [way for way in ways if way[0].kind != "fixed"]
        if not ways:
            raise InvalidConfig(
                f"embodiment '{body.name}': no joint stands between camera and hand; nothing to calibrate"
            )
        root_T_camera = camera @ body.camera.link_T_camera.numpy()
        camera_R_root = root_T_camera[:3, :3].T
        frames = np.stack([frame for _, _, frame in ways])
        axes = [camera_R_root @ frame[:3, :3] @ np.asarray(joint.axis) for joint, _, frame in ways]
        point = hand[:3, :3] @ body.hand.offset.numpy() + hand[:3, 3]
        places = (np.vstack([frames[:, :3, 3], point]) - root_T_camera[:3, 3]) @ camera_R_root.T
        matrix, constant = body.felt_robot.folding
        rows = [robot.joint_index(joint.name) for joint, _, _ in ways]
        signs = torch.tensor([sign for _, sign, _ in ways], dtype=torch.float64)
        return cls(
            torch.from_numpy(np.stack(axes)),
            torch.from_numpy(np.diff(places, axis=0, prepend=np.zeros((1, 3)))),
            signs[:, None] * matrix[rows],
            signs * constant[rows],
            torch.tensor([joint.kind != "prismatic" for joint, _, _ in ways]),
            body.camera.screen.distance,
        )

    def with_geometry(self, parameters: Float[Tensor, "parameters"]) -> Chain:
        """The same structure with other axes and offsets, laid out as :attr:`geometry`."""
        k = len(self.axes)
        return replace(self, axes=parameters[: 3 * k].reshape(k, 3), offsets=parameters[3 * k :].reshape(k + 1, 3))

    @property
    def geometry(self) -> Float[Tensor, "parameters"]:
        """Axes, then offsets, flat."""
        return torch.cat([self.axes.flatten(), self.offsets.flatten()])

    def point(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count 3"]:
        """The hand in the camera's axes [m]."""
        return self._sweep(q)[0][0]

    def point_jacobian(
        self, q: Float[Tensor, "count p"]
    ) -> tuple[Float[Tensor, "count 3"], Float[Tensor, "count 3 p"]]:
        """The hand in the camera's axes [m], and its derivative with respect to the felt joints [m/rad]."""
        ends, turned, rotations, units, _ = self._sweep(q)
        columns = []
        for joint, unit in enumerate(units):
            along = unit.expand(len(q), 3)
            moved = torch.linalg.cross(along, turned[joint], dim=-1) if bool(self.revolute[joint]) else along
            columns.append((rotations[joint] @ moved[..., None])[..., 0])
        return ends[0], torch.stack(columns, -1) @ self.mix.to(q)

    def image(self, point: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 2"]:
        """Where a point is seen [m on the screen]."""
        return self.screen_distance * point[..., :2] / point[..., 2:]

    def image_slope(self, point: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 2 3"]:
        """Derivative of :meth:`image` with respect to the point."""
        depth = point[..., 2, None, None]
        identity = torch.eye(2, dtype=point.dtype).expand(*point.shape[:-1], 2, 2)
        return torch.cat([identity, -point[..., :2, None] / depth], -1) * (self.screen_distance / depth)

    def fit_terms(
        self, q: Float[Tensor, "count p"]
    ) -> tuple[Float[Tensor, "count 2"], Float[Tensor, "count 2 parameters"]]:
        """Images, and their derivative with respect to :attr:`geometry`; depths are kept off zero."""
        ends, _, rotations, units, values = self._sweep(q)
        identity = torch.eye(3, dtype=q.dtype)
        of_axes = []
        for joint, unit in enumerate(units):
            inner = ends[joint + 1]
            value = values[:, joint, None, None]
            if bool(self.revolute[joint]):
                along = (inner @ unit)[:, None, None] * identity + unit[:, None] * inner[:, None, :]
                moved = (1.0 - torch.cos(value)) * along - torch.sin(value) * _cross_matrix(inner)
            else:
                moved = value * identity
            upright = (identity - torch.outer(unit, unit)) / self.axes[joint].norm()
            of_axes.append(rotations[joint] @ moved @ upright)
        point = torch.cat([ends[0][:, :2], ends[0][:, 2:].clamp(min=_NEAREST)], 1)
        moved = torch.cat([*of_axes, *rotations], -1)
        return self.image(point), self.image_slope(point) @ moved

    def convention(self, start: Chain) -> tuple[Float[Tensor, "rows"], Float[Tensor, "rows parameters"]]:
        """What no image shows, less what it is by convention; and its derivative with respect to :attr:`geometry`.

        Axes have length one; a joint stands where it did in ``start`` along its axis (a prismatic one anywhere); the
        offsets keep their common scale, unless a prismatic joint tells it. Zero rows exclude no chain of images, and
        make the geometry unique.
        """
        k = len(self.axes)
        size = start.offsets.norm()
        apart, held = (chain.offsets[:-1] - chain.offsets[1:] for chain in (self, start))
        rows, slopes = [], []

        def add(row: Tensor, of_axes: dict[int, Tensor], of_offsets: dict[int, Tensor]) -> None:
            slope = torch.zeros(2 * k + 1, 3, dtype=row.dtype)
            for index, value in of_axes.items():
                slope[index] = value
            for index, value in of_offsets.items():
                slope[k + index] = value
            rows.append(row)
            slopes.append(slope.flatten())

        for joint, axis in enumerate(self.axes):
            add(axis @ axis - 1.0, {joint: 2.0 * axis}, {})
            if bool(self.revolute[joint]):
                kept = start.axes[joint] @ held[joint] / start.axes[joint].norm()
                ends = {joint: axis / size, joint + 1: -axis / size}
                add((axis @ apart[joint] - kept) / size, {joint: apart[joint] / size}, ends)
            else:
                for unit in torch.eye(3, dtype=axis.dtype):
                    ends = {joint: unit / size, joint + 1: -unit / size}
                    add(unit @ (apart[joint] - held[joint]) / size, {}, ends)
        if bool(self.revolute.all()):
            ends = {index: 2.0 * offset / size**2 for index, offset in enumerate(self.offsets)}
            add((self.offsets**2).sum() / size**2 - 1.0, {}, ends)
        return torch.stack(rows), torch.stack(slopes)

    def _sweep(self, q: Tensor) -> tuple[list[Tensor], list[Tensor], list[Tensor], list[Tensor], Tensor]:
        """Inwards from the hand, then outwards.

        Returns:
            The rest of the chain as seen at each joint before it turns (k + 1); the same after it has turned (k); the
            rotation of the axes at each joint's offset (k + 1); unit axes (k); joint values (count, k).
        """
        values = q @ self.mix.to(q).T + self.shift.to(q)
        units = [(axis / axis.norm()).to(q) for axis in self.axes]
        count, k = len(q), len(units)
        offsets = self.offsets.to(q)
        ends = [offsets[k].expand(count, 3)]
        turned: list[Tensor] = []
        turns: list[Tensor] = []
        for joint in range(k - 1, -1, -1):
            unit, value, inner = units[joint], values[:, joint, None], ends[0]
            if bool(self.revolute[joint]):
                turn = _rotation(unit, values[:, joint])
                outer = (turn @ inner[..., None])[..., 0]
            else:
                turn = torch.eye(3, dtype=q.dtype).expand(count, 3, 3)
                outer = inner + value * unit
            turns.insert(0, turn)
            turned.insert(0, outer)
            ends.insert(0, offsets[joint] + outer)
        rotations = [torch.eye(3, dtype=q.dtype).expand(count, 3, 3)]
        for turn in turns:
            rotations.append(rotations[-1] @ turn)
        return ends, turned, rotations, units, values


def _walk(path: tuple[Joint, ...]) -> tuple[Float[np.ndarray, "4 4"], dict[str, Float[np.ndarray, "4 4"]]]:
    """Where a path ends at the zero posture, and where each of its joints is, in the root."""
    here, placed = np.eye(4), {}
    for joint in path:
        here = here @ joint.origin
        placed[joint.name] = here
    return here, placed


def _cross_matrix(v: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    x, y, z = v.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(*v.shape[:-1], 3, 3)


def _rotation(unit: Float[Tensor, "3"], angle: Float[Tensor, "count"]) -> Float[Tensor, "count 3 3"]:
    """Rotation about a unit axis (Rodrigues)."""
    cross = _cross_matrix(unit)
    sine, rest = torch.sin(angle)[:, None, None], (1.0 - torch.cos(angle))[:, None, None]
    return torch.eye(3, dtype=angle.dtype) + sine * cross + rest * (cross @ cross)
