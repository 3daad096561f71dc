"""The end of the chain in a study: what a Jacobian's error does to the touched path, and that to the maps.

All rows of one recording learn their maps from the same touches, with the same first weights and the same posture map,
and so does *direct sight*, which is handed the true image of the hand. The kernel that neighbours learn by shrinks
every map, the one of direct sight as well: held against that one, the kernel's own share is out of a map's error, and
what is left comes from the estimate.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float

from bodyimage_kin import metrics
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body_image import BodyImage, PostureSOM
from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.recordings import first_taxel

__all__ = ["POSTURE_GRID", "map_scores", "posture_som", "relative_distance", "seen_range", "true_map"]

POSTURE_GRID = (8, 8)
"""Of the posture map."""


def posture_som(felt: xr.Dataset, seed: int, grid: Any = POSTURE_GRID) -> PostureSOM:
    """Representative postures, of felt touches alone.

    Args:
        felt: Experience of the touches; its first trial counts.
        seed: Of the posture map.
        grid: (rows, columns) of its units.

    Raises:
        InvalidRecording: No touches.
    """
    q, taxel = felt["q"].values[0], first_taxel(felt)[0]
    if not (taxel >= 0).any():
        raise InvalidRecording("the hand never felt a touch, so there is nothing to map; let it touch for longer")
    return PostureSOM.fit(q[taxel >= 0], grid, seed)


def seen_range(training: xr.Dataset) -> Float[np.ndarray, "m 2"]:
    """Lowest and highest felt image of the hand along each axis, in the camera's unit: bounds of the first weights."""
    seen = training["hand_image"].values.reshape(-1, training.sizes["axis"])
    return np.stack([np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)], axis=1)


# The same for every recording and estimator of an embodiment, so a worker finds it once.
@lru_cache(maxsize=8)
def true_map(body: Embodiment) -> Float[np.ndarray, "*taxels m"]:
    """Where the hand's image is while it touches each taxel, in the camera's unit: what a perfect map holds."""
    skin = body.require_skin()
    with torch.no_grad():
        image = body.hand_image(body.touch_postures(np.arange(skin.count)))
    return image.numpy().reshape(*(skin.shape or (skin.count,)), body.m)


def map_scores(learned: BodyImage, truth: Float[np.ndarray, "*taxels m"]) -> dict[str, Any]:
    """Scores of one tactile map against the true taxels; those of order and folds are NaN where the skin is no grid."""
    of = metrics.scores(learned.tactile_map, truth)
    return {
        "map_error_to_truth": metrics.trajectory_rmse(truth, learned.tactile_map),
        "map_topological_error": of.get("topological_error", np.nan),
        "map_span": of["span"],
        "map_disparity": of["disparity"],
        "map_folded_cells": of.get("folded_cells", np.nan),
    }


def relative_distance(map: Float[np.ndarray, "*units m"], reference: Float[np.ndarray, "*units m"]) -> float:
    """RMS distance of a map from another, over the RMS extent of that other about its middle."""
    centre = np.broadcast_to(reference.mean(tuple(range(reference.ndim - 1))), reference.shape)
    return metrics.trajectory_rmse(reference, map) / metrics.trajectory_rmse(reference, centre)
