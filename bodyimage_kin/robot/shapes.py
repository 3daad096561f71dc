"""What a link is touched on: rays against its primitive shapes, in closed form, and against its meshes.

A mesh of a sphere has edges, and ray libraries miss rays on the very edges of a box; a skin laid on the shapes
themselves has neither fault.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Bool, Float

from bodyimage_kin._shown import Shown
from bodyimage_kin.errors import InvalidGeometry
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.geometry import Box, Capsule, Collision, Cylinder, Mesh, Sphere, Visual
from bodyimage_kin.robot.meshes import Loaded, load_mesh, triangulate
from bodyimage_kin.robot.transforms import Matrix4
from bodyimage_kin.robot.triangles import Triangles
from bodyimage_kin.robot.upright import is_turned

__all__ = [
    "Found",
    "Parts",
    "Points",
    "Shape",
    "Surface",
    "blocked",
    "cast",
    "corners",
    "link_parts",
    "link_surface",
    "place_shape",
]

Points = Float[np.ndarray, "count 3"]
_ASIDE = 0.3
"""Collisions placed farther than this [m] from all that is seen of their link are looked at more closely."""


@dataclass(frozen=True, eq=False)
class Shape(Shown):
    """One convex primitive, in its link.

    Attributes:
        kind: Which one.
        size: Half extents of a box along x, y, z; (radius,) of a sphere; (radius, half length along z) of a cylinder,
            and of the cylinder between a capsule's half balls [m].
        link_T_shape: Where it is in the link.
    """

    kind: Literal["sphere", "box", "cylinder", "capsule"]
    size: tuple[float, ...]
    link_T_shape: Matrix4

    def crossing(
        self, origins: Points, directions: Points
    ) -> tuple[Float[np.ndarray, "count"], Float[np.ndarray, "count"]]:
        """Where the lines ``origin + t * direction`` enter and leave the shape, in units of ``direction``.

        Returns:
            t of entry and of exit; inf and -inf for a line that misses.
        """
        rotation, position = self.link_T_shape[:3, :3], self.link_T_shape[:3, 3]
        o, d = (origins - position) @ rotation, directions @ rotation
        if self.kind == "sphere":
            return _round(o, d, self.size[0])
        if self.kind == "box":
            return _common([_slab(o[:, axis], d[:, axis], self.size[axis]) for axis in range(3)])
        tube = _common([_round(o[:, :2], d[:, :2], self.size[0]), _slab(o[:, 2], d[:, 2], self.size[1])])
        if self.kind == "cylinder":
            return tube
        along = np.array([0.0, 0.0, self.size[1]])
        ends = [_round(o + end, d, self.size[0]) for end in (along, -along)]
        # A convex whole of three parts: a line is in it from the first part's entry to the last one's exit.
        return _whole([tube, *ends])

    def normals(self, points: Points) -> Points:
        """Outward unit normals at points of the surface, all in the link."""
        rotation, position = self.link_T_shape[:3, :3], self.link_T_shape[:3, 3]
        p = (points - position) @ rotation
        if self.kind == "sphere":
            normal = p / self.size[0]
        elif self.kind == "box":
            closeness = np.abs(p) / np.asarray(self.size)
            normal = np.eye(3)[closeness.argmax(axis=1)] * np.sign(p)
        elif self.kind == "capsule":
            along = np.clip(p[:, 2], -self.size[1], self.size[1])
            normal = p - along[:, None] * [0.0, 0.0, 1.0]
        else:
            around = np.concatenate([p[:, :2] / self.size[0], np.zeros((len(p), 1))], axis=1)
            cap = np.array([0.0, 0.0, 1.0]) * np.sign(p[:, 2:])
            on_cap = np.abs(p[:, 2]) / self.size[1] > np.linalg.norm(p[:, :2], axis=1) / self.size[0]
            normal = np.where(on_cap[:, None], cap, around)
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        return np.asarray(normal @ rotation.T)


Surface: TypeAlias = "tuple[Shape | Triangles, ...]"
"""Shapes and meshes that together are what a link is touched on."""


class Found(NamedTuple):
    """The surface of a link.

    Attributes:
        surface: What it is touched on.
        notes: What was mended, and what is used in place of something that is not there.
    """

    surface: Surface
    notes: tuple[str, ...]


class Parts(NamedTuple):
    """The shapes that stand for a link.

    Attributes:
        elements: Its collisions, or what is seen of it.
        notes: Why these, where they are not its collisions.
    """

    elements: tuple[Collision | Visual, ...]
    notes: tuple[str, ...]


def link_parts(robot: Robot, link: str, mesh_folder: Path | None = None) -> Parts:
    """The shapes that stand for a link: its collisions, or else what is seen of it.

    What is seen stands for the link also where its collisions lie far beside it, for then their place is a slip of the
    file.

    Args:
        robot: The robot.
        link: Its link.
        mesh_folder: As of :func:`bodyimage_kin.robot.meshes.triangulate`.

    Raises:
        UnknownName: No such link.
    """
    geometry = robot.geometry[robot.check_link(link)]
    if not geometry.collisions:
        return Parts(
            geometry.visuals,
            (f"link '{link}' has no collision shape: what is seen of it stands for it",) if geometry.visuals else (),
        )
    gap = _gap(robot, link, mesh_folder)
    if gap == 0.0:
        return Parts(geometry.collisions, ())
    return Parts(
        geometry.visuals,
        (
            f"the collisions of link '{link}' lie {gap:.2f} m beside what is seen of it, which stands for it; mend "
            "<origin> of <collision> (are xyz and rpy exchanged?)",
        ),
    )


def corners(
    element: Collision | Visual, robot: Robot, link: str, mesh_folder: Path | None = None
) -> Float[np.ndarray, "vertices 3"]:
    """The vertices of a shape of a link, round ones as facets, in the link [m].

    Args:
        element: The shape and its place.
        robot: The robot.
        link: Whose it is.
        mesh_folder: As of :func:`bodyimage_kin.robot.meshes.triangulate`.

    Raises:
        InvalidGeometry: A mesh that is missing or cannot be read.
    """
    folder = mesh_folder or robot.mesh_folder
    mesh = triangulate(element.shape, link, robot.file, folder, is_turned(robot, mesh_folder))
    return np.asarray(mesh.vertices @ element.origin[:3, :3].T + element.origin[:3, 3])


def _gap(robot: Robot, link: str, mesh_folder: Path | None) -> float:
    """How far a link's collisions lie beside what is seen of it, where that is more than it is large; else 0 [m]."""
    geometry = robot.geometry[link]
    pairs = itertools.product(geometry.collisions, geometry.visuals)
    if min((math.dist(one.xyz, other.xyz) for one, other in pairs), default=0.0) <= _ASIDE:
        return 0.0
    try:
        solid, seen = (
            np.concatenate([corners(one, robot, link, mesh_folder) for one in elements])
            for elements in (geometry.collisions, geometry.visuals)
        )
    except InvalidGeometry:
        return 0.0
    between = np.maximum(solid.min(0) - seen.max(0), seen.min(0) - solid.max(0)).clip(0.0)
    gap = float(np.linalg.norm(between))
    return gap if gap > float(np.linalg.norm(np.ptp(seen, axis=0))) else 0.0


