"""A body with every measure a little off: joints, encoders, hand, camera and skin, and the derivative in each.

Each joint of the way has six numbers, in its own axes: three that move its origin and three that turn it. Of those that
turn a revolute joint, the one about its axis is the zero of its encoder, the two others tilt the axis; of a prismatic
joint the zero is the shift along its axis. A camera, a hand and a skin are mounted on their links by six more. All
numbers are zero on the body as it is thought to be, and a joint's origin with its numbers is::

    origin @ translation(B t) @ rotation(exp [B w]x),    B = (e1, e2, axis)

so that a body that is found has full 6D joint origins, as every URDF can say them. Derivatives are exact, the right
Jacobian of the exponential included (Sola, Deray and Atchuthan 2018, equation 143), and linear in the number of
samples; where numba may compile, one pass over the samples gives them (:meth:`ParametricBody.seen`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Int

from bodyimage_kin._compiled import compiles
from bodyimage_kin.body import Camera, Embodiment
from bodyimage_kin.estimators import _point_kernels
from bodyimage_kin.robot import Robot, transforms
from bodyimage_kin.robot.tree import Joint

__all__ = ["Frame", "Mount", "Parameter", "ParametricBody", "spread_of"]

Group = Literal["axes", "offsets", "encoders", "hand", "camera", "intrinsics", "skin", "tracker", "plane"]
GROUPS: tuple[Group, ...] = ("axes", "offsets", "encoders", "hand", "camera", "intrinsics", "skin", "tracker", "plane")
"""Kinds of parameters, in the order in which they are laid out and freed."""


@dataclass(frozen=True)
class Parameter:
    """One number of a body that may be off.

    Attributes:
        name: In words: of what, and which number of it.
        group: Its kind.
        unit: ``"rad"``, ``"m"``, ``"px"`` or ``"1"``.
        size: What a relative prior is of [unit].
    """

    name: str
    group: Group
    unit: str
    size: float = 1.0


def spread_of(parameter: Parameter, axes: float, offsets: float, hand: float, held: float) -> float:
    """How far a number of a body may be off that has a hand at one point.

    Args:
        parameter: The number.
        axes: Standard deviation of an axis' tilt [rad].
        offsets: Of a joint's origin [m].
        hand: Of the hand's place on its link [m].
        held: What stands for all others, which are not off.
    """
    if parameter.group == "hand":
        # Turning one point about itself does what shifting it does.
        return hand if parameter.unit == "m" else held
    return {"axes": axes, "offsets": offsets}.get(parameter.group, held)


@dataclass(frozen=True, eq=False)
class Mount:
    """Something fixed on a link: a camera, a hand, a skin, a tracker.

    Attributes:
        name: What it is; its parameters bear it.
        group: Kind of its parameters.
        link: The link.
        link_T_mount: (4, 4) where it is thought to be.
    """

    name: str
    group: Group
    link: str
    link_T_mount: Float[np.ndarray, "4 4"]


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame at postures, and how it moves with the parameters.

    Attributes:
        rotation: (count, 3, 3) its axes in the root.
        position: (count, 3) its origin in the root [m].
        turned: (count, 3, parameters) angular velocity for a unit rate of each parameter, in the root.
        moved: (count, 3, parameters) linear velocity of its origin.
    """

    rotation: Float[np.ndarray, "count 3 3"]
    position: Float[np.ndarray, "count 3"]
    turned: Float[np.ndarray, "count 3 parameters"]
    moved: Float[np.ndarray, "count 3 parameters"]

    def point(self, offset: Float[np.ndarray, "*count 3"]) -> tuple[Float[np.ndarray, "count 3"], np.ndarray]:
        """A point fixed in the frame [m]: where it is in the root, and its derivative (count, 3, parameters)."""
        arm = (self.rotation @ np.broadcast_to(offset, self.position.shape)[..., None])[..., 0]
        return self.position + arm, self.moved + _crossed(self.turned, arm[..., None])

    def seen(
        self, place: Float[np.ndarray, "count 3"], slope: Float[np.ndarray, "count 3 parameters"]
    ) -> tuple[Float[np.ndarray, "count 3"], Float[np.ndarray, "count 3 parameters"]]:
        """A point of the root in this frame's axes [m], and its derivative: ``R' (p - o)``."""
        away = place - self.position
        back = self.rotation.transpose(0, 2, 1)
        moved = slope - self.moved - _crossed(self.turned, away[..., None])
        return (back @ away[..., None])[..., 0], back @ moved


