"""A surface of triangles in a link: rays against it, its nearest points, its convex hull.

Everything is computed in double precision, in a tree of boxes; libraries for rays work in single precision, in which a
taxel lies a tenth of a micrometre beside the surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.spatial
from jaxtyping import Bool, Float, Int

from bodyimage_kin.robot import _triangle_kernels

if TYPE_CHECKING:
    import trimesh

__all__ = ["Triangles"]

Points = Float[np.ndarray, "count 3"]
_LEAF = 6
_CREASE = np.cos(np.radians(40.0))
"""Triangles that meet at a sharper angle than this keep normals of their own."""
_MARGIN = 1e-6  # [m]


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles of one link, wound so that their normals point outward.

    Attributes:
        vertices: In the link [m]; each place once.
        faces: Three vertices each.
    """

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]

    @classmethod
    def of(cls, mesh: trimesh.Trimesh, link_T_mesh: Float[np.ndarray, "4 4"]) -> Triangles:
        """The triangles of a mesh: doubled vertices are merged, triangles without area left out, all wound outward.

        Args:
            mesh: In its own coordinates [m].
            link_T_mesh: Where these are in the link.
        """
        mesh = mesh.copy()
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        mesh.update_faces(mesh.nondegenerate_faces())
        mesh.fix_normals(multibody=True)
        vertices = np.asarray(mesh.vertices, dtype=np.float64)
        faces = np.asarray(mesh.faces, dtype=np.int64)
        return cls(vertices @ link_T_mesh[:3, :3].T + link_T_mesh[:3, 3], faces)

    @cached_property
    def border(self) -> int:
        """Edges that only one triangle has: 0 of a closed surface."""
        edges = np.sort(self.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        return int((np.unique(edges, axis=0, return_counts=True)[1] == 1).sum())

    @cached_property
    def hull(self) -> Triangles:
        """The convex hull."""
        hull = scipy.spatial.ConvexHull(self.vertices)
        kept, faces = np.unique(hull.simplices, return_inverse=True)
        faces = faces.reshape(hull.simplices.shape)
        vertices = self.vertices[kept]
        across = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
        turned = (across * hull.equations[:, :3]).sum(1) < 0.0
        faces[turned] = faces[turned][:, ::-1]
        return Triangles(vertices, faces)

    def cast(self, origins: Points, directions: Points) -> tuple[Float[np.ndarray, "count"], Points]:
        """Where rays first meet the surface.

        Returns:
            t in units of ``directions``, infinite where nothing is met; unit normals there that face the ray.
        """
        count = len(origins)
        least, most = np.zeros(count), np.full(count, np.inf)
        times, found = self._hit(origins, directions, least, most)
        normals = np.full((count, 3), np.nan)
        met = found >= 0
        points = origins[met] + times[met, None] * directions[met]
        normals[met] = self._normals(points, found[met])
        away = (normals * directions).sum(1) > 0.0
        normals[away] *= -1.0
        return times, normals

    def blocks(self, starts: Points, ends: Points) -> Bool[np.ndarray, "count"]:
        """Whether the segment between two points passes through the surface more than a micrometre from its ends."""
        along = ends - starts
        length = np.linalg.norm(along, axis=1)
        share = _MARGIN / np.maximum(length, 1e-12)
        return np.asarray(self._hit(starts, along, share, 1.0 - share)[1] >= 0)

    def nearest(self, points: Points) -> tuple[Points, Points, Float[np.ndarray, "count"]]:
        """The nearest points of the surface.

        Returns:
            They [m], outward unit normals, and distances [m]: negative inside of a convex surface, and near any.
        """
        surface, found = np.empty((len(points), 3)), np.empty(len(points), dtype=np.int64)
        _triangle_kernels.nearest(*self._tree, np.ascontiguousarray(points), surface, found)
        known = found >= 0
        surface[~known] = np.nan
        normals = np.full_like(surface, np.nan)
        normals[known] = self._normals(surface[known], found[known])
        flat = self._flat[np.maximum(found, 0)]
        away = points - surface
        distance = np.linalg.norm(away, axis=1)
        return surface, normals, np.where((away * flat).sum(1) < 0.0, -distance, distance)

    # Inner -----------------------------------------------------------------------------------------------------------

    def _hit(
        self, origins: Points, directions: Points, least: np.ndarray, most: np.ndarray
    ) -> tuple[Float[np.ndarray, "count"], Int[np.ndarray, "count"]]:
        times, found = np.empty(len(origins)), np.empty(len(origins), dtype=np.int64)
        rays = np.ascontiguousarray(origins), np.ascontiguousarray(directions)
        _triangle_kernels.first_hit(*self._tree, *rays, least, most, times, found)
        return times, found

    @cached_property
    def _order(self) -> Int[np.ndarray, "faces"]:
        """Triangles in the tree's order."""
        return self._grown[1]

    @cached_property
    def _tree(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Corners in the tree's order, and the tree."""
        return self._grown[0]

    @cached_property
    def _grown(self) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
        corners = self.vertices[self.faces]
        middles, order = corners.mean(1), np.arange(len(corners))
        low, high, links = list[np.ndarray](), list[np.ndarray](), list[list[int]]()
        waiting = [(0, len(corners), -1, 0)]
        while waiting:
            start, stop, parent, side = waiting.pop()
            members = order[start:stop]
            if parent >= 0:
                links[parent][side] = len(links)
            low.append(corners[members].min((0, 1)))
            high.append(corners[members].max((0, 1)))
            if stop - start <= _LEAF:
                links.append([-1 - start, stop - start])
                continue
            axis = int(np.ptp(middles[members], axis=0).argmax())
            half = (stop - start) // 2
            order[start:stop] = members[np.argpartition(middles[members, axis], half)]
            waiting += [(start, start + half, len(links), 0), (start + half, stop, len(links), 1)]
            links.append([0, 0])
        return (np.ascontiguousarray(corners[order]), np.array(low), np.array(high), np.array(links)), order

    @cached_property
    def _flat(self) -> Points:
        """Unit normals of the triangles, in the tree's order."""
        corners = self._tree[0]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300))

    @cached_property
    def _smooth(self) -> Float[np.ndarray, "faces 3 3"]:
        """Normals at the corners of each triangle, in the tree's order: means over what meets there, creases apart."""
        faces, corners = self.faces[self._order], self._tree[0]
        sides = np.roll(corners, -1, 1) - corners, np.roll(corners, 1, 1) - corners
        lengths = [np.maximum(np.linalg.norm(side, axis=-1), 1e-300) for side in sides]
        angles = np.arccos(np.clip((sides[0] * sides[1]).sum(-1) / (lengths[0] * lengths[1]), -1.0, 1.0)).ravel()
        vertex, owner = faces.ravel(), np.repeat(np.arange(len(faces)), 3)
        by_vertex = np.argsort(vertex, kind="stable")
        starts = np.searchsorted(vertex[by_vertex], np.arange(len(self.vertices) + 1))
        # Every pair of corners at one vertex.
        counts = np.diff(starts)[vertex]
        one = np.repeat(np.arange(len(vertex)), counts)
        within = np.arange(len(one)) - np.repeat(np.cumsum(counts) - counts, counts)
        other = by_vertex[starts[vertex[one]] + within]
        joined = (self._flat[owner[one]] * self._flat[owner[other]]).sum(1) >= _CREASE
        one, other = one[joined], other[joined]
        weighted = angles[other, None] * self._flat[owner[other]]
        found = np.stack([np.bincount(one, weighted[:, axis], len(vertex)) for axis in range(3)], axis=1)
        return found.reshape(-1, 3, 3)

    def _normals(self, points: Points, found: Int[np.ndarray, "count"]) -> Points:
        """Outward unit normals at points of triangles, those of their corners mixed."""
        corners = self._tree[0][found]
        ab, ac, ap = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
        aa, bb, cc = (ab * ab).sum(1), (ac * ac).sum(1), (ab * ac).sum(1)
        area = np.maximum(aa * bb - cc * cc, 1e-300)
        v = (bb * (ab * ap).sum(1) - cc * (ac * ap).sum(1)) / area
        w = (aa * (ac * ap).sum(1) - cc * (ab * ap).sum(1)) / area
        weights = np.clip(np.stack([1.0 - v - w, v, w], axis=1), 0.0, 1.0)
        mixed = np.einsum("nk,nki->ni", weights, self._smooth[found])
        length = np.linalg.norm(mixed, axis=1, keepdims=True)
        return np.where(length > 1e-12, mixed / np.maximum(length, 1e-300), self._flat[found])
