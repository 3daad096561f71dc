"""Clusters of taxels that were felt at once: one touch is one place, or it is not known where it was."""

from __future__ import annotations

import numpy as np
import scipy.spatial
from jaxtyping import Bool, Float, Int

__all__ = ["CLUSTER_DISTANCE", "clusters", "middle", "touched_place"]

CLUSTER_DISTANCE = 0.015
"""Taxels nearer than this [m] to one of a cluster belong to it: single linkage."""


def clusters(
    positions: Float[np.ndarray, "taxels 3"], active: Int[np.ndarray, "count"], distance: float = CLUSTER_DISTANCE
) -> list[Int[np.ndarray, "members"]]:
    """Active taxels by cluster, the largest first; of two as large, the one with the lowest taxel first.

    Args:
        positions: Where every taxel is [m].
        active: Numbers of those that were felt, each once.
        distance: Single linkage below this [m].
    """
    taxels = np.unique(active)
    if len(taxels) < 2:
        return [taxels] if len(taxels) else []
    near = scipy.spatial.distance.cdist(positions[taxels], positions[taxels]) < distance
    if near.all():
        return [taxels]
    left, found = np.ones(len(taxels), dtype=bool), []
    # They are few: walking from one to the next is ten times faster than a sparse graph of them.
    while left.any():
        inside: Bool[np.ndarray, "taxels"] = np.zeros(len(taxels), dtype=bool)
        inside[left.argmax()] = True
        count = 0
        while inside.sum() > count:
            count = int(inside.sum())
            inside = np.asarray(near[inside].any(axis=0))
        found.append(taxels[inside])
        left &= ~inside
    return sorted(found, key=lambda one: (-len(one), int(one[0])))


def touched_place(
    positions: Float[np.ndarray, "taxels 3"], active: Int[np.ndarray, "count"], distance: float = CLUSTER_DISTANCE
) -> Int[np.ndarray, "members"] | None:
    """The largest cluster of active taxels; None where nothing was felt, or no cluster is the single largest.

    Args:
        positions: Where every taxel is [m].
        active: Numbers of those that were felt; -1 for none.
        distance: Single linkage below this [m].
    """
    found = clusters(positions, active[active >= 0], distance)
    if not found or (len(found) > 1 and len(found[0]) == len(found[1])):
        return None
    return found[0]


def middle(positions: Float[np.ndarray, "members 3"]) -> int:
    """Which of these places [m] is nearest to their mean; the first of several as near."""
    return int(np.linalg.norm(positions - positions.mean(axis=0), axis=1).argmin())
