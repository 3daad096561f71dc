"""The numbers a robot is made of, before any URDF text: what the strategies draw and the oracle computes from."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np
from jaxtyping import Float

from bodyimage_kin.errors import InvalidPosture, InvalidURDF, UnknownName
from bodyimage_kin.robot.tree import UNLIMITED

if TYPE_CHECKING:
    from bodyimage_kin.robot import Robot

Vector = tuple[float, float, float]
_NOTE = "<!-- case: "


@dataclass(frozen=True)
class JointSpec:
    """One joint as it is to be written; None leaves an attribute or element out, so that URDF's default holds.

    Attributes:
        name: Unique among the joints.
        kind: ``"revolute"``, ``"continuous"``, ``"prismatic"`` or ``"fixed"``.
        parent: The link it hangs from.
        child: The link it moves.
        xyz: Where the child's frame is in the parent's [m].
        rpy: Fixed-axis roll, pitch, yaw [rad].
        axis: Direction in the child's frame, of any length but zero; by default x.
        lower: Lower limit [rad or m].
        upper: Upper limit [rad or m].
        mimic: Name of the joint it follows; None when it is free.
        multiplier: Of the joint it follows.
        offset: Added to that [rad or m].
    """

    name: str
    kind: str
    parent: str
    child: str
    xyz: Vector | None = None
    rpy: Vector | None = None
    axis: Vector | None = None
    lower: float | None = None
    upper: float | None = None
    mimic: str | None = None
    multiplier: float | None = None
    offset: float | None = None

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper limit [rad or m], infinite where there is none."""
        if self.kind == "continuous":
            return -math.inf, math.inf
        return self.lower or 0.0, self.upper or 0.0


@dataclass(frozen=True)
class RobotSpec:
    """A robot as drawn.

    Attributes:
        joints: In the order in which the file names them.
        links: Likewise.
        name: The robot's name.
        text: URDF text to hand out in place of the joints' own: that of a published robot.
    """

    joints: tuple[JointSpec, ...]
    links: tuple[str, ...]
    name: str = "robot"
    text: str | None = None

    @classmethod
    def from_robot(cls, robot: Robot) -> RobotSpec:
        """The spec of a published robot: its numbers by the strict reader, its text as it was published."""
        joints = tuple(
            JointSpec(
                *(joint.name, joint.kind, joint.parent, joint.child, joint.xyz, joint.rpy),
                axis=None if joint.kind == "fixed" else joint.axis,
                lower=max(joint.lower, -UNLIMITED) if joint.kind in ("revolute", "prismatic") else None,
                upper=min(joint.upper, UNLIMITED) if joint.kind in ("revolute", "prismatic") else None,
                mimic=joint.mimic.joint if joint.mimic else None,
                multiplier=joint.mimic.multiplier if joint.mimic else None,
                offset=joint.mimic.offset if joint.mimic else None,
            )
            for joint in robot.tree.joints
        )
        try:
            text = robot.source.decode()
            type(robot).from_urdf(text, strict=True)
        except (UnicodeDecodeError, InvalidURDF):
            text = None  # in another encoding, or written carelessly: others may read it otherwise, the core is plain
        return cls(joints, robot.link_names, robot.name, text)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """The moving joints that follow no other, in the file's order: the order of a posture."""
        return tuple(joint.name for joint in self.free_joints)

    @cached_property
    def free_joints(self) -> tuple[JointSpec, ...]:
        """The joints that :attr:`joint_names` names."""
        return tuple(joint for joint in self.joints if joint.kind != "fixed" and joint.mimic is None)

    @property
    def n(self) -> int:
        """Number of joint values in a posture."""
        return len(self.free_joints)

    @cached_property
    def root(self) -> str:
        """The link that is nobody's child."""
        children = {joint.child for joint in self.joints}
        return next(link for link in self.links if link not in children)

    def path(self, link: str) -> tuple[JointSpec, ...]:
        """Every joint from the root to a link, root first."""
        above = {joint.child: joint for joint in self.joints}
        joints = []
        while link in above:
            joints.append(above[link])
            link = above[link].parent
        return tuple(reversed(joints))

    def follows(self, name: str) -> tuple[str, float, float]:
        """What drives a moving joint: (free joint, multiplier, offset), chains of followers resolved."""
        joints = {joint.name: joint for joint in self.joints}
        joint, multiplier, offset = joints[name], 1.0, 0.0
        while joint.mimic is not None:
            step = 1.0 if joint.multiplier is None else joint.multiplier
            offset += multiplier * (joint.offset or 0.0)
            multiplier *= step
            joint = joints[joint.mimic]
        return joint.name, multiplier, offset

    def folded(self, link: str) -> list[tuple[JointSpec, int, float, float]]:
        """The moving joints of the path to a link: (joint, index in the posture, multiplier, offset), root first."""
        index = {name: position for position, name in enumerate(self.joint_names)}
        moving = [(joint, *self.follows(joint.name)) for joint in self.path(link) if joint.kind != "fixed"]
        return [(joint, index[source], multiplier, offset) for joint, source, multiplier, offset in moving]

    def explicit(self) -> RobotSpec:
        """The same robot with every default written out, and axes of unit length."""
        return replace(self, joints=tuple(_explicit(joint) for joint in self.joints), text=None)

    def freed(self) -> RobotSpec:
        """The robot with every following joint set free."""
        joints = (replace(joint, mimic=None, multiplier=None, offset=None) for joint in self.joints)
        return replace(self, joints=tuple(joints), text=None)

    def to_urdf(self) -> str:
        """The URDF, links before joints, floats written so that reading them back gives the same bits."""
        if self.text is not None:
            return self.text
        lines = [f"<robot name={quoteattr(self.name)}>"]
        lines += [f"  <link name={quoteattr(link)}/>" for link in self.links]
        for joint in self.joints:
            lines += [f'  <joint name={quoteattr(joint.name)} type="{joint.kind}">']
            lines += [f"    {element}" for element in _elements(joint)]
            lines += ["  </joint>"]
        return "\n".join([*lines, "</robot>", ""])