class ParametricBody:
    """A robot that moves by some of its joints, with parameters.

    Args:
        felt: A robot that these joints alone move.
        names: Its joints, in the order of postures.
        mounts: What is fixed on its links and may be off.
        others: Parameters that move no frame, such as intrinsics of a camera.
    """

    def __init__(
        self, felt: Robot, names: Sequence[str], mounts: Iterable[Mount], others: Sequence[Parameter] = ()
    ) -> None:
        self.mounts = tuple(mounts)
        self.others = tuple(others)
        robot = felt.unfolded
        self._paths = {mount.link: robot.path(mount.link) for mount in self.mounts}
        on_the_way = {joint.name for path in self._paths.values() for joint in path}
        self.joints = tuple(j for j in robot.tree.joints if j.kind != "fixed" and j.name in on_the_way)
        self._first = {joint.name: 6 * index for index, joint in enumerate(self.joints)}
        self._first |= {
            f"mount {mount.name}": 6 * (len(self.joints) + index) for index, mount in enumerate(self.mounts)
        }
        matrix, constant = felt.folding
        rows = [robot.joint_index(joint.name) for joint in self.joints]
        columns = [felt.joint_index(name) for name in names]
        self._matrix, self._constant = matrix[rows][:, columns].numpy(), constant[rows].numpy()
        self._ways: dict[tuple[str, str | None], _Way] = {}

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Six a joint, six a mount, then the others."""
        found: list[Parameter] = []
        for joint in self.joints:
            slides = joint.kind == "prismatic"
            along = ("zero of its encoder", "encoders") if slides else ("offset along its axis", "offsets")
            about = ("turn about its axis", "axes") if slides else ("zero of its encoder", "encoders")
            for words, group, unit in (
                ("offset across its axis, first", "offsets", "m"),
                ("offset across its axis, second", "offsets", "m"),
                (*along, "m"),
                ("tilt of its axis, first", "axes", "rad"),
                ("tilt of its axis, second", "axes", "rad"),
                (*about, "rad"),
            ):
                found.append(Parameter(f"{joint.name}: {words}", group, unit))  # type: ignore[arg-type]
        for mount in self.mounts:
            for words, unit in [(f"shift along {axis}", "m") for axis in "xyz"] + [
                (f"turn about {axis}", "rad") for axis in "xyz"
            ]:
                found.append(Parameter(f"{mount.name}: {words}", mount.group, unit))
        return (*found, *self.others)

    def frames(
        self, q: Float[np.ndarray, "count p"], theta: Float[np.ndarray, "parameters"], by_joints: bool = False
    ) -> dict[str, Frame]:
        """Every mount's frame at postures of the felt joints, with its derivative in all parameters.

        Args:
            q: Felt postures [rad or m].
            theta: Values of :attr:`parameters`.
            by_joints: The derivative is in the p felt joints instead.
        """
        values = q @ self._matrix.T + self._constant
        reached: dict[str, _Reached] = {}
        found = {}
        for mount in self.mounts:
            here = self._link(mount.link, values, theta, reached).off(
                mount.link_T_mount,
                theta[self._first[f"mount {mount.name}"] :][:6],
                np.eye(3),
                self._first[f"mount {mount.name}"],
            )
            if by_joints:
                frame = here.frame(here.motions, len(self.joints))
                found[mount.name] = replace(frame, turned=frame.turned @ self._matrix, moved=frame.moved @ self._matrix)
            else:
                found[mount.name] = here.frame(here.small, len(self.parameters))
        return found

    def seen(
        self,
        q: Float[np.ndarray, "count p"],
        theta: Float[np.ndarray, "parameters"],
        mount: str,
        offset: Float[np.ndarray, "count 3"],
        observer: str | None = None,
    ) -> tuple[Float[np.ndarray, "count 3"], Float[np.ndarray, "count 3 parameters"]]:
        """A point fixed in a mount [m], in the axes of another, and its derivative in all parameters.

        Args:
            q: Felt postures [rad or m].
            theta: Values of :attr:`parameters`.
            mount: Name of the mount.
            offset: The point in it [m].
            observer: Name of the other mount; None: the root.
        """
        if not compiles():
            frames = self.frames(q, theta)
            place, slope = frames[mount].point(offset)
            return (place, slope) if observer is None else frames[observer].seen(place, slope)
        if (mount, observer) not in self._ways:
            self._ways[mount, observer] = self._way(mount, observer)
        way = self._ways[mount, observer]
        values, offset = q @ self._matrix.T + self._constant, np.ascontiguousarray(offset)
        point, slope = np.empty((len(q), 3)), np.zeros((len(q), 3, len(self.parameters)))
        _point_kernels.seen(
            values, theta, way.origins, way.bases, way.axes, way.kinds, way.firsts, way.back, offset, point, slope
        )
        return point, slope

    def corrected(self, theta: Float[np.ndarray, "parameters"]) -> dict[str, Float[np.ndarray, "4 4"]]:
        """Joint -> its origin with these numbers."""
        return {
            joint.name: _origin(joint) @ _small(theta[self._first[joint.name] :][:6], _basis(joint))[0]
            for joint in self.joints
        }

    def mounted(self, theta: Float[np.ndarray, "parameters"]) -> dict[str, Float[np.ndarray, "4 4"]]:
        """Mount -> where it is in its link with these numbers."""
        return {
            mount.name: mount.link_T_mount @ _small(theta[self._first[f"mount {mount.name}"] :][:6], np.eye(3))[0]
            for mount in self.mounts
        }

    def body_at(
        self, body: Embodiment, theta: Float[np.ndarray, "parameters"], camera: Camera | None = None
    ) -> Embodiment:
        """The body that these numbers describe: joints, hand and skin where they are found.

        Args:
            body: As it is thought to be.
            theta: Values of :attr:`parameters`.
            camera: Its camera; None: as it is thought to be.
        """
        mounts = self.mounted(theta)
        pose = mounts.get("hand", np.eye(4))
        point = pose[:3, :3] @ body.hand.offset.numpy() + pose[:3, 3]
        return Embodiment.build(
            body.robot.with_origins(self.corrected(theta)),
            joints=body.joints,
            hand=replace(body.hand, offset=torch.from_numpy(point)),
            camera=camera or body.camera,
            skin=body.skin.moved(mounts["skin"]) if body.skin is not None and "skin" in mounts else body.skin,
            home=body.home,
            name=body.name,
            backend=body.kinematics.name,
        )

    # Inner -----------------------------------------------------------------------------------------------------------

    def _way(self, mount: str, observer: str | None) -> _Way:
        """From where the ways to both part: to the observer, then to the mount."""
        named = {one.name: one for one in self.mounts}
        ends = [None if observer is None else named[observer], named[mount]]
        paths = [() if end is None else self._paths[end.link] for end in ends]
        shared = sum(one.name == other.name for one, other in zip(*paths, strict=False))
        steps: list[tuple[np.ndarray, np.ndarray, np.ndarray, int, int]] = []
        back = 0
        for end, path in zip(ends, paths, strict=True):
            back = len(steps)
            fixed = np.eye(4)
            for joint in path[shared:]:
                fixed = fixed @ _origin(joint)
                if joint.kind != "fixed":
                    kind = _point_kernels.PRISMATIC if joint.kind == "prismatic" else _point_kernels.REVOLUTE
                    axis = np.asarray(joint.axis, dtype=np.float64)
                    steps.append((fixed, _basis(joint), axis, kind, self._first[joint.name]))
                    fixed = np.eye(4)
            if end is not None:
                first = self._first[f"mount {end.name}"]
                steps.append((fixed @ end.link_T_mount, np.eye(3), np.zeros(3), _point_kernels.HELD, first))
        origins, bases, axes, kinds, firsts = (np.array(column) for column in zip(*steps, strict=True))
        return _Way(origins, bases, axes, kinds, firsts, back)

    def _link(
        self,
        link: str,
        values: Float[np.ndarray, "count joints"],
        theta: Float[np.ndarray, "parameters"],
        reached: dict[str, _Reached],
    ) -> _Reached:
        """Walks to a link; what two ways share is walked once."""
        here = _Reached(np.broadcast_to(np.eye(3), (len(values), 3, 3)), np.zeros((len(values), 3)), (), ())
        for joint in self._paths[link]:
            if joint.child in reached:
                here = reached[joint.child]
                continue
            here = here.then(_origin(joint)) if joint.kind == "fixed" else self._moved(joint, here, values, theta)
            reached[joint.child] = here
        return here

    def _moved(
        self,
        joint: Joint,
        here: _Reached,
        values: Float[np.ndarray, "count joints"],
        theta: Float[np.ndarray, "parameters"],
    ) -> _Reached:
        first = self._first[joint.name]
        here = here.off(_origin(joint), theta[first:][:6], _basis(joint), first)
        value, axis = values[:, first // 6], np.asarray(joint.axis)
        direction = (here.rotation @ axis)[..., None]
        if joint.kind == "prismatic":
            here = replace(here, position=here.position + direction[..., 0] * value[:, None])
            motion = _Acted(first // 6, here.position, direction, np.zeros_like(direction))
        else:
            here = replace(here, rotation=here.rotation @ _turns(axis, value))
            motion = _Acted(first // 6, here.position, np.zeros_like(direction), direction)
        return replace(here, motions=(*here.motions, motion))


@dataclass(frozen=True, eq=False)
class _Way:
    """Steps from an observer's mount to another; see :func:`bodyimage_kin.estimators._point_kernels.seen`."""

    origins: Float[np.ndarray, "steps 4 4"]
    bases: Float[np.ndarray, "steps 3 3"]
    axes: Float[np.ndarray, "steps 3"]
    kinds: Int[np.ndarray, "steps"]
    firsts: Int[np.ndarray, "steps"]
    back: int


