"""The checked kinematic tree of a URDF, before any backend sees it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Vector = tuple[float, float, float]
JointKind = Literal["revolute", "continuous", "prismatic", "fixed"]


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
class Joint:
    """One joint of the tree.

    Attributes:
        name: Unique among the joints (a link may bear the same name).
        kind: How it moves.
        parent: The link it hangs from.
        child: The link it moves.
        xyz: Where the child's frame is in the parent's at value zero [m].
        rpy: Its orientation there, fixed-axis roll, pitch, yaw [rad].
        axis: Unit vector in the child's frame.
        lower: Lower limit [rad or m]; -inf for continuous.
        upper: Upper limit [rad or m]; inf for continuous.
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