def link_surface(robot: Robot, link: str, mesh_folder: Path | None = None) -> Found:
    """What a link is touched on: the surface of its parts.

    Args:
        robot: The robot.
        link: Its link.
        mesh_folder: As of :func:`bodyimage_kin.robot.meshes.triangulate`.

    Raises:
        UnknownName: No such link.
        InvalidGeometry: The link has no shape, one that cannot be read, or a mesh that is missing.
    """
    elements, notes = link_parts(robot, link, mesh_folder)
    geometry = robot.geometry[link]
    geometry.check("collision")
    if not geometry.collisions:
        geometry.check("visual")
    if not elements:
        raise InvalidGeometry(
            f"link '{link}' has no shape that a skin can lie on; state one (a sphere, box or cylinder), or name another"
            " link"
        )
    folder, turn = mesh_folder or robot.mesh_folder, is_turned(robot, mesh_folder)
    parts = [place_shape(element, link, robot.file, folder, turn) for element in elements]
    return Found(
        tuple(shape for one in parts for shape in one.surface), (*notes, *(note for one in parts for note in one.notes))
    )


def place_shape(
    element: Collision | Visual,
    link: str,
    file: Path | None = None,
    mesh_folder: Path | None = None,
    turned: bool = False,
) -> Found:
    """A shape of a link as rays meet it.

    Args:
        element: The shape and its place.
        link: Whose it is, for errors.
        file: The URDF's own, beside which meshes lie.
        mesh_folder: As of :func:`bodyimage_kin.robot.meshes.triangulate`.
        turned: As of :func:`bodyimage_kin.robot.meshes.triangulate`.

    Raises:
        InvalidGeometry: A mesh that is missing or cannot be read.
    """
    match element.shape:
        case Sphere(radius):
            shape = Shape("sphere", (radius,), element.origin)
        case Box(size):
            shape = Shape("box", tuple(side / 2 for side in size), element.origin)
        case Cylinder(radius, length):
            shape = Shape("cylinder", (radius, length / 2), element.origin)
        case Capsule(radius, length):
            shape = Shape("capsule", (radius, length / 2), element.origin)
        case Mesh():
            return _mesh(load_mesh(element.shape, link, file, mesh_folder, turned), element.shape, element.origin, link)
    return Found((shape,), ())