@dataclass(frozen=True, eq=False)
class _Acted:
    """Where some numbers act: how a unit rate of each shifts and turns all that follows, and about where."""

    first: int
    place: Float[np.ndarray, "count 3"]
    shifts: Float[np.ndarray, "count 3 columns"]
    turns: Float[np.ndarray, "count 3 columns"]


@dataclass(frozen=True, eq=False)
class _Reached:
    """A frame on the way, the six numbers that acted before it, and the joints."""

    rotation: Float[np.ndarray, "count 3 3"]
    position: Float[np.ndarray, "count 3"]
    small: tuple[_Acted, ...]
    motions: tuple[_Acted, ...]

    def then(self, pose: Float[np.ndarray, "4 4"]) -> _Reached:
        return replace(
            self, rotation=_times(self.rotation, pose[:3, :3]), position=self.position + self.rotation @ pose[:3, 3]
        )

    def off(
        self,
        pose: Float[np.ndarray, "4 4"],
        numbers: Float[np.ndarray, "6"],
        basis: Float[np.ndarray, "3 3"],
        first: int,
    ) -> _Reached:
        there = self.then(pose)
        small, right = _small(numbers, basis)
        after = there.then(small)
        nothing = np.zeros_like(self.rotation)
        shifts = np.concatenate([_times(there.rotation, basis), nothing], axis=2)
        turns = np.concatenate([nothing, _times(after.rotation, right)], axis=2)
        return replace(after, small=(*self.small, _Acted(first, after.position, shifts, turns)))

    def frame(self, acted: tuple[_Acted, ...], columns: int) -> Frame:
        turned = np.zeros((len(self.position), 3, columns))
        moved = np.zeros_like(turned)
        for one in acted:
            here = slice(one.first, one.first + one.turns.shape[2])
            turned[:, :, here] = one.turns
            moved[:, :, here] = one.shifts + _crossed(one.turns, (self.position - one.place)[..., None])
        return Frame(self.rotation, self.position, turned, moved)


