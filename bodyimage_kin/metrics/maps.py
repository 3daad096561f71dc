"""How well a learned tactile map keeps the layout of the skin.

A map gives each taxel of a (rows, columns) grid a place in the image [m]; x grows with the column, y with the row.
The topological error alone is blind to a collapsed map, so :func:`scores` reports span, folds and shape beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.metrics._inputs import ArrayInput, Floats, as_floats, as_pair, as_weights, ratio


def _planar(map: ArrayInput) -> Float[np.ndarray, "rows columns 2"]:
    array = as_floats(map, "map", ndim=3)
    if array.ndim != 3 or array.shape[-1] != 2:
        raise InvalidArray(f"map has shape {array.shape}; this score needs (rows, columns, 2)")
    return array


def topological_error(map: ArrayInput) -> int:
    """Number of taxels out of order with their right or lower neighbour.

    A taxel counts once, when its x exceeds that of the taxel to its right or its y that of the taxel below.

    Args:
        map: (rows, columns, 2) [m].

    Returns:
        Between 0 and rows * columns - 1 (440 for 21 x 21, about 320 by chance). A collapsed map scores 0. A taxel
        without a finite place is out of order with its neighbours.

    Raises:
        InvalidArray: Not a float array of that shape.
    """
    places = _planar(map)
    wrong = np.zeros(places.shape[:2], dtype=bool)
    # "not ordered" instead of "greater", so that NaN cannot lower the score.
    wrong[:, :-1] |= ~(places[:, :-1, 0] <= places[:, 1:, 0])
    wrong[:-1, :] |= ~(places[:-1, :, 1] <= places[1:, :, 1])
    return int(wrong.sum())


def folded_cells(map: ArrayInput) -> int:
    """Number of grid cells turned over or flattened at any of their four corners.

    The triangle at a corner is positive when the way round the cell is that of the grid: x along the columns, y along
    the rows.

    Args:
        map: (rows, columns, 2) [m].

    Returns:
        Between 0 and (rows - 1) * (columns - 1): the cells with any corner triangle that is not positive. A cell with a
        corner that is NaN counts.

    Raises:
        InvalidArray: Not a float array of that shape.
    """
    places = _planar(map)
    corners = np.stack([places[:-1, :-1], places[:-1, 1:], places[1:, 1:], places[1:, :-1]])
    with np.errstate(all="ignore"):
        ahead, behind = np.roll(corners, -1, axis=0) - corners, np.roll(corners, 1, axis=0) - corners
        area = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
    return int((~(area > 0)).any(axis=0).sum())


def _centred(true: ArrayInput, map: ArrayInput, weights: ArrayInput | None) -> tuple[Floats, Floats, Floats]:
    """Both maps about their weighted means, (taxels, m), and weights that sum to one (to zero if none is left)."""
    true, map = as_pair(true, map, ("true", "map"), ndim=2)
    weight = as_weights(weights, true.shape[:-1]).ravel()
    true, map = true.reshape(-1, true.shape[-1]), map.reshape(-1, true.shape[-1])
    used = (weight > 0) & np.isfinite(true).all(-1) & np.isfinite(map).all(-1)
    true, map, weight = true[used], map[used], weight[used] / weight[used].sum()
    # Taking the first taxel off first makes a collapsed map exactly zero, instead of zero up to rounding.
    true, map = true - true[:1], map - map[:1]
    return true - weight @ true, map - weight @ map, weight


def span(map: ArrayInput, true: ArrayInput, weights: ArrayInput | None = None) -> Float[np.ndarray, "m"]:
    """Slope of the regression of the map on the truth along each image axis: 1 keeps its size, 0 is collapsed.

    Args:
        map: (rows, columns, m), or any (*taxels, m) [m].
        true: The true places, of the same shape.
        weights: A mask of taxels or their touch counts, (rows, columns); all alike when None.

    Returns:
        One slope an image axis, over taxels finite in both and of positive weight. NaN where the truth does not vary
        or no taxel is left.

    Raises:
        InvalidArray: Shapes that differ, or weights that are negative or not finite.
    """
    reference, places, weight = _centred(true, map, weights)
    return ratio(weight @ (reference * places), weight @ reference**2)


@dataclass(frozen=True, eq=False)
class Procrustes:
    """The best similarity without reflection, ``map ~ scale * true @ rotation.T + translation``.

    Attributes:
        disparity: What it leaves of the map's variance, in [0, 1].
        scale: Size of the map over that of the truth.
        rotation: (m, m), determinant +1.
    """

    disparity: float
    scale: float
    rotation: Float[np.ndarray, "m m"]


def procrustes(true: ArrayInput, map: ArrayInput, weights: ArrayInput | None = None) -> Procrustes:
    """Similarity fit of the truth to a map, without reflection.

    Not ``scipy.spatial.procrustes``, which reflects, and so calls a mirrored map perfect.
    With centred A = true and B = map, ``B'A = U S V'`` and ``D = diag(1, .., det(U V'))``: the scale is
    ``tr(S D) / |A|^2``, the disparity ``1 - tr(S D)^2 / (|A|^2 |B|^2)``.

    Args:
        true: The true places, (rows, columns, m), or any (*taxels, m) [m].
        map: The map, of the same shape.
        weights: A mask of taxels or their touch counts, (rows, columns); all alike when None.

    Returns:
        The fit over taxels finite in both and of positive weight. The disparity of a collapsed map is NaN (its scale
        0); everything is NaN when the truth has no extent or no taxel is left.

    Raises:
        InvalidArray: Shapes that differ, or weights that are negative or not finite.
    """
    reference, places, weight = _centred(true, map, weights)
    truth_size, map_size = (float(weight @ (a**2).sum(-1)) for a in (reference, places))
    if not truth_size > 0:
        return Procrustes(float("nan"), float("nan"), np.full((reference.shape[-1],) * 2, np.nan))
    U, S, Vt = np.linalg.svd((places * weight[:, None]).T @ reference)
    D = np.ones_like(S)
    D[-1] = np.sign(np.linalg.det(U @ Vt))
    # Negative on a line only, where a mirrored map is best fitted by a point.
    trace = max(float(S @ D), 0.0)
    disparity = 1 - trace**2 / (truth_size * map_size) if map_size > 0 else float("nan")
    return Procrustes(max(disparity, 0.0) if disparity == disparity else disparity, trace / truth_size, (U * D) @ Vt)


def scores(map: ArrayInput, true: ArrayInput, weights: ArrayInput | None = None) -> dict[str, Any]:
    """Every score of one map that says something the others do not.

    Args:
        map: (rows, columns, 2) [m].
        true: The true places, of the same shape.
        weights: A mask of taxels or their touch counts, (rows, columns), for span, disparity and scale.

    Returns:
        ``topological_error`` and ``folded_cells`` (int), ``span`` ((2,) array), ``disparity`` and ``scale`` (float),
        each undefined as in its own function.

    Raises:
        InvalidArray: Shapes that differ, or weights that are negative or not finite.
    """
    fit = procrustes(true, map, weights)
    return {
        "topological_error": topological_error(map),
        "span": span(map, true, weights),
        "folded_cells": folded_cells(map),
        "disparity": fit.disparity,
        "scale": fit.scale,
    }
