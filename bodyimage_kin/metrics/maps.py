"""How well a learned tactile map keeps the layout of the skin.

A map gives each taxel a place in the image: (rows, columns, m) of a grid, x growing with the column and y with the row;
(taxels, m) of any other skin. Order of rows and columns is of grids alone (topological error, folded cells); shape,
size and neighbourhoods are of any. The topological error alone is blind to a collapsed map, so :func:`scores` reports
span, folds and shape beside it. ``[unit]`` is the image's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.spatial.distance
import torch
from jaxtyping import Float, Int

from bodyimage_kin._arrays import ArrayLike, Floats, as_float_array, as_pair
from bodyimage_kin._shown import Shown
from bodyimage_kin.body.cameras import CameraModel
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.metrics._whitening import ratio
from bodyimage_kin.metrics.neighbourhoods import neighbourhood_scores

__all__ = [
    "Procrustes",
    "error_in_space",
    "folded_cells",
    "permuted",
    "procrustes",
    "quantization_error",
    "scores",
    "shuffled_touches",
    "span",
    "topographic_error",
    "topological_error",
]


def _planar(map: ArrayLike) -> Float[np.ndarray, "rows columns 2"]:
    array = as_float_array(map, "map")
    if array.ndim != 3 or array.shape[-1] != 2 or 0 in array.shape:
        raise InvalidArray(
            f"map has shape {array.shape}; topological error and folded cells are of grids, (rows, columns, 2): "
            "of other skins ask for neighbours_kept, trustworthiness and continuity"
        )
    return array


def topological_error(map: ArrayLike) -> int:
    """Number of taxels out of order with their right or lower neighbour.

    A taxel counts once, when its x exceeds that of the taxel to its right or its y that of the taxel below.

    Args:
        map: (rows, columns, 2) [unit].

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
        map: (rows, columns, 2) [unit].

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
        map: (*taxels, m) [unit]: (rows, columns, m) of a grid, (taxels, m) of any skin.
        true: The true places, of the same shape.
        weights: A mask of taxels or their touch counts, (*taxels); all alike when None.

    Returns:
        One slope an image axis, over taxels finite in both and of positive weight. NaN where the truth does not vary
        or no taxel is left.

    Raises:
        InvalidArray: Shapes that differ, or weights that are negative or not finite.
    """
    reference, places, weight = _centred(true, map, weights)
    return ratio(weight @ (reference * places), weight @ reference**2)


@dataclass(frozen=True, eq=False)
class Procrustes(Shown):
    """The best similarity without reflection, ``map ~ scale * true @ rotation.T + translation``.

    Attributes:
        disparity: What it leaves of the map's variance, in [0, 1].
        scale: Size of the map over that of the truth.
        rotation: (m, m), determinant +1.
    """

    disparity: float
    scale: float
    rotation: Float[np.ndarray, "m m"]


def procrustes(map: ArrayLike, true: ArrayLike, weights: ArrayLike | None = None) -> Procrustes:
    """Similarity fit of the truth to a map, without reflection.

    Not ``scipy.spatial.procrustes``, which reflects, and so calls a mirrored map perfect.
    With centred A = true and B = map, ``B'A = U S V'`` and ``D = diag(1, .., det(U V'))``: the scale is
    ``tr(S D) / |A|^2``, the disparity ``1 - tr(S D)^2 / (|A|^2 |B|^2)``.

    Args:
        map: (*taxels, m) [unit]: (rows, columns, m) of a grid, (taxels, m) of any skin.
        true: The true places, of the same shape.
        weights: A mask of taxels or their touch counts, (*taxels); all alike when None.

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
        map: (*taxels, m) [unit]: (rows, columns, 2) of a grid, (taxels, m) of any skin.
        true: The true places, of the same shape.
        weights: A mask of taxels or their touch counts, (*taxels), for span, disparity and scale.

    Returns:
        ``span`` ((m,) array), ``disparity`` and ``scale``, ``neighbours_kept``, ``trustworthiness`` and ``continuity``
        (float) over taxels of positive weight; of a grid also ``topological_error`` and ``folded_cells`` (int). Each is
        undefined as in its own function.

    Raises:
        InvalidArray: Shapes that differ, or weights that are negative or not finite.
    """
    map, true = as_pair(map, true, ("map", "true"), ndim=2)
    fit, taught = procrustes(map, true, weights), map
    if weights is not None:
        taught = np.where(_as_weights(weights, map.shape[:-1])[..., None] > 0, map, np.nan)
    found: dict[str, Any] = {
        "span": span(map, true, weights),
        "disparity": fit.disparity,
        "scale": fit.scale,
        **neighbourhood_scores(taught, true),
    }
    if map.ndim == 3 and map.shape[-1] == 2:
        found |= {"topological_error": topological_error(map), "folded_cells": folded_cells(map)}
    return found


def error_in_space(map: ArrayLike, points: ArrayLike, camera: CameraModel) -> Float[np.ndarray, "*taxels"]:
    """How far each taxel's map lies from the truth, as a distance at the taxel's own depth.

    An error in the image means more the farther away it lies. This one undoes the projection at the true point: through
    an image of two coordinates across the camera's axis, exactly for a camera without distortion and to first order for
    one with; through an image of more, in space.

    Args:
        map: Places in the map, (*taxels, m) [unit].
        points: True points that these are images of, (*taxels, 3) in the camera's axes [m], such as
            ``body.hand_in_camera(body.touch_postures(taxels))``.
        camera: How they are projected, such as ``body.camera.model``.

    Returns:
        Distances [m]; NaN where a taxel has no place in the map, or its true point no image.

    Raises:
        InvalidArray: Shapes that do not fit together, or to the camera's m.
    """
    places, true = as_float_array(map, "map", ndim=1), as_float_array(points, "points", ndim=1)
    if places.shape[-1] != camera.m or true.shape != (*places.shape[:-1], 3):
        raise InvalidArray(
            f"map has shape {places.shape}, points {true.shape}; give (*taxels, {camera.m}) [{camera.unit}] and "
            "(*taxels, 3) [m]"
        )
    at = torch.from_numpy(true)
    off = places - camera.project(at).numpy()
    derivative = camera.derivative(at).numpy()[..., : 2 if camera.m == 2 else 3]
    known = np.isfinite(off).all(-1) & np.isfinite(derivative).all((-1, -2))
    aside = (
        np.linalg.pinv(np.where(known[..., None, None], derivative, 0)) @ np.where(known[..., None], off, 0)[..., None]
    )
    return np.where(known, np.linalg.norm(aside[..., 0], axis=-1), np.nan)


def permuted(map: ArrayLike, seed: int) -> Float[np.ndarray, "*taxels m"]:
    """The map with its taxel labels shuffled, on which every score of order must return to chance.

    Args:
        map: (*taxels, m) [unit]: (rows, columns, m) of a grid, (taxels, m) of any skin.
        seed: Which shuffle.

    Raises:
        InvalidArray: Not an array of numbers of two axes at least.
    """
    places = as_float_array(map, "map", ndim=2)
    flat = places.reshape(-1, places.shape[-1])
    return flat[np.random.default_rng(seed).permutation(len(flat))].reshape(places.shape)


def shuffled_touches(touched: ArrayLike, seed: int) -> Int[np.ndarray, "*samples contacts"]:
    """Touches of a recording, dealt anew to the samples that touch: what a map learns from them is what chance makes.

    Unlike :func:`permuted`, this keeps what the rule of learning itself does to a map: a kernel draws the map of noise
    together as it does any other.

    Args:
        touched: Taxels active at once, (*samples, contacts), padded with -1, such as ``recording["touched"]``.
        seed: Which shuffle.

    Returns:
        The same rows in another order; those that touch nothing keep their place.

    Raises:
        InvalidArray: No whole numbers, or less than one axis.
    """
    taxels = np.asarray(touched)
    if taxels.ndim < 1 or taxels.dtype.kind not in "iu":
        raise InvalidArray(f"touched has shape {taxels.shape}, of {taxels.dtype}; give taxels (*samples, contacts)")
    rows = taxels.reshape(-1, taxels.shape[-1]).copy()
    touching = np.flatnonzero((rows >= 0).any(-1))
    rows[touching] = rows[np.random.default_rng(seed).permutation(touching)]
    return rows.reshape(taxels.shape)


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
