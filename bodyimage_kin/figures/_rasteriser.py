"""Triangles as one lit image on ordinary axes, each pixel showing the one nearest to the eye."""

from __future__ import annotations

from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.image import AxesImage

from bodyimage_kin.errors import InvalidGeometry
from bodyimage_kin.figures._views import View, Window, project, window_of
from bodyimage_kin.figures.visuals import Surface

PIXELS = 720
"""Pixels along the longer side of a drawing: 200 to the inch over a column."""

_SUBPIXELS = 2  # along each side of a pixel, averaged for smooth outlines
_LIGHT = np.array([-0.35, 0.55, 0.76])  # on the picture plane right, up, towards the viewer
_AMBIENT = 0.45


def draw_surface(
    axes: Axes, surface: Surface, view: View, *, window: Window | None = None, pixels: int = PIXELS
) -> AxesImage:
    """Draws triangles on axes of equal aspect in metres.

    They become one image: a mesh of any size takes the same room in an SVG.

    Args:
        axes: Its limits and aspect are set.
        surface: What to draw.
        view: Where it is seen from.
        window: What part of the picture plane to show; None for everything, with a margin.
        pixels: Along the longer side of the drawing.

    Raises:
        InvalidGeometry: There is no triangle to draw.
    """
    window = window or window_of(project(surface.corners, view)[0])
    image = render(surface, view, window, pixels)
    painted = axes.imshow(image, extent=window, aspect="equal", zorder=1)
    axes.set(xlim=window[:2], ylim=window[2:])
    return painted


def render(surface: Surface, view: View, window: Window, pixels: int = PIXELS) -> Float[np.ndarray, "height width 4"]:
    """Triangles as a picture (RGBA, rows from the top), lit from the upper left.

    Each pixel shows the triangle nearest to the eye: spheres and cylinders that run into each other, as the limbs of a
    robot of primitives do, meet in a clean line, which no order of painting gives.

    Args:
        surface: What to draw.
        view: Where it is seen from.
        window: What part of the picture plane to show.
        pixels: Along the longer side.

    Raises:
        InvalidGeometry: There is no triangle to draw.
    """
    if not len(surface.corners):
        raise InvalidGeometry("nothing to draw: these links have no visual geometry; choose links that have")
    flat, depth = project(surface.corners, view)
    left, right, bottom, top = window
    scale = pixels * _SUBPIXELS / max(right - left, top - bottom)
    width, height = (_SUBPIXELS * max(1, round(size * scale / _SUBPIXELS)) for size in (right - left, top - bottom))
    corners = (flat - [left, top]) * [width / (right - left), -height / (top - bottom)]
    nearest, weights = _nearest(corners, depth, width, height)
    shade = _AMBIENT + (1 - _AMBIENT) * np.clip(surface.normals @ towards_light(view), 0, 1)
    image = surface.colours[nearest] * (weights * shade[nearest]).sum(-1, keepdims=True)
    image[..., 3] = 1
    image[nearest < 0] = 0
    image = image.reshape(height // _SUBPIXELS, _SUBPIXELS, width // _SUBPIXELS, _SUBPIXELS, 4).mean(axis=(1, 3))
    image[..., :3] = np.where(image[..., 3:] > 0, image[..., :3] / image[..., 3:].clip(1e-9), 1.0)
    return image.clip(0, 1)


def on_white(image: Float[np.ndarray, "height width 4"]) -> Float[np.ndarray, "height width 3"]:
    """A picture before white."""
    return image[..., :3] * image[..., 3:] + 1 - image[..., 3:]


def towards_light(view: View) -> Float[np.ndarray, "3"]:
    """Unit vector in the root from which a drawing is lit: upper left, before the picture."""
    return _LIGHT @ (view.axes() * [[1], [1], [-1]]) / np.linalg.norm(_LIGHT)


def _nearest(
    pixels: Float[np.ndarray, "triangles 3 2"], depth: Float[np.ndarray, "triangles 3"], width: int, height: int
) -> tuple[Int[np.ndarray, "height width"], Float[np.ndarray, "height width 3"]]:
    """The triangle seen in each pixel (rows from the top), -1 for none, and how near each of its corners is (sum 1).

    Triangles turned away are left out.
    """
    ab, ac = pixels[:, 1] - pixels[:, 0], pixels[:, 2] - pixels[:, 0]
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    # The middle of pixel k is at k + 1/2.
    low = np.ceil(pixels.min(1) - 0.5).clip(0).astype(int)
    high = np.floor(pixels.max(1) - 0.5).clip(-1, [width - 1, height - 1]).astype(int)
    # Counterclockwise becomes negative where rows run down.
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
