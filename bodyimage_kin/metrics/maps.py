"""How well a learned tactile map keeps the layout of the skin.

A map gives each taxel of a (rows, columns) grid a place in the image [m]; x grows with the column, y with the row.
The topological error alone is blind to a collapsed map, so :func:`scores` reports span, folds and shape beside it.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.spatial.distance
from jaxtyping import Float

from bodyimage_kin._arrays import ArrayLike, Floats, as_float_array, as_pair
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.metrics._whitening import ratio


def _planar(map: ArrayLike) -> Float[np.ndarray, "rows columns 2"]:
    array = as_float_array(map, "map", ndim=3)
    if array.ndim != 3 or array.shape[-1] != 2:
        raise InvalidArray(f"map has shape {array.shape}; this score needs (rows, columns, 2)")
    return array


def topological_error(map: ArrayLike) -> int:
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


def folded_cells(map: ArrayLike) -> int:
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


def _as_weights(value: ArrayLike | None, shape: tuple[int, ...]) -> Floats:
    """Non-negative weights of the given shape: a mask, counts or floats; ones when None.

    Raises:
        InvalidArray: Another shape, or a weight that is negative or not finite.
    """
    if value is None:
        return np.ones(shape)
    try:
        weights = np.asarray(value.detach() if hasattr(value, "detach") else value).astype(np.float64)
    except (TypeError, ValueError, RuntimeError) as error:
        raise InvalidArray(f"weights are no array of numbers ({error})") from error
    if weights.shape != shape:
        raise InvalidArray(f"weights have shape {weights.shape}; give one number a taxel, {shape}")
    if not (np.isfinite(weights) & (weights >= 0)).all():
        raise InvalidArray("weights must be finite and not negative")
    return weights


def _centred(true: ArrayLike, map: ArrayLike, weights: ArrayLike | None) -> tuple[Floats, Floats, Floats]:
    """Both maps about their weighted means, (taxels, m), and weights that sum to one (to zero if none is left)."""
    true, map = as_pair(true, map, ("true", "map"), ndim=2)
    weight = _as_weights(weights, true.shape[:-1]).ravel()
    true, map = true.reshape(-1, true.shape[-1]), map.reshape(-1, true.shape[-1])
    used = (weight > 0) & np.isfinite(true).all(-1) & np.isfinite(map).all(-1)
    true, map, weight = true[used], map[used], weight[used] / weight[used].sum()
    # Taking the first taxel off first makes a collapsed map exactly zero, instead of zero up to rounding.
    true, map = true - true[:1], map - map[:1]
    return true - weight @ true, map - weight @ map, weight


def span(map: ArrayLike, true: ArrayLike, weights: ArrayLike | None = None) -> Float[np.ndarray, "m"]:
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


def procrustes(true: ArrayLike, map: ArrayLike, weights: ArrayLike | None = None) -> Procrustes:
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


def scores(map: ArrayLike, true: ArrayLike, weights: ArrayLike | None = None) -> dict[str, Any]:
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


def landmark_relations(map: ArrayLike, landmarks: Mapping[str, int], true: ArrayLike | None = None) -> dict[str, bool]:
    """Which relations between landmarks (left of, above) a map keeps.

    Args:
        map: (rows, columns, 2) [m].
        landmarks: The taxel of each landmark, ``{"left_eye": 150, ...}``, taxel = row * columns + column.
        true: The true places, (rows, columns, 2) [m], that say which relations hold; the grid's own rows and columns
            when None. Places closer along an axis than 1e-6 of the truth's extent have no relation on it.

    Returns:
        For each that truly holds, such as ``"left_eye above mouth"``, whether it holds in the map. Left is smaller x,
        above smaller y; False where a place is NaN.

    Raises:
        InvalidArray: Shapes that differ, or a landmark off the grid.
    """
    places = _planar(map)
    rows, columns = places.shape[:2]
    reference = np.moveaxis(np.indices((rows, columns), dtype=np.float64)[::-1], 0, -1)
    if true is not None:
        reference, _ = as_pair(true, places, ("true", "map"), ndim=3)
    for name, taxel in landmarks.items():
        if not 0 <= taxel < rows * columns:
            raise InvalidArray(f"landmark {name!r} is taxel {taxel}; the grid has 0 to {rows * columns - 1}")
    places, reference = places.reshape(-1, 2), reference.reshape(-1, 2)
    closest = 1e-6 * np.ptp(reference, axis=0)
    return {
        f"{first} {relation} {second}": bool(places[landmarks[first], axis] < places[landmarks[second], axis])
        for axis, relation in enumerate(("left of", "above"))
        for first, second in itertools.permutations(landmarks, 2)
        if reference[landmarks[second], axis] - reference[landmarks[first], axis] > closest[axis]
    }


def permuted(map: ArrayLike, seed: int) -> Float[np.ndarray, "rows columns m"]:
    """The map with its taxel labels shuffled, on which every score of order must return to chance.

    Args:
        map: (rows, columns, m) [m].
        seed: Which shuffle.

    Raises:
        InvalidArray: Not a float array of three axes.
    """
    places = as_float_array(map, "map", ndim=3)
    if places.ndim != 3:
        raise InvalidArray(f"map has shape {places.shape}; it must be (rows, columns, m)")
    order = np.random.default_rng(seed).permutation(places.shape[0] * places.shape[1])
    return places.reshape(-1, places.shape[-1])[order].reshape(places.shape)


def _best_units(weights: ArrayLike, samples: ArrayLike) -> tuple[Any, Any, Floats, tuple[int, int]]:
    """Nearest and second nearest unit of each finite sample, its distance to the nearest, and the grid's shape."""
    units, points = as_float_array(weights, "weights", ndim=3), as_float_array(samples, "samples", ndim=1)
    if units.ndim != 3 or units.shape[-1] != points.shape[-1]:
        raise InvalidArray(
            f"weights have shape {units.shape}, samples {points.shape}; give (rows, columns, d) and (*samples, d)"
        )
    grid, units = units.shape[:2], units.reshape(-1, units.shape[-1])
    points = points.reshape(-1, units.shape[-1])
    points = points[np.isfinite(points).all(-1)]
    first, second = np.zeros((2, len(points)), dtype=np.int64)
    distances = np.full(len(points), np.nan)
    for start in range(0, len(points), 4096):
        place = slice(start, start + 4096)
        # Not by |x|^2 - 2 x w + |w|^2: its rounding would leave a sample on a unit some distance away from it.
        distance = np.nan_to_num(scipy.spatial.distance.cdist(points[place], units), nan=np.inf)
        first[place], distances[place] = distance.argmin(axis=1), distance.min(axis=1)
        distance[np.arange(len(distance)), first[place]] = np.inf
        second[place] = distance.argmin(axis=1)
    return first, second, distances, (grid[0], grid[1])


