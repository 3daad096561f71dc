"""A robot drawn from its own geometry: the visuals of its URDF, placed by its joints, as triangles on ordinary axes.

Everything is in the root's coordinates until ``project`` puts it on the picture plane, in metres. Taxels, paths and
rays go through the same ``project``, and ``hidden`` says which of their points the robot itself covers.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias, no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.image import AxesImage

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin.errors import InvalidArray, InvalidConfig, InvalidGeometry, UnknownName
from bodyimage_kin.figures.visuals import RobotSource
from bodyimage_kin.figures.visuals import Surface as Surface
from bodyimage_kin.figures.visuals import triangles as triangles

Window: TypeAlias = tuple[float | int, float | int, float | int, float | int]
"""Left, right, bottom, top on the picture plane [m]."""

PIXELS = 720
"""Pixels along the longer side of a drawing: 200 to the inch over a column."""

_SUBPIXELS = 2  # along each side of a pixel, averaged for smooth outlines
_LIGHT = np.array([-0.35, 0.55, 0.76])  # on the picture plane right, up, towards the viewer
_AMBIENT = 0.45


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
    (left, bottom), (right, top) = np.nanmin(flat, 0), np.nanmax(flat, 0)
    low, high = corners.min(1), corners.max(1)
    near = (low[:, 0] <= right) & (high[:, 0] >= left) & (low[:, 1] <= top) & (high[:, 1] >= bottom)
    seen = near & (np.abs(area) > 1e-15)
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


def draw_surface(
    axes: Axes, surface: Surface, view: View, *, window: Window | None = None, pixels: int = PIXELS
) -> AxesImage:
    """Draw triangles on axes of equal aspect in metres, lit from the upper left.

    They become one image, each pixel showing the triangle nearest to the eye: spheres and cylinders that run into each
    other, as the limbs of a robot of primitives do, meet in a clean line, which no order of painting gives; and a mesh
    of any size takes the same room in an SVG.

    Args:
        axes: Its limits and aspect are set.
        surface: What to draw.
        view: Where it is seen from.
        window: What part of the picture plane to show; None for everything, with a margin.
        pixels: Along the longer side of the drawing.

    Raises:
        InvalidGeometry: There is no triangle to draw.
    """
    if not len(surface.corners):
        raise InvalidGeometry("nothing to draw: these links have no visual geometry; choose links that have")
    flat, depth = project(surface.corners, view)
    if window is None:
        low, high = np.nanmin(flat, axis=(0, 1)), np.nanmax(flat, axis=(0, 1))
        edge = 0.03 * float((high - low).max())
        window = (low[0] - edge, high[0] + edge, low[1] - edge, high[1] + edge)
    left, right, bottom, top = (float(value) for value in window)
    scale = pixels * _SUBPIXELS / max(right - left, top - bottom)
    width, height = (_SUBPIXELS * max(1, round(size * scale / _SUBPIXELS)) for size in (right - left, top - bottom))
    corners = (flat - [left, top]) * [width / (right - left), -height / (top - bottom)]
    # Seen in perspective it is the inverse of the depth that is linear over a triangle.
    nearest, weights = _nearest(corners, -1 / depth if view.perspective else depth, width, height)
    light = _LIGHT @ (view.axes() * [[1], [1], [-1]]) / np.linalg.norm(_LIGHT)
    shade = _AMBIENT + (1 - _AMBIENT) * np.clip(surface.normals @ light, 0, 1)
    image = surface.colours[nearest] * (weights * shade[nearest]).sum(-1, keepdims=True)
    image[..., 3] = 1
    image[nearest < 0] = 0
    image = image.reshape(height // _SUBPIXELS, _SUBPIXELS, width // _SUBPIXELS, _SUBPIXELS, 4).mean(axis=(1, 3))
    image[..., :3] = np.where(image[..., 3:] > 0, image[..., :3] / image[..., 3:].clip(1e-9), 1.0)
    painted = axes.imshow(image.clip(0, 1), extent=(left, right, bottom, top), aspect="equal", zorder=1)
    axes.set(xlim=(left, right), ylim=(bottom, top))
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


def _nearest(
    pixels: Float[np.ndarray, "triangles 3 2"], depth: Float[np.ndarray, "triangles 3"], width: int, height: int
) -> tuple[Int[np.ndarray, "height width"], Float[np.ndarray, "height width 3"]]:
    """The triangle seen in each pixel (rows from the top), -1 for none, and how near each of its corners is (sum 1).

    Triangles turned away are left out.
    """
    ab, ac = pixels[:, 1] - pixels[:, 0], pixels[:, 2] - pixels[:, 0]
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    # The middle of pixel k is at k + 1/2.
    low = np.ceil(np.nan_to_num(pixels.min(1)) - 0.5).clip(0).astype(int)
    high = np.floor(np.nan_to_num(pixels.max(1)) - 0.5).clip(-1, [width - 1, height - 1]).astype(int)
    # Counterclockwise becomes negative where rows run down; a corner behind the eye makes the area NaN.
    shown = np.flatnonzero((area < -1e-12) & (low <= high).all(1))
    seen, weights = np.full((height, width), -1), np.zeros((height, width, 3))
    _fill(shown, low, high, pixels[:, 0].copy(), ab, ac, area, depth, np.full((height, width), np.inf), seen, weights)
    return seen, weights


# no_type_check: a checker that wraps functions would hand numba the wrapper.
@numba.njit(cache=True)
@no_type_check
def _fill(shown, low, high, corner, ab, ac, area, depth, buffer, seen, weights):
    """Depth-buffers triangles pixel by pixel, the nearest winning."""
    for triangle in shown:
        for y in range(low[triangle, 1], high[triangle, 1] + 1):
            for x in range(low[triangle, 0], high[triangle, 0] + 1):
                dx, dy = x + 0.5 - corner[triangle, 0], y + 0.5 - corner[triangle, 1]
                u = (dx * ac[triangle, 1] - dy * ac[triangle, 0]) / area[triangle]
                v = (dy * ab[triangle, 0] - dx * ab[triangle, 1]) / area[triangle]
                first = 1.0 - u - v
                if first >= 0.0 and u >= 0.0 and v >= 0.0:
                    at = first * depth[triangle, 0] + u * depth[triangle, 1] + v * depth[triangle, 2]
                    if at < buffer[y, x]:
                        buffer[y, x] = at
                        seen[y, x] = triangle
                        weights[y, x, 0], weights[y, x, 1], weights[y, x, 2] = first, u, v