@dataclass(frozen=True)
class Case:
    """One question to a library: the pose and Jacobian of this link of this robot at this posture.

    Attributes:
        robot: The robot.
        q: Joint values in the order of ``robot.joint_names`` [rad or m].
        link: A link of the robot.
    """

    robot: RobotSpec
    q: tuple[float, ...]
    link: str

    def __post_init__(self) -> None:
        if len(self.q) != self.robot.n:
            raise InvalidPosture(f"the case has {len(self.q)} joint values for a robot of {self.robot.n}")
        if self.link not in self.robot.links:
            raise UnknownName("link", self.link, self.robot.links)

    @property
    def posture(self) -> Float[np.ndarray, "n"]:
        """The joint values as an array."""
        return np.array(self.q, dtype=np.float64)

    @cached_property
    def scale(self) -> float:
        """What errors are relative to: the largest of 1, every joint value on the path, and the reach [m]."""
        values = [(joint, multiplier * self.q[k] + offset) for joint, k, multiplier, offset in self._folded]
        lengths = [math.hypot(*(joint.xyz or (0.0,))) for joint in self.robot.path(self.link)]
        lengths += [abs(value) for joint, value in values if joint.kind == "prismatic"]
        return max(1.0, sum(lengths), *(abs(value) for _, value in values), *map(abs, self.q))

    @cached_property
    def gain(self) -> float:
        """The largest of 1 and what the multipliers of one joint's followers add up to: each derivative grows by it."""
        sums = np.zeros(self.robot.n)
        for _, k, multiplier, _ in self._folded:
            sums[k] += abs(multiplier)
        return float(max(1.0, *sums, 1.0))

    @cached_property
    def _folded(self) -> list[tuple[JointSpec, int, float, float]]:
        return self.robot.folded(self.link)

    def to_urdf(self) -> str:
        """The robot's URDF, with link and posture in a last comment that :meth:`read` understands."""
        # Two hyphens would end a comment: everything is a string, in which JSON can escape them.
        note = json.dumps({"link": self.link, "q": [repr(value) for value in self.q]}).replace("-", "\\u002d")
        return f"{self.robot.to_urdf().rstrip()}\n{_NOTE}{note} -->\n"

    @classmethod
    def read(cls, robot: RobotSpec) -> Case | None:
        """The case that :meth:`to_urdf` noted in a robot's text, None when there is none."""
        _, start, rest = (robot.text or "").rpartition(_NOTE)
        if not start:
            return None
        try:
            note = json.loads(rest.partition(" -->")[0])
            return cls(robot, tuple(float(value) for value in note["q"]), note["link"])
        except (ValueError, KeyError, TypeError, InvalidPosture, UnknownName):
            return None


def rename(robot: RobotSpec, links: Mapping[str, str], joints: Mapping[str, str]) -> RobotSpec:
    """The same robot under other names.

    Args:
        robot: The robot.
        links: New name of each link.
        joints: New name of each joint.
    """
    renamed = tuple(
        replace(
            joint,
            name=joints[joint.name],
            parent=links[joint.parent],
            child=links[joint.child],
            mimic=None if joint.mimic is None else joints[joint.mimic],
        )
        for joint in robot.joints
    )
    return replace(robot, joints=renamed, links=tuple(links[link] for link in robot.links), text=None)


def _explicit(joint: JointSpec) -> JointSpec:
    zero = (0.0, 0.0, 0.0)
    joint = replace(joint, xyz=joint.xyz or zero, rpy=joint.rpy or zero)
    if joint.kind == "fixed":
        return joint
    x, y, z = joint.axis or (1.0, 0.0, 0.0)
    norm = math.hypot(x, y, z)
    joint = replace(joint, axis=(x / norm, y / norm, z / norm))
    if joint.kind != "continuous":
        joint = replace(joint, lower=joint.lower or 0.0, upper=joint.upper or 0.0)
    if joint.mimic is not None:
        multiplier = 1.0 if joint.multiplier is None else joint.multiplier
        joint = replace(joint, multiplier=multiplier, offset=joint.offset or 0.0)
    return joint


def _elements(joint: JointSpec) -> Iterator[str]:
    yield f"<parent link={quoteattr(joint.parent)}/>"
    yield f"<child link={quoteattr(joint.child)}/>"
    if joint.xyz is not None or joint.rpy is not None:
        yield f"<origin{_vector('xyz', joint.xyz)}{_vector('rpy', joint.rpy)}/>"
    if joint.axis is not None:
        yield f"<axis{_vector('xyz', joint.axis)}/>"
    if joint.kind in ("revolute", "prismatic"):
        # URDF wants effort and velocity, and has defaults for the others.
        limits = f"{_number('lower', joint.lower)}{_number('upper', joint.upper)}"
        yield f'<limit{limits} effort="1" velocity="1"/>'
    if joint.mimic is not None:
        values = f"{_number('multiplier', joint.multiplier)}{_number('offset', joint.offset)}"
        yield f"<mimic joint={quoteattr(joint.mimic)}{values}/>"


def _vector(key: str, values: Vector | None) -> str:
    return "" if values is None else f' {key}="{" ".join(repr(float(value)) for value in values)}"'


def _number(key: str, value: float | None) -> str:
    return "" if value is None else f' {key}="{float(value)!r}"'