def _mesh(loaded: Loaded, mesh: Mesh, origin: Matrix4, link: str) -> Found:
    surface, notes = Triangles.of(loaded.mesh, origin), loaded.notes
    if surface.border:
        notes += (
            f"mesh {mesh.filename} of link '{link}' is open ({surface.border} edges at its border): rays from outside "
            "meet it all the same, nothing is inside of it",
        )
    return Found((surface,), notes)


def cast(shapes: Surface, origins: Points, directions: Points) -> tuple[Points, Points]:
    """Where rays first meet one of the shapes from outside.

    Returns:
        Points and outward unit normals, in the link; NaN where a ray meets nothing.
    """
    nearest = np.full(len(origins), np.inf)
    points, normals = np.full_like(origins, np.nan), np.full_like(origins, np.nan)
    for shape in shapes:
        if isinstance(shape, Triangles):
            times, facing = shape.cast(origins, directions)
            first = times < nearest
            nearest[first], normals[first] = times[first], facing[first]
            points[first] = origins[first] + times[first, None] * directions[first]
            continue
        enter, leave = shape.crossing(origins, directions)
        first = (enter <= leave) & (enter >= 0.0) & (enter < nearest)
        if first.any():
            nearest[first] = enter[first]
            points[first] = origins[first] + enter[first, None] * directions[first]
            normals[first] = shape.normals(points[first])
    return points, normals


def blocked(shapes: Surface, starts: Points, ends: Points) -> Bool[np.ndarray, "count"]:
    """Whether the segment between two points passes through more than a micrometre of a shape."""
    through = np.zeros(len(starts), dtype=bool)
    lengths = np.linalg.norm(ends - starts, axis=1)
    for shape in shapes:
        if isinstance(shape, Triangles):
            through |= shape.blocks(starts, ends)
            continue
        enter, leave = shape.crossing(starts, ends - starts)
        inside = np.maximum(np.minimum(leave, 1.0) - np.maximum(enter, 0.0), 0.0)
        through |= inside * lengths > 1e-6
    return through


def _round(
    o: Float[np.ndarray, "count d"], d: Float[np.ndarray, "count d"], radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """Entry and exit of a ball (or disc) about zero."""
    a, b, c = (d * d).sum(1), (o * d).sum(1), (o * o).sum(1) - radius**2
    root = b * b - a * c
    moving = a > 0.0
    reach = np.sqrt(np.maximum(root, 0.0))
    safe = np.where(moving, a, 1.0)
    hit = np.where(moving, root >= 0.0, c <= 0.0)
    enter = np.where(moving, (-b - reach) / safe, -np.inf)
    leave = np.where(moving, (-b + reach) / safe, np.inf)
    return np.where(hit, enter, np.inf), np.where(hit, leave, -np.inf)


def _slab(o: Float[np.ndarray, "count"], d: Float[np.ndarray, "count"], half: float) -> tuple[np.ndarray, np.ndarray]:
    """Entry and exit of the slab between -half and half."""
    moving = d != 0.0
    safe = np.where(moving, d, 1.0)
    one, other = (-half - o) / safe, (half - o) / safe
    inside = np.abs(o) <= half
    enter = np.where(moving, np.minimum(one, other), np.where(inside, -np.inf, np.inf))
    leave = np.where(moving, np.maximum(one, other), np.where(inside, np.inf, -np.inf))
    return enter, leave


def _whole(crossings: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Entry into the first and exit from the last of parts that together are convex."""
    return np.min([enter for enter, _ in crossings], axis=0), np.max([leave for _, leave in crossings], axis=0)


def _common(crossings: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Entry and exit of what all have in common."""
    enter = np.max([enter for enter, _ in crossings], axis=0)
    leave = np.min([leave for _, leave in crossings], axis=0)
    missed = enter > leave
    return np.where(missed, np.inf, enter), np.where(missed, -np.inf, leave)
