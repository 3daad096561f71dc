"""The nearest point of what a link is touched on, in closed form for primitive shapes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from bodyimage_kin.robot.shapes import Points, Shape, Surface
from bodyimage_kin.robot.triangles import Triangles

__all__ = ["nearest_on_shapes"]


def nearest_on_shapes(shapes: Surface, points: Points) -> tuple[Points, Points, Float[np.ndarray, "count"]]:
    """The nearest point of the surface of a union of shapes.

    Args:
        shapes: Shapes and meshes of one link.
        points: In the link [m]; outside of all shapes (inside, each shape answers for itself).

    Returns:
        Surface points [m], outward unit normals, and signed distances [m] (negative inside), in the link.
    """
    found = [_nearest(shape, points) for shape in shapes]
    closest = np.argmin([distance for _, _, distance in found], axis=0)
    rows = np.arange(len(points))
    surface, normals, distances = (np.stack(parts)[closest, rows] for parts in zip(*found, strict=True))
    return surface, normals, distances


def _nearest(shape: Shape | Triangles, points: Points) -> tuple[Points, Points, Float[np.ndarray, "count"]]:
    """Of one shape: each is a box in coordinates of its own, (x, y, z), (around, z) or (around) alone.

    A capsule is a ball about the point of its axis that is nearest.
    """
    if isinstance(shape, Triangles):
        return shape.nearest(points)
    rotation, position = shape.link_T_shape[:3, :3], shape.link_T_shape[:3, 3]
    local = (points - position) @ rotation
    half, centres = np.array(shape.size), np.zeros_like(local)
    if shape.kind == "capsule":
        half, centres[:, 2] = half[:1], np.clip(local[:, 2], -half[1], half[1])
        local = local - centres
    if shape.kind == "box":
        axes = np.broadcast_to(np.eye(3), (len(local), 3, 3))
    elif shape.kind == "cylinder":
        around = _unit(local * [1.0, 1.0, 0.0])
        axes = np.stack([around, np.broadcast_to([0.0, 0.0, 1.0], around.shape)], axis=1)
    else:
        axes = _unit(local)[:, None]
    coordinates = np.einsum("nki,ni->nk", axes, local)
    sign = np.where(coordinates < 0.0, -1.0, 1.0)
    beyond = np.abs(coordinates) - half
    outside = (beyond > 0.0).any(axis=1)
    # From inside, the nearest face is the one along the axis on which the point is farthest out.
    leaving = np.eye(len(half))[beyond.argmax(axis=1)]
    away = sign * np.where(outside[:, None], np.maximum(beyond, 0.0), leaving * beyond)
    direction = np.where(outside[:, None], away, sign * leaving)
    normals = np.einsum("nk,nki->ni", _unit(direction), axes)
    distances = np.where(outside, 1.0, -1.0) * np.linalg.norm(away, axis=1)
    surface = centres + np.einsum("nk,nki->ni", coordinates - away, axes)
    return surface @ rotation.T + position, normals @ rotation.T, distances


def _unit(vectors: Float[np.ndarray, "count d"]) -> Float[np.ndarray, "count d"]:
    """Unit vectors; the first axis where there is no direction."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0.0, vectors / np.where(length > 0.0, length, 1.0), np.eye(vectors.shape[1])[0])