def quantization_error(weights: ArrayLike, samples: ArrayLike) -> float:
    """Mean Euclidean distance of samples to their nearest unit of a self-organizing map.

    Args:
        weights: (rows, columns, d), in the units of the samples.
        samples: (*samples, d); those that are not finite are left out.

    Returns:
        In the units of the samples; NaN when none is left.

    Raises:
        InvalidArray: Shapes that do not fit.
    """
    _, _, distances, _ = _best_units(weights, samples)
    return float(distances.mean()) if len(distances) else float("nan")


def topographic_error(weights: ArrayLike, samples: ArrayLike) -> float:
    """Share of samples whose nearest and second nearest units are no neighbours on the grid.

    The rule: each unit has 8 neighbours, diagonals included (other libraries count 4); of units equally near the one of
    the lower index comes first.

    Args:
        weights: (rows, columns, d), in the units of the samples.
        samples: (*samples, d); those that are not finite are left out.

    Returns:
        In [0, 1]; NaN when no sample is left or there is but one unit. A collapsed map scores 0: its ties are adjacent.

    Raises:
        InvalidArray: Shapes that do not fit.
    """
    first, second, _, (rows, columns) = _best_units(weights, samples)
    if len(first) == 0 or rows * columns == 1:
        return float("nan")
    apart = np.maximum(np.abs(first // columns - second // columns), np.abs(first % columns - second % columns))
    return float((apart > 1).mean())
