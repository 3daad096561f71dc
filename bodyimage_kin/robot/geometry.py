"""What a URDF says of its links beside kinematics: what they look like, where they can be touched, what they weigh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float

from bodyimage_kin.errors import InvalidGeometry
from bodyimage_kin.robot.transforms import Vector
from bodyimage_kin.robot.tree import Placed

__all__ = [
    "Box",
    "Capsule",
    "Collision",
    "Colour",
    "Cylinder",
    "Inertial",
    "LinkGeometry",
    "Mesh",
    "Part",
    "Shape",
    "Sphere",
    "Visual",
]

Colour = tuple[float, float, float, float]
Part = Literal["visual", "collision", "inertial"]


@dataclass(frozen=True)
class Box:
    """A box about the origin.

    Attributes:
        size: Its sides along x, y and z [m].
    """

    size: Vector


@dataclass(frozen=True)
class Sphere:
    """A ball about the origin.

    Attributes:
        radius: [m].
    """

    radius: float


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along z, the origin in its middle.

    Attributes:
        radius: [m].
        length: [m].
    """

    radius: float
    length: float


@dataclass(frozen=True)
class Capsule:
    """A cylinder along z between two half balls, the origin in its middle.

    Attributes:
        radius: Of all three [m].
        length: Of the cylinder alone [m].
    """

    radius: float
    length: float


@dataclass(frozen=True)
class Mesh:
    """Triangles from a file; :func:`bodyimage_kin.robot.meshes.load_mesh` reads them.

    Attributes:
        filename: As the URDF has it: a path, ``file://`` or ``package://``.
        scale: Factor along x, y and z; negative ones mirror.
    """

    filename: str
    scale: Vector = (1.0, 1.0, 1.0)


Shape: TypeAlias = "Box | Sphere | Cylinder | Capsule | Mesh"


@dataclass(frozen=True)
class Visual(Placed):
    """Something to see; its ``origin`` is link_T_visual.

    Attributes:
        shape: What it is.
        xyz: Where it is in the link [m].
        rpy: How it is turned there, fixed-axis roll, pitch, yaw [rad].
        material: Name of its material; empty when it has none.
        colour: Red, green, blue and opacity, 0 to 1; None where the file gives none.
    """

    shape: Shape
    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)
    material: str = ""
    colour: Colour | None = None


@dataclass(frozen=True)
class Collision(Placed):
    """Something to touch; its ``origin`` is link_T_collision.

    Attributes:
        shape: What it is.
        xyz: Where it is in the link [m].
        rpy: How it is turned there, fixed-axis roll, pitch, yaw [rad].
    """

    shape: Shape
    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Inertial(Placed):
    """Mass and its distribution; its ``origin`` is link_T_inertial, at the centre of mass.

    Attributes:
        mass: [kg].
        moments: ixx, ixy, ixz, iyy, iyz, izz about the centre of mass, in the inertial's axes [kg m^2]; None where the
            file gives a mass alone.
        xyz: The centre of mass in the link [m].
        rpy: How the axes are turned there, fixed-axis roll, pitch, yaw [rad].
    """

    mass: float
    moments: tuple[float, float, float, float, float, float] | None = None
    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)

    @property
    def inertia(self) -> Float[np.ndarray, "3 3"]:
        """The moments as a symmetric matrix [kg m^2].

        Raises:
            InvalidGeometry: The file gives none.
        """
        if self.moments is None:
            raise InvalidGeometry("an inertial with a mass alone; add <inertia>")
        xx, xy, xz, yy, yz, zz = self.moments
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@dataclass(frozen=True)
class LinkGeometry:
    """What one link has beside its frame.

    Attributes:
        visuals: In the file's order, those that can be read.
        collisions: Likewise.
        inertial: None when there is none, or none that can be read.
        problems: Part and problem of each that cannot be read. :meth:`check` raises them where the part is needed.
    """

    visuals: tuple[Visual, ...] = ()
    collisions: tuple[Collision, ...] = ()
    inertial: Inertial | None = None
    problems: tuple[tuple[Part, str], ...] = ()

    def check(self, part: Part) -> None:
        """Makes sure that nothing of a kind was left out.

        Raises:
            InvalidGeometry: A visual, collision or inertial that cannot be read, with element, line and remedy.
        """
        for kind, problem in self.problems:
            if kind == part:
                raise InvalidGeometry(problem)
