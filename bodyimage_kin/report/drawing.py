"""A robot drawn from its own geometry: the visuals of its URDF, placed by its joints, as triangles on ordinary axes.

Everything is in the root's coordinates until ``project`` puts it on the picture plane, in metres. Taxels, paths and
rays go through the same ``project``, and ``hidden`` says which of their points the robot itself covers.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin.errors import InvalidArray, InvalidConfig, InvalidGeometry, UnknownName
from bodyimage_kin.report.visuals import RobotSource
from bodyimage_kin.report.visuals import Surface as Surface
from bodyimage_kin.report.visuals import triangles as triangles

Window: TypeAlias = tuple[float | int, float | int, float | int, float | int]
"""Left, right, bottom, top on the picture plane [m]."""

MAX_VECTOR_TRIANGLES = 1000
"""A drawing of more triangles is embedded in an SVG as an image: smaller, and without seams."""

_LIGHT = np.array([-0.35, 0.55, 0.76])  # on the picture plane right, up, towards the viewer
_AMBIENT = 0.45
_SHADES = 50  # steps too small to see, and large enough for an image to compress well


@dataclass(frozen=True)
class View:
    """Where the drawing is seen from.

    Attributes:
        look_from: The eye, in the root [m]; for an orthographic view only its direction matters.
        look_to: The point in the middle of the picture, in the root [m].
        up: What is up in the picture, in the root.
        perspective: True scale at ``look_to``, larger when nearer; otherwise orthographic, true scale everywhere.
    """

    look_from: ArrayLike
    look_to: ArrayLike = (0.0, 0.0, 0.0)
    up: ArrayLike = (0.0, 0.0, 1.0)
    perspective: bool = False

    @classmethod
    def around(
        cls,
        target: ArrayLike,
        *,
        azimuth: float | int,
        elevation: float | int,
        distance: float | int = 1.0,
        perspective: bool = False,
    ) -> View:
        """The view of ``target`` (root, [m]) from ``distance`` [m] at azimuth (x to y) and elevation [degrees]."""
        a, e = np.radians([azimuth, elevation])
        middle = np.asarray(target, dtype=float)
        eye = middle + distance * np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        return cls(tuple(eye.tolist()), tuple(middle.tolist()), perspective=perspective)

    def axes(self) -> Float[np.ndarray, "3 3"]:
        """Right, up and forward in the root, as rows.

        Raises:
            InvalidConfig: The eye is at the point it looks to, or looks along ``up``.
        """
        forward = np.subtract(self.look_to, self.look_from)
        right = np.cross(forward, self.up)
        scale = np.linalg.norm(forward) * np.linalg.norm(self.up)
        if not np.linalg.norm(right) > 1e-9 * scale:
            raise InvalidConfig(f"{self} has no direction or looks along its up vector; move look_from or change up")
        forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
        return np.stack([right, np.cross(right, forward), forward])


def project(points: ArrayLike, view: View) -> tuple[Float[np.ndarray, "*batch 2"], Float[np.ndarray, "*batch"]]:
    """Points on the picture plane and how far away they are.

    Args:
        points: ``(*batch, 3)`` in the root [m].
        view: Where they are seen from.

    Returns:
        Right and up from the middle of the picture [m], and the distance along the line of sight: from the eye in
        perspective, from ``look_to`` otherwise [m]. Points behind a perspective eye are NaN.

    Raises:
        InvalidArray: The last axis is not of length 3.
        InvalidConfig: The view has no direction.
    """
    array = np.asarray(points, dtype=float)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise InvalidArray(f"points have shape {array.shape}; the last axis must be x, y, z")
    along = (array - np.asarray(view.look_to)) @ view.axes().T
    flat, depth = along[..., :2], along[..., 2]
    if view.perspective:
        distance = float(np.linalg.norm(np.subtract(view.look_to, view.look_from)))
        depth = np.where(depth + distance > 0, depth + distance, np.nan)
        flat = flat * (distance / depth)[..., None]
    return flat, depth


def hidden(
    points: ArrayLike, surface: Surface, view: View, *, margin: float | int = 1e-3
) -> Bool[np.ndarray, "points"]:
    """Whether the robot covers each of ``points`` ``(points, 3)`` (root, [m]), seen from the view.

    Args:
        points: The points of a path, taxels ...
        surface: What may cover them.
        view: Where they are seen from.
        margin: How far in front of a point a triangle must be to cover it [m]; taxels lie on triangles.
    """
    flat, depth = project(points, view)
    corners, corner_depth = project(surface.corners, view)
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    seen = np.abs(area) > 1e-15
    a, ab, ac, area, corner_depth = a[seen], ab[seen], ac[seen], area[seen], corner_depth[seen]
    # Seen in perspective it is the inverse of the depth that is linear over a triangle.
    linear = 1 / corner_depth if view.perspective else corner_depth
    covered = np.zeros(len(flat), dtype=bool)
    for index, point in enumerate(flat):
        offset = point - a
        u = (offset[:, 0] * ac[:, 1] - offset[:, 1] * ac[:, 0]) / area
        v = (ab[:, 0] * offset[:, 1] - ab[:, 1] * offset[:, 0]) / area
        inside = (u >= 0) & (v >= 0) & (u + v <= 1)
        met = linear[inside]
        at = met[:, 0] + u[inside] * (met[:, 1] - met[:, 0]) + v[inside] * (met[:, 2] - met[:, 0])
        covered[index] = bool(((1 / at if view.perspective else at) < depth[index] - margin).any())
    return covered


def draw_surface(axes: Axes, surface: Surface, view: View, *, window: Window | None = None) -> PolyCollection:
    """Draw triangles on axes of equal aspect in metres: far ones first, lit from the upper left, back faces left out.

    Args:
        axes: Its limits and aspect are set.
        surface: What to draw.
        view: Where it is seen from.
        window: What part of the picture plane to show; None for everything, with a margin.

    Raises:
        InvalidGeometry: There is no triangle to draw.
    """
    if not len(surface.corners):
        raise InvalidGeometry("nothing to draw: these links have no visual geometry; choose links that have")
    flat, _ = project(surface.corners, view)
    if window is None:
        low, high = np.nanmin(flat, axis=(0, 1)), np.nanmax(flat, axis=(0, 1))
        edge = 0.03 * float((high - low).max())
        window = (low[0] - edge, high[0] + edge, low[1] - edge, high[1] + edge)
    left, right, bottom, top = window
    normals = np.cross(surface.corners[:, 1] - surface.corners[:, 0], surface.corners[:, 2] - surface.corners[:, 0])
    eye = np.asarray(view.look_from) if view.perspective else -1e6 * view.axes()[2]
    kept = np.einsum("ij,ij->i", normals, eye - surface.corners[:, 0]) > 0
    kept &= (flat[..., 0].max(1) > left) & (flat[..., 0].min(1) < right)
    kept &= (flat[..., 1].max(1) > bottom) & (flat[..., 1].min(1) < top)
    # The painter sorts by middles, which is right only when neighbours are of like size: large triangles are cut.
    corners, source = _cut(surface.corners[kept], max(right - left, top - bottom) / 60)
    flat, depth = project(corners, view)
    order = np.argsort(-depth.mean(1), kind="stable")
    normals = normals[kept] / np.linalg.norm(normals[kept], axis=1, keepdims=True)
    towards = normals @ (view.axes() * [[1], [1], [-1]]).T
    shade = _AMBIENT + (1 - _AMBIENT) * np.clip(towards @ (_LIGHT / np.linalg.norm(_LIGHT)), 0, 1)
    shade = np.round(shade * _SHADES) / _SHADES
    colours = surface.colours[kept] * np.concatenate([np.repeat(shade[:, None], 3, 1), np.ones((len(shade), 1))], 1)
    painted = PolyCollection(
        list(flat[order]),
        facecolors=colours[source[order]],
        edgecolors=colours[source[order]],
        linewidths=0,
        # Smoothed edges would let what is behind shine through between neighbours.
        antialiaseds=False,
        rasterized=len(flat) > MAX_VECTOR_TRIANGLES,
        zorder=1,
    )
    axes.add_collection(painted, autolim=False)
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    return painted


def draw_robot(
    axes: Axes,
    urdf_source: RobotSource,
    posture: Mapping[str, Any],
    *,
    view: View,
    links: Iterable[str] | None = None,
    colours: Mapping[str, Any] | None = None,
    mesh_folder: str | os.PathLike[str] | None = None,
    window: Window | None = None,
) -> Surface:
    """Draw a robot at a posture on axes; the arguments are those of ``triangles`` and ``draw_surface``.

    Args:
        axes: Its limits and aspect are set.
        urdf_source: A robot, the path of a URDF, or the XML itself.
        posture: Joint values by name [rad or m].
        view: Where it is seen from.
        links: The links to draw; None for all.
        colours: matplotlib colours of links by name, instead of their materials.
        mesh_folder: Where meshes may be read.
        window: What part of the picture plane to show.

    Returns:
        The triangles drawn, for ``hidden``.

    Raises:
        UnknownName: A link in ``links`` or ``colours`` that the robot does not have.
        InvalidGeometry: As ``triangles`` and ``draw_surface``.
    """
    surface = triangles(urdf_source, posture, links=links, mesh_folder=mesh_folder)
    for name, colour in (colours or {}).items():
        if name not in surface.link_names:
            raise UnknownName("link", name, surface.link_names)
        surface.colours[surface.links == surface.link_names.index(name)] = to_rgba(colour)
    draw_surface(axes, surface, view, window=window)
    return surface


def _cut(
    corners: Float[np.ndarray, "triangles 3 3"], longest: float
) -> tuple[Float[np.ndarray, "pieces 3 3"], Int[np.ndarray, "pieces"]]:
    """The triangles halved across the longest edge until none exceeds ``longest`` [m], and each piece's source."""
    done, sources = [np.empty((0, 3, 3))], [np.empty(0, dtype=np.int64)]
    source = np.arange(len(corners))
    while len(corners):
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        # Turned so that the longest edge runs from the first corner to the second: slivers give few pieces, not many.
        turned = (edges.argmax(1)[:, None] + np.arange(3)) % 3
        corners = np.take_along_axis(corners, turned[..., None], axis=1)
        small = edges.max(1) <= longest
        done.append(corners[small])
        sources.append(source[small])
        a, b, c = np.moveaxis(corners[~small], 1, 0)
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
        source = np.tile(source[~small], 2)
    return np.concatenate(done), np.concatenate(sources)
