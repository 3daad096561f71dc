"""Where a spherical hand touches the skin: the nearest point of the skin's shapes, in closed form, and its taxel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.spatial
from jaxtyping import Bool, Float, Int

from bodyimage_kin.body.skin import Patch, Skin
from bodyimage_kin.robot.nearest import nearest_on_shapes
from bodyimage_kin.robot.shapes import Points

__all__ = ["Contacts", "find_contacts", "touched_taxels"]


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
    """Contacts of a sphere with the surface of the skin's link; of a mesh its convex hull is touched.

    Args:
        skin: The skin.
        centres: Centres of the sphere, in the skin's link [m].
        radius: Of the sphere [m].
        tolerance: Largest gap that counts as contact [m].
    """
    points, normals, distance = nearest_on_shapes(skin.touched_surface, centres)
    apart = ~(distance - radius < tolerance)
    points[apart], normals[apart] = np.nan, np.nan
    return Contacts(points, normals, radius - distance)


def touched_taxels(skin: Skin, contacts: Contacts) -> Int[np.ndarray, "samples"]:
    """The taxel nearest to each contact; -1 without contact, and where the contact is off the patch.

    A grid ends half a cell beyond its outermost taxels, as the rays see it that laid them; what faces away from the
    rays is off the patch as well. Any other skin ends, beside a taxel, after nine tenths of the spacing.
    """
    touching = ~np.isnan(contacts.points).any(axis=1)
    _, nearest = scipy.spatial.KDTree(skin.link_positions).query(contacts.points[touching])
    nearest = np.asarray(nearest)
    points, normals = contacts.points[touching], contacts.normals[touching]
    on_patch = (
        _on_grid(skin.layout, points, normals)
        if skin.shape and skin.layout
        else _beside(skin, nearest, points, normals)
    )
    taxels = np.full(len(touching), -1, dtype=np.int64)
    taxels[touching] = np.where(on_patch, nearest, -1)
    return taxels


def _on_grid(patch: Patch, points: Points, normals: Points) -> Bool[np.ndarray, "count"]:
    """Whether points lie within the outermost cells, on the side that faces the rays."""
    aside = (points - patch.centre) @ np.stack([patch.down, patch.right], axis=1)
    count = np.array(patch.shape)
    coordinates = aside / (np.array(patch.size) / np.maximum(count - 1, 1)) + (count - 1) / 2
    on_patch = ((coordinates >= -0.5) & (coordinates <= count - 0.5)).all(axis=1)
    return np.asarray(on_patch & (normals @ patch.forward >= 0.0))


def _beside(skin: Skin, taxels: Int[np.ndarray, "count"], points: Points, normals: Points) -> Bool[np.ndarray, "count"]:
    """Whether points lie beside the taxels, and face the way that these do."""
    outward = skin.link_normals[taxels]
    away = points - skin.link_positions[taxels]
    aside = np.linalg.norm(away - (away * outward).sum(1, keepdims=True) * outward, axis=1)
    return np.asarray((aside <= 0.9 * skin.spacing) & ((outward * normals).sum(1) > 0.0))
