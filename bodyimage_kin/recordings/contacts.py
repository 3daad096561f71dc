"""Where a spherical hand touches the skin: the nearest point of the skin's shapes, in closed form, and its taxel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.spatial
from jaxtyping import Float, Int

from bodyimage_kin.body.skin import Skin
from bodyimage_kin.robot.shapes import Points, Shape

__all__ = ["Contacts", "find_contacts", "nearest_on_shapes", "touched_taxels"]


@dataclass(frozen=True, eq=False)
class Contacts:
    """A sphere against the skin, one row a sample, in the skin's link.

    Attributes:
        points: (samples, 3) where it touches the surface [m]; NaN where it does not.
        normals: (samples, 3) outward unit normals there; NaN likewise.
        penetration: (samples,) how deep the sphere is in the skin [m]; negative: how far it is from it.
    """

    points: Float[np.ndarray, "samples 3"]
    normals: Float[np.ndarray, "samples 3"]
    penetration: Float[np.ndarray, "samples"]


def find_contacts(skin: Skin, centres: Points, radius: float, tolerance: float = 0.0) -> Contacts:
    """Contacts of a sphere with the skin's link.

    Args:
        skin: The skin.
        centres: Centres of the sphere, in the skin's link [m].
        radius: Of the sphere [m].
        tolerance: Largest gap that counts as contact [m].
    """
    points, normals, distance = nearest_on_shapes(skin.shapes, centres)
    apart = ~(distance - radius < tolerance)
    points[apart], normals[apart] = np.nan, np.nan
    return Contacts(points, normals, radius - distance)


def touched_taxels(skin: Skin, contacts: Contacts) -> Int[np.ndarray, "samples"]:
    """The taxel nearest to each contact; -1 without contact, and where the contact is off the patch.

    The patch ends half a cell beyond its outermost taxels, as the rays see it that laid them; what faces away from the
    rays is off the patch as well.
    """
    patch = skin.patch
    touching = ~np.isnan(contacts.points).any(axis=1)
    aside = (contacts.points[touching] - patch.centre) @ np.stack([patch.down, patch.right], axis=1)
    count = np.array(patch.shape)
    coordinates = aside / (np.array(patch.size) / np.maximum(count - 1, 1)) + (count - 1) / 2
    on_patch = ((coordinates >= -0.5) & (coordinates <= count - 0.5)).all(axis=1)
    on_patch &= contacts.normals[touching] @ patch.forward >= 0.0
    _, nearest = scipy.spatial.KDTree(skin.link_positions).query(contacts.points[touching])
    taxels = np.full(len(touching), -1, dtype=np.int64)
    taxels[touching] = np.where(on_patch, nearest, -1)
    return taxels


def nearest_on_shapes(shapes: tuple[Shape, ...], points: Points) -> tuple[Points, Points, Float[np.ndarray, "count"]]:
    """The nearest point of the surface of a union of shapes.

    Args:
        shapes: Shapes of one link.
        points: In the link [m]; outside of all shapes (inside, each shape answers for itself).

    Returns:
        Surface points [m], outward unit normals, and signed distances [m] (negative inside), in the link.
    """
    found = [_nearest(shape, points) for shape in shapes]
    closest = np.argmin([distance for _, _, distance in found], axis=0)
    rows = np.arange(len(points))
    surface, normals, distances = (np.stack(parts)[closest, rows] for parts in zip(*found, strict=True))
    return surface, normals, distances


def _nearest(shape: Shape, points: Points) -> tuple[Points, Points, Float[np.ndarray, "count"]]:
    """Of one shape: each is a box in coordinates of its own, (x, y, z), (around, z) or (around) alone.

    A capsule is a ball about the point of its axis that is nearest.
    """
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
