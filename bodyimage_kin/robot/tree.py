"""The checked kinematic tree of a URDF, before any backend sees it, and its plain XML: all that a backend gets."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal
from xml.sax.saxutils import quoteattr

import numpy as np

from bodyimage_kin.robot import transforms
from bodyimage_kin.robot.transforms import Matrix4, Vector

__all__ = ["UNLIMITED", "Joint", "JointKind", "KinematicTree", "Mimic", "Placed", "welded", "write_core"]

JointKind = Literal["revolute", "continuous", "prismatic", "fixed"]
UNLIMITED: Final = sys.float_info.max
"""How a limit that is none is written, and read: what every parser takes, as XML has no infinity."""


class Placed:
    """What has a frame of its own, given as a URDF gives it.

    Attributes:
        xyz: Where that frame is in the one it is placed in [m].
        rpy: Its orientation there, fixed-axis roll, pitch, yaw [rad].
    """

    xyz: Vector
    rpy: Vector

    @cached_property
    def origin(self) -> Matrix4:
        """Both as a 4x4 transform (read-only): maps own coordinates to those of what it is placed in."""
        matrix = transforms.transform(transforms.rpy_matrix(self.rpy), self.xyz)
        matrix.flags.writeable = False
        return matrix


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another: value = multiplier * value of ``joint`` + offset.

    Attributes:
        joint: Name of the joint it follows (which may be a mimic itself).
        multiplier: [rad/rad, or as the kinds of the two joints say].
        offset: [rad or m].
    """

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Joint(Placed):
    """One joint of the tree; its ``origin`` is parent_T_child at value zero.

    Attributes:
        name: Unique among the joints (a link may bear the same name).
        kind: How it moves.
        parent: The link it hangs from.
        child: The link it moves.
        xyz: Where the child's frame is in the parent's at value zero [m].
        rpy: Its orientation there, fixed-axis roll, pitch, yaw [rad].
        axis: Unit vector in the child's frame.
        lower: Lower limit [rad or m]; -inf where there is none.
        upper: Upper limit [rad or m]; inf where there is none.
        mimic: What it follows, or None.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)
    axis: Vector = (1.0, 0.0, 0.0)
    lower: float = 0.0
    upper: float = 0.0
    mimic: Mimic | None = None


@dataclass(frozen=True)
class KinematicTree:
    """Links and joints as they stand in the file, known to form one tree.

    Attributes:
        name: The robot's name.
        root: The one link that is nobody's child.
        links: Every link's name, in order of appearance.
        joints: Every joint, in order of appearance.
    """

    name: str
    root: str
    links: tuple[str, ...]
    joints: tuple[Joint, ...]


def welded(joint: Joint, value: float) -> Joint:
    """The fixed joint that a joint is while it stands at a value [rad or m]."""
    fixed = replace(joint, kind="fixed", axis=(1.0, 0.0, 0.0), mimic=None, lower=0.0, upper=0.0)
    if value == 0.0 or joint.kind == "fixed":
        return fixed
    rotation = joint.origin[:3, :3]
    if joint.kind == "prismatic":
        x, y, z = np.asarray(joint.xyz) + rotation @ np.asarray(joint.axis) * value
        return replace(fixed, xyz=(float(x), float(y), float(z)))
    return replace(fixed, rpy=transforms.matrix_rpy(rotation @ transforms.axis_angle_matrix(joint.axis, value)))


def write_core(tree: KinematicTree) -> str:
    """The kinematics of a robot as URDF: links and joints only, with nothing left to a parser's defaults.

    Args:
        tree: A checked tree.

    Returns:
        XML without a declaration. Floats are written so that reading them back gives the same bits. Axes are left out
        of fixed joints, and limits of all but revolute and prismatic ones; no limit is :data:`UNLIMITED`.
    """
    lines = [f"<robot name={quoteattr(tree.name)}>"]
    lines += [f"  <link name={quoteattr(link)}/>" for link in tree.links]
    for joint in tree.joints:
        lines += [
            f'  <joint name={quoteattr(joint.name)} type="{joint.kind}">',
            f"    <parent link={quoteattr(joint.parent)}/>",
            f"    <child link={quoteattr(joint.child)}/>",
            f'    <origin xyz="{_numbers(*joint.xyz)}" rpy="{_numbers(*joint.rpy)}"/>',
        ]
        if joint.kind != "fixed":
            lines.append(f'    <axis xyz="{_numbers(*joint.axis)}"/>')
        if joint.kind in ("revolute", "prismatic"):
            # Other parsers demand effort and velocity; they mean nothing to kinematics.
            lower, upper = _numbers(max(joint.lower, -UNLIMITED)), _numbers(min(joint.upper, UNLIMITED))
            lines.append(f'    <limit lower="{lower}" upper="{upper}" effort="0" velocity="0"/>')
        if joint.mimic is not None:
            multiplier, offset = _numbers(joint.mimic.multiplier), _numbers(joint.mimic.offset)
            source = quoteattr(joint.mimic.joint)
            lines.append(f'    <mimic joint={source} multiplier="{multiplier}" offset="{offset}"/>')
        lines.append("  </joint>")
    lines.append("</robot>")
    return "\n".join(lines) + "\n"


def _numbers(*values: float) -> str:
    return " ".join(repr(float(value)) for value in values)