def _origin(joint: Joint) -> Float[np.ndarray, "4 4"]:
    return transforms.transform(transforms.rpy_matrix(joint.rpy), joint.xyz)


def _basis(joint: Joint) -> Float[np.ndarray, "3 3"]:
    """Two directions across the axis, the first as near as can be to a coordinate axis, then the axis itself."""
    axis = np.asarray(joint.axis, dtype=np.float64)
    across = np.eye(3)[int(np.abs(axis).argmin())]
    first = across - (across @ axis) * axis
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis], axis=1)


def _small(
    numbers: Float[np.ndarray, "6"], basis: Float[np.ndarray, "3 3"]
) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "3 3"]]:
    """The pose of six numbers, and the right Jacobian of its rotation times the basis."""
    rotation, shift, right = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    _point_kernels.small(np.ascontiguousarray(numbers), np.ascontiguousarray(basis), rotation, shift, right)
    return transforms.transform(rotation, shift), right


def _cross(v: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _times(
    rotations: Float[np.ndarray, "count 3 3"], matrix: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "count 3 3"]:
    """Each times one matrix, in one flat product: numpy's batched one is several times slower."""
    return (rotations.reshape(-1, 3) @ matrix).reshape(-1, 3, 3)


def _crossed(
    a: Float[np.ndarray, "count 3 columns"], b: Float[np.ndarray, "count 3 1"]
) -> Float[np.ndarray, "count 3 columns"]:
    """Cross product along the second axis; numpy's own is several times slower."""
    (ax, ay, az), (bx, by, bz) = a.swapaxes(0, 1), b.swapaxes(0, 1)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def _turns(axis: Float[np.ndarray, "3"], angle: Float[np.ndarray, "count"]) -> Float[np.ndarray, "count 3 3"]:
    cross = _cross(axis)
    sine, rest = np.sin(angle)[:, None, None], (1.0 - np.cos(angle))[:, None, None]
    return np.eye(3) + sine * cross + rest * (cross @ cross)
