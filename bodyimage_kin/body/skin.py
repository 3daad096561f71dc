"""The skin: a grid of taxels laid on a link's collision shape by rays from a rectangle in front of it.

Taxels are numbered ``row * columns + column``; columns grow along the patch's ``right``, rows along its ``down``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.spatial
import torch
from jaxtyping import Float, Int
from torch import Tensor

from bodyimage_kin._shown import Shown
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.robot.shapes import Shape, cast

__all__ = ["Array3", "Patch", "Points", "Skin", "cast_patch"]

Array3 = Float[np.ndarray, "3"]
Points = Float[np.ndarray, "count 3"]


@dataclass(frozen=True, eq=False)
class Patch(Shown):
    """A rectangle in front of a link, from which taxels are cast onto its shape.

    Attributes:
        shape: Rows and columns of taxels.
        size: Height and width of the rectangle [m]; the outermost taxels lie on its border.
        centre: Its centre, in the link [m].
        forward: Unit vector out of the face; rays run against it.
        right: Unit vector of growing column.
    """

    shape: tuple[int, int]
    size: tuple[float, float]
    centre: Array3
    forward: Array3
    right: Array3

    @property
    def down(self) -> Array3:
        """Unit vector of growing row."""
        return np.cross(self.forward, self.right)

    def points(self, coordinates: Float[np.ndarray, "count 2"]) -> Points:
        """Points of the rectangle, in the link [m], at (row, column) coordinates that need not be whole."""
        steps = np.array(self.size) / np.maximum(np.array(self.shape) - 1, 1)
        aside = (coordinates - (np.array(self.shape) - 1) / 2) * steps
        return self.centre + aside[:, :1] * self.down + aside[:, 1:] * self.right


@dataclass(frozen=True, eq=False)
class Skin(Shown):
    """Taxels on a link.

    Attributes:
        link: The link that bears them.
        shape: Rows and columns.
        positions: (rows * columns, 3) in the root, the robot at home [m].
        normals: (rows * columns, 3) outward unit vectors, in the root, the robot at home.
        landmarks: Name -> taxel.
        reference: Taxel where the hand rests at a reset.
        eye: Taxel in front of an optical centre inside of the body; None: the camera looks from outside.
        patch: How the taxels were laid.
        shapes: Collision shapes of the link.
        root_T_link: (4, 4) at home.
    """

    link: str
    shape: tuple[int, int]
    positions: Float[Tensor, "taxels 3"]
    normals: Float[Tensor, "taxels 3"]
    landmarks: Mapping[str, int]
    reference: int
    eye: int | None
    patch: Patch
    shapes: tuple[Shape, ...]
    root_T_link: Float[Tensor, "4 4"]

    @classmethod
    def lay(
        cls,
        link: str,
        patch: Patch,
        shapes: tuple[Shape, ...],
        root_T_link: Float[Tensor, "4 4"],
        landmarks: Mapping[str, int],
        reference: int,
        eye: int | None = None,
    ) -> Skin:
        """Casts the taxels onto the shapes.

        Raises:
            InvalidConfig: A ray that meets nothing: the patch is larger than the face, or lies inside of it.
        """
        points, normals = cast_patch(patch, shapes, _grid(patch.shape))
        if np.isnan(points).any():
            raise InvalidConfig(
                f"skin: {int(np.isnan(points[:, 0]).sum())} of {len(points)} taxels find no surface of link '{link}' "
                "to lie on; make 'size' smaller or move 'centre' forward"
            )
        rotation, position = root_T_link[:3, :3], root_T_link[:3, 3]
        return cls(
            link=link,
            shape=patch.shape,
            positions=torch.from_numpy(points) @ rotation.T + position,
            normals=torch.from_numpy(normals) @ rotation.T,
            landmarks=dict(landmarks),
            reference=reference,
            eye=eye,
            patch=patch,
            shapes=shapes,
            root_T_link=root_T_link,
        )

    def moved(self, link_T_skin: Float[np.ndarray, "4 4"]) -> Skin:
        """The same taxels, all moved on their link as one.

        Args:
            link_T_skin: Where the frame is that they were given in, in the link [m].
        """
        points = self.link_positions @ link_T_skin[:3, :3].T + link_T_skin[:3, 3]
        normals = self.link_normals @ link_T_skin[:3, :3].T
        rotation, position = self.root_T_link[:3, :3], self.root_T_link[:3, 3]
        return replace(
            self,
            positions=torch.from_numpy(points) @ rotation.T + position,
            normals=torch.from_numpy(normals) @ rotation.T,
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

    @property
    def count(self) -> int:
        """Number of taxels."""
        return self.shape[0] * self.shape[1]

    def surface(self, coordinates: Float[np.ndarray, "count 2"]) -> tuple[Points, Points]:
        """The skin at (row, column) coordinates that need not be whole.

        Returns:
            Points [m] and outward unit normals, in the link; NaN outside of the face.
        """
        return cast_patch(self.patch, self.shapes, coordinates)

    def coordinates(self, taxels: Int[np.ndarray, "count"]) -> Float[np.ndarray, "count 2"]:
        """(row, column) of taxels: T_i, their coordinates on the skin (equation 5)."""
        return np.stack(np.divmod(taxels, self.shape[1]), axis=-1).astype(float)

    def touched(self, centres: Points, radius: float, tolerance: float = 1e-3) -> Int[np.ndarray, "count"]:
        """The taxel that a hand touches, -1 where it touches none.

        The nearest taxel is touched when the hand is on the surface there, within the tolerance, and no farther from
        it sideways than three quarters of the distance to the next: a hand beside the patch touches nothing.

        Args:
            centres: Centres of the hand, in the link [m].
            radius: The hand's [m].
            tolerance: Largest gap between hand and skin that counts as touch [m].
        """
        tree, spacing = self._touching(radius)
        known = ~np.isnan(centres).any(axis=1)
        nearest = np.zeros(len(centres), dtype=np.int64)
        nearest[known] = tree.query(centres[known])[1]
        offset = centres - tree.data[nearest]
        normals = self.link_normals[nearest]
        height = (offset * normals).sum(axis=1)
        aside = np.linalg.norm(offset - height[:, None] * normals, axis=1)
        with np.errstate(invalid="ignore"):
            touching = known & (height <= tolerance) & (aside <= 0.75 * spacing[nearest])
        return np.where(touching, nearest, -1)

    @cached_property
    def link_positions(self) -> Points:
        """Taxel positions in the link [m]."""
        return ((self.positions - self.root_T_link[:3, 3]) @ self.root_T_link[:3, :3]).numpy()

    @cached_property
    def link_normals(self) -> Points:
        """Outward unit normals in the link."""
        return (self.normals @ self.root_T_link[:3, :3]).numpy()

    def _touching(self, radius: float) -> tuple[scipy.spatial.KDTree, Float[np.ndarray, "taxels"]]:
        """Where the hand's centre is on each taxel, and the distance from there to the next."""
        centres = self.link_positions + radius * self.link_normals
        tree = scipy.spatial.KDTree(centres)
        spacing = np.asarray(tree.query(centres, k=2)[0])[:, 1] if len(centres) > 1 else np.full(1, np.inf)
        return tree, spacing


def cast_patch(
    patch: Patch, shapes: tuple[Shape, ...], coordinates: Float[np.ndarray, "count 2"]
) -> tuple[Points, Points]:
    """Points and normals where the patch's rays meet the shapes, in the link."""
    origins = patch.points(coordinates)
    return cast(shapes, origins, np.broadcast_to(-patch.forward, origins.shape))


def _grid(shape: tuple[int, int]) -> Float[np.ndarray, "taxels 2"]:
    return np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 2).astype(float)
