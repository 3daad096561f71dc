"""A rectangle in front of a link, from which a grid of taxels is cast onto it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from bodyimage_kin._shown import Shown
from bodyimage_kin.robot.nearest import nearest_on_shapes
from bodyimage_kin.robot.shapes import Surface, cast

Array3 = Float[np.ndarray, "3"]
Points = Float[np.ndarray, "count 3"]
_TURNS = 30
"""Steps in which the surface's point nearest to a ray is found."""


@dataclass(frozen=True, eq=False)
class Patch(Shown):
    """A rectangle in front of a link, from which taxels are cast onto its surface.

    Attributes:
        shape: Rows and columns of taxels.
        size: Height and width of the rectangle [m]; the outermost taxels lie on its border.
        centre: Its centre, in the link [m].
        forward: Unit vector out of the surface; rays run against it.
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

    @property
    def steps(self) -> Float[np.ndarray, "2"]:
        """Distance between rows, and between columns [m]."""
        return np.asarray(np.array(self.size) / np.maximum(np.array(self.shape) - 1, 1))

    def points(self, coordinates: Float[np.ndarray, "count 2"]) -> Points:
        """Points of the rectangle, in the link [m], at (row, column) coordinates that need not be whole."""
        aside = (coordinates - (np.array(self.shape) - 1) / 2) * self.steps
        return self.centre + aside[:, :1] * self.down + aside[:, 1:] * self.right


class Cast(NamedTuple):
    """Where the rays of a patch end, in the link.

    Attributes:
        points: [m]; NaN where there is no surface.
        normals: Outward unit normals; NaN likewise.
        beside: Whether the ray missed, and the surface passes within half a step of it.
    """

    points: Points
    normals: Points
    beside: Bool[np.ndarray, "count"]


def cast_patch(patch: Patch, surface: Surface, coordinates: Float[np.ndarray, "count 2"]) -> Cast:
    """Where the patch's rays meet a surface; of a ray that misses, the point nearest to it, within half a step."""
    origins = patch.points(coordinates)
    directions = np.broadcast_to(-patch.forward, origins.shape)
    points, normals = cast(surface, origins, directions)
    missed = np.isnan(points[:, 0])
    beside = np.zeros(len(points), dtype=bool)
    if missed.any() and not missed.all():
        depth = float(np.median((points[~missed] - origins[~missed]) @ -patch.forward))
        starts, along = origins[missed], np.full(int(missed.sum()), depth)
        for _ in range(_TURNS):
            near, facing, _ = nearest_on_shapes(surface, starts - along[:, None] * patch.forward)
            along = (near - starts) @ -patch.forward
        aside = np.linalg.norm(near - starts + along[:, None] * patch.forward, axis=1)
        there = (aside <= patch.steps.max() / 2) & (along >= 0.0)
        at = np.flatnonzero(missed)[there]
        points[at], normals[at], beside[at] = near[there], facing[there], True
    return Cast(points, normals, beside)


def cells(shape: tuple[int, int]) -> Float[np.ndarray, "taxels 2"]:
    """(row, column) of every cell."""
    return np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 2).astype(float)
