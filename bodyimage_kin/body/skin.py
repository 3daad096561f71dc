"""The skin: taxels with places, outward normals and a graph of neighbours on a link; a grid is one kind.

A grid is laid by rays from a rectangle in front of a link, on its shapes or meshes or on a stated shape
(:meth:`Skin.grid`); any other skin is given by its points (:meth:`Skin.points`). Taxels are numbered; those of a whole
grid ``row * columns + column``, columns growing along the patch's ``right``, rows along its ``down``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.spatial
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin._shown import Shown
from bodyimage_kin.body import graph
from bodyimage_kin.body._laying import laid_by_points, laid_by_rays
from bodyimage_kin.body._patch import Array3, Points, cast_patch
from bodyimage_kin.body._patch import Patch as Patch
from bodyimage_kin.body._rigid import rigid
from bodyimage_kin.errors import InvalidGeometry
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.geometry import Box, Capsule, Collision, Cylinder, Sphere
from bodyimage_kin.robot.shapes import Surface, link_surface
from bodyimage_kin.robot.triangles import Triangles

__all__ = ["Patch", "Place", "Skin"]

Place = str | int | Sequence[int]
"""A taxel: by the name of a landmark, by its number, or, on a grid, as [row, column]."""


@dataclass(frozen=True, eq=False)
class Skin(Shown):
    """Taxels on a link. Lay one with :meth:`grid` or :meth:`points`.

    Attributes:
        link: The link that bears them.
        positions: (taxels, 3) in the root, the robot at home [m]; in the link until an embodiment bears it.
        normals: (taxels, 3) outward unit vectors, likewise.
        neighbours: (edges, 2) pairs of taxels that are next to each other.
        forward: Unit vector in the link, out of what the skin covers: motions in front of the skin go along it.
        right: Unit vector in the link, to the right as an eye that looks forward sees it.
        landmarks: Name -> taxel.
        reference: Taxel where the hand rests at a reset.
        eye: Taxel in front of an optical centre inside of the body; None: the camera looks from outside.
        layout: How a grid was laid; None: its taxels were given.
        cells: (taxels,) cell of each taxel of a grid with holes, ``row * columns + column``; None: there are none.
        ids: (taxels,) the number of each in its maker's tables; None: that of the taxel.
        units: (taxels,) the mounted unit, such as a triangle of ten, that each belongs to; None: not known.
        surface: What the link is touched on, and what hides the hand; None: not looked for yet.
        link_T_skin: (4, 4) where the skin was moved to on its link.
        stated: The shape on which a grid was laid in place of the link's own; None: the link's.
        mesh_folder: Where meshes of the link may lie; None: beside the URDF.
        notes: What was mended, and what is to be known of it.
        in_link: Places and normals in the link, of a skin given by points; None: of a grid they follow from the root's.
        root_T_link: (4, 4) at home.
    """

    link: str
    positions: Float[Tensor, "taxels 3"]
    normals: Float[Tensor, "taxels 3"]
    neighbours: Int[np.ndarray, "edges 2"]
    forward: Array3
    right: Array3
    landmarks: Mapping[str, int]
    reference: int
    eye: int | None = None
    layout: Patch | None = None
    cells: Int[np.ndarray, "taxels"] | None = None
    ids: Int[np.ndarray, "taxels"] | None = None
    units: Int[np.ndarray, "taxels"] | None = None
    surface: Surface | None = None
    link_T_skin: Float[np.ndarray, "4 4"] = field(default_factory=lambda: np.eye(4))
    stated: Collision | None = None
    mesh_folder: Path | None = None
    notes: tuple[str, ...] = ()
    in_link: tuple[Points, Points] | None = None
    root_T_link: Float[Tensor, "4 4"] = field(default_factory=lambda: torch.eye(4, dtype=torch.float64))

    @classmethod
    def grid(
        cls,
        robot: Robot,
        link: str,
        *,
        shape: tuple[int, int] = (21, 21),
        size: tuple[float, float],
        centre: ArrayLike,
        forward: ArrayLike,
        right: ArrayLike,
        landmarks: Mapping[str, Place] | None = None,
        reference: Place | None = None,
        eye: Place | None = None,
        on: Collision | Sphere | Box | Cylinder | Capsule | None = None,
        touch_forward: ArrayLike | None = None,
        touch_right: ArrayLike | None = None,
        mesh_folder: str | Path | None = None,
    ) -> Skin:
        """A grid of taxels, cast by parallel rays from a rectangle onto a link.

        The link's collision shapes and meshes are met, or else its visuals; a taxel whose ray misses lies at the
        nearest place of the surface within half a step, and where there is none the grid has a hole: its :attr:`shape`
        is then None, its taxels are numbered without gaps, and :attr:`mask` tells of the cells. Notes say so.

        Args:
            robot: The robot.
            link: The link that bears the taxels.
            shape: Rows and columns.
            size: Height and width of the rectangle [m]; the outermost taxels lie on its border.
            centre: Its centre, in the link [m].
            forward: Out of the surface, in the link; rays run against it.
            right: Of growing column, in the link, orthogonal to ``forward``.
            landmarks: Name -> [row, column] (or number of the cell).
            reference: Where the hand rests at a reset; None: the middle taxel.
            eye: The taxel in front of an optical centre inside of the body; None: the camera looks from outside.
            on: A shape to lie on in place of the link's own, without touching the URDF: a sphere, box, cylinder or
                capsule about the link's origin, or a ``Collision`` with its place. It is also what the hand touches.
            touch_forward: As :attr:`forward`; None: that of the rays.
            touch_right: As :attr:`right`; None: that of the columns.
            mesh_folder: Where meshes may lie, subfolders included; None: beside the URDF.

        Raises:
            UnknownName: No such link or landmark.
            InvalidConfig: A setting out of its range, or less than half of the rays find a surface.
            InvalidGeometry: A link without any shape, or a mesh that is missing or cannot be read.
        """
        laid = laid_by_rays(
            robot, link, shape, size, centre, (forward, right), landmarks, reference, eye, on,
            (touch_forward, touch_right), mesh_folder,
        )  # fmt: skip
        return cls(**laid)

    @classmethod
    def points(
        cls,
        positions: ArrayLike,
        normals: ArrayLike | None = None,
        neighbours: ArrayLike | None = None,
        *,
        link: str,
        forward: ArrayLike | None = None,
        right: ArrayLike | None = None,
        landmarks: Mapping[str, Place] | None = None,
        reference: Place | None = None,
        eye: Place | None = None,
        inside: ArrayLike = (0.0, 0.0, 0.0),
        ids: ArrayLike | None = None,
        units: ArrayLike | None = None,
        mesh_folder: str | Path | None = None,
        notes: Sequence[str] = (),
    ) -> Skin:
        """A skin of taxels anywhere on a link.

        Args:
            positions: (taxels, 3) in the link [m].
            normals: (taxels, 3) outward, of any length; None, and of length zero: the smallest principal axis of a
                taxel and the eight around it, away from ``inside``.
            neighbours: (edges, 2) pairs of taxels next to each other; None: those nearer than two spacings, a spacing
                being the median distance to the next taxel.
            link: The link that bears them.
            forward: As :attr:`forward`, of any length; None: the mean normal.
            right: As :attr:`right`; None: level, the link's z being up.
            landmarks: Name -> taxel.
            reference: Where the hand rests at a reset; None: the taxel nearest to the middle.
            eye: The taxel in front of an optical centre inside of the body; None: the camera looks from outside.
            inside: A point inside of the link [m], from which computed normals point away.
            ids: As :attr:`ids`.
            units: As :attr:`units`.
            mesh_folder: Where meshes of the link may lie, subfolders included; None: beside the URDF.
            notes: What is already known to be odd of it.

        Returns:
            The skin; :attr:`notes` tells of mended normals, of taxels in one place and of pieces of the graph.

        Raises:
            InvalidConfig: No taxels, places that are not finite, pairs of no taxels, or a setting out of its range.
            UnknownName: A landmark that does not exist.
        """
        laid = laid_by_points(
            positions, normals, neighbours, link, (forward, right), landmarks, reference, eye, inside, ids, units,
            mesh_folder, notes,
        )  # fmt: skip
        return cls(**laid)

    def borne_by(self, robot: Robot, root_T_link: Float[Tensor, "4 4"]) -> Skin:
        """The same skin on its link of a robot, whose shapes are what hides the hand where none is stated.

        Args:
            robot: The robot.
            root_T_link: Where the link is at home.
        """
        skin = self.at(root_T_link)
        if skin.surface is not None:
            return skin
        try:
            found = link_surface(robot, self.link, self.mesh_folder)
        except InvalidGeometry as problem:
            note = f"nothing of link '{self.link}' hides the hand or can be touched in dynamics: {problem}"
            return replace(skin, surface=(), notes=(*skin.notes, note))
        return replace(skin, surface=found.surface, notes=(*skin.notes, *found.notes))

    def moved(self, link_T_skin: Float[np.ndarray, "4 4"]) -> Skin:
        """The same taxels, all moved on their link as one; the directions of touch stay.

        Args:
            link_T_skin: Where the frame is that they were given in, in the link [m].
        """
        pose = rigid("link_T_skin", link_T_skin)
        points = self.link_positions @ pose[:3, :3].T + pose[:3, 3]
        normals = self.link_normals @ pose[:3, :3].T
        rotation, position = self.root_T_link[:3, :3], self.root_T_link[:3, 3]
        return replace(
            self,
            positions=torch.from_numpy(points) @ rotation.T + position,
            normals=torch.from_numpy(normals) @ rotation.T,
            link_T_skin=pose @ self.link_T_skin,
            in_link=None if self.in_link is None else (points, normals),
        )

    def at(self, root_T_link: Float[Tensor, "4 4"]) -> Skin:
        """The same skin, its link elsewhere; itself when that is where it is already."""
        if torch.equal(root_T_link, self.root_T_link):
            return self
        rotation, position = root_T_link[:3, :3], root_T_link[:3, 3]
        return replace(
            self,
            positions=torch.from_numpy(self.link_positions) @ rotation.T + position,
            normals=torch.from_numpy(self.link_normals) @ rotation.T,
            root_T_link=root_T_link,
        )

    # Numbers ---------------------------------------------------------------------------------------------------------

    @property
    def count(self) -> int:
        """Number of taxels."""
        return len(self.positions)

    @property
    def shape(self) -> tuple[int, int] | None:
        """Rows and columns of a whole grid; None of any other skin."""
        return self.layout.shape if self.layout is not None and self.cells is None else None

    @property
    def mask(self) -> Bool[np.ndarray, "rows columns"] | None:
        """Which cells of a grid have a taxel; None of a skin that is no grid."""
        if self.layout is None:
            return None
        there = np.ones(self.layout.shape, dtype=bool)
        if self.cells is not None:
            there.ravel()[np.setdiff1d(np.arange(there.size), self.cells)] = False
        return there

    def taxels_of(self, ids: ArrayLike) -> Int[np.ndarray, "*samples"]:
        """Taxels by their makers' numbers, whatever their shape; -1 for what is no taxel: a pad, an unmounted unit."""
        given = np.asarray(ids, dtype=np.int64)
        own = np.arange(self.count) if self.ids is None else self.ids
        order = np.argsort(own)
        found = np.minimum(np.searchsorted(own[order], given), self.count - 1)
        return np.asarray(np.where(own[order][found] == given, order[found], -1))

    # Distances -------------------------------------------------------------------------------------------------------

    @cached_property
    def spacing(self) -> float:
        """Median distance of a taxel to the next one [m]; 0 of a single one."""
        return graph.spacing_of(self.link_positions)

    @property
    def distances(self) -> Float[np.ndarray, "taxels taxels"]:
        """Between all pairs: on a whole grid Euclidean in its units, else along the graph in spacings.

        Between pieces of the graph they are straight.
        """
        if self.shape is not None:
            places = self.coordinates(np.arange(self.count))
            return np.asarray(scipy.spatial.distance.cdist(places, places))
        return np.asarray(self._along[0] / (self.spacing or 1.0))

    @cached_property
    def _along(self) -> tuple[Float[np.ndarray, "taxels taxels"], Int[np.ndarray, "taxels taxels"]]:
        return graph.along(self.link_positions, self.neighbours)

    @cached_property
    def pieces(self) -> int:
        """Pieces of the graph of neighbours."""
        return graph.pieces(self.count, self.neighbours)[0]

    # Places ----------------------------------------------------------------------------------------------------------

    @property
    def middle(self) -> int:
        """The taxel in the middle: of a whole grid by row and column, else the one nearest to the mean place."""
        if self.shape is not None:
            return (self.shape[0] // 2) * self.shape[1] + self.shape[1] // 2
        return int(np.linalg.norm(self.link_positions - self.link_positions.mean(0), axis=1).argmin())

    @property
    def down(self) -> Array3:
        """Unit vector in the link, downward as an eye that looks forward sees it."""
        return np.cross(self.forward, self.right)

    def surface_at(self, coordinates: Float[np.ndarray, "count d"]) -> tuple[Points, Points]:
        """The skin at coordinates between taxels.

        Args:
            coordinates: As of :meth:`coordinates`.

        Returns:
            Points [m] and outward unit normals, in the link; NaN outside of a grid's link.
        """
        if self.shape is None or self.layout is None:
            normals = coordinates[:, 3:]
            return coordinates[:, :3], normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        points, normals, _ = cast_patch(self.layout, self.surface or (), coordinates)
        if np.array_equal(self.link_T_skin, np.eye(4)):
            return points, normals
        rotation = self.link_T_skin[:3, :3]
        return points @ rotation.T + self.link_T_skin[:3, 3], normals @ rotation.T

    def coordinates(self, taxels: Int[np.ndarray, "count"]) -> Float[np.ndarray, "count d"]:
        """Coordinates of taxels on the skin, along which the hand slides.

        Those of a whole grid are (row, column): T_i of equation 5; of any other skin place and normal in the link.
        """
        if self.shape is None:
            return np.concatenate([self.link_positions[taxels], self.link_normals[taxels]], axis=1)
        return np.stack(np.divmod(taxels, self.shape[1]), axis=-1).astype(float)

    def way(self, start: int, end: int) -> list[int]:
        """Taxels between which the hand slides straight from one to another: of a whole grid these two alone.

        On any other skin it follows the graph; from piece to piece it goes straight.
        """
        if self.shape is not None or start == end:
            return [start, end]
        before = self._along[1][start]
        found = [end]
        while found[-1] != start:
            if before[found[-1]] < 0:
                return [start, end]
            found.append(int(before[found[-1]]))
        return found[::-1]

    def touched(self, centres: Points, radius: float, tolerance: float = 1e-3) -> Int[np.ndarray, "count"]:
        """The taxel that a hand touches, -1 where it touches none.

        The nearest taxel is touched when the hand is on the surface there, within the tolerance, and no farther from
        it sideways than three quarters of the distance to the next, or of a skin that is no grid nine tenths of it or
        of the spacing: a hand beside the skin touches nothing.

        Args:
            centres: Centres of the hand, in the link [m].
            radius: The hand's [m].
            tolerance: Largest gap between hand and skin that counts as touch [m].
        """
        tree, reach = self._touching(radius)
        known = ~np.isnan(centres).any(axis=1)
        nearest = np.zeros(len(centres), dtype=np.int64)
        nearest[known] = tree.query(centres[known])[1]
        offset = centres - tree.data[nearest]
        normals = self.link_normals[nearest]
        height = (offset * normals).sum(axis=1)
        aside = np.linalg.norm(offset - height[:, None] * normals, axis=1)
        with np.errstate(invalid="ignore"):
            touching = known & (height <= tolerance) & (aside <= reach[nearest])
        return np.where(touching, nearest, -1)

    @property
    def touched_surface(self) -> Surface:
        """What a hand is dragged on: the surface, its meshes replaced by their convex hulls.

        Raises:
            InvalidGeometry: The link has no surface.
        """
        if not self.surface:
            raise InvalidGeometry(
                f"link '{self.link}', which bears the skin, has no shape that a hand can be dragged on; use "
                "dynamics=False, or give the link a collision shape"
            )
        return tuple(shape.hull if isinstance(shape, Triangles) else shape for shape in self.surface)

    @cached_property
    def link_positions(self) -> Points:
        """Taxel positions in the link [m]."""
        if self.in_link is not None:
            return self.in_link[0]
        return ((self.positions - self.root_T_link[:3, 3]) @ self.root_T_link[:3, :3]).numpy()

    @cached_property
    def link_normals(self) -> Points:
        """Outward unit normals in the link."""
        if self.in_link is not None:
            return self.in_link[1]
        return (self.normals @ self.root_T_link[:3, :3]).numpy()

    def _touching(self, radius: float) -> tuple[scipy.spatial.KDTree, Float[np.ndarray, "taxels"]]:
        """Where the hand's centre is on each taxel, and how far aside of it that one is still touched."""
        centres = self.link_positions + radius * self.link_normals
        tree = scipy.spatial.KDTree(centres)
        spacing = np.asarray(tree.query(centres, k=2)[0])[:, 1] if len(centres) > 1 else np.full(1, np.inf)
        return tree, 0.75 * spacing if self.shape is not None else 0.9 * np.maximum(spacing, self.spacing)
