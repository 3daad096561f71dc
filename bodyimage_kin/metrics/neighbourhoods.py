"""Whether taxels that are neighbours on the skin are neighbours in a map: scores of any surface, grid or not.

They see tears and folds where a similarity fit sees only how far places lie off, and need no order of rows and columns.
See Venna and Kaski, "Neighborhood preservation in nonlinear projection methods: an experimental study" (2001), for
trustworthiness and continuity.

Equal distances, of which grids are full, share what places are left: ties are told to a billionth. A neighbour that is
as near as the last of the k counts as one of them.
"""

from __future__ import annotations

import numpy as np
import scipy.spatial.distance
from jaxtyping import Bool, Float

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin._checks import whole
from bodyimage_kin.errors import InvalidArray

__all__ = ["continuity", "neighbourhood_scores", "neighbours_kept", "trustworthiness"]

_TIE = 1e-9  # relative


def neighbours_kept(map: ArrayLike, true: ArrayLike, k: int = 6) -> float:
    """Share of each taxel's k nearest in the map that are among its k nearest in truth, on the mean.

    Args:
        map: Places in the map, (*taxels, m) [unit].
        true: Where they truly are, (*taxels, d), in the image or on the skin: d need not be m, nor the unit the same.
        k: How many neighbours.

    Returns:
        In [0, 1]; ``k / (n - 1)`` by chance, of a collapsed map too (but for ties in the truth). Taxels not finite in
        both are left out; NaN where no more than k are left.

    Raises:
        InvalidArray: Not two arrays of numbers of as many taxels.
        InvalidConfig: k is no positive whole number.
    """
    return _kept(*_distances(map, true, k))


def trustworthiness(map: ArrayLike, true: ArrayLike, k: int = 6) -> float:
    """How far a taxel's neighbours in the map can be trusted to be its neighbours in truth (Venna and Kaski 2001).

    ``1 - 2 / (n k (2 n - 3 k - 1)) sum (r - k)`` over the taxels that are among the k nearest of another in the map and
    not in truth, r being their rank there: what comes in from afar costs more.

    Args:
        map: Places in the map, (*taxels, m) [unit].
        true: Where they truly are, (*taxels, d), as of :func:`neighbours_kept`.
        k: How many neighbours.

    Returns:
        In [0, 1], about a half by chance. Taxels not finite in both are left out; NaN where they are not more than 2 k.

    Raises:
        InvalidArray: Not two arrays of numbers of as many taxels.
        InvalidConfig: k is no positive whole number.
    """
    return _free_of_strangers(*_distances(map, true, k))


def continuity(map: ArrayLike, true: ArrayLike, k: int = 6) -> float:
    """How far a taxel's neighbours in truth stay its neighbours in the map (Venna and Kaski 2001).

    :func:`trustworthiness` with map and truth exchanged: what a tear carries away costs.

    Args:
        map: Places in the map, (*taxels, m) [unit].
        true: Where they truly are, (*taxels, d), as of :func:`neighbours_kept`.
        k: How many neighbours.

    Returns:
        In [0, 1], about a half by chance. Taxels not finite in both are left out; NaN where they are not more than 2 k.

    Raises:
        InvalidArray: Not two arrays of numbers of as many taxels.
        InvalidConfig: k is no positive whole number.
    """
    in_map, in_truth, k = _distances(map, true, k)
    return _free_of_strangers(in_truth, in_map, k)


def neighbourhood_scores(map: ArrayLike, true: ArrayLike, k: int = 6) -> dict[str, float]:
    """All scores of this module at once, by name; each as of its own function."""
    in_map, in_truth, k = _distances(map, true, k)
    return {
        "neighbours_kept": _kept(in_map, in_truth, k),
        "trustworthiness": _free_of_strangers(in_map, in_truth, k),
        "continuity": _free_of_strangers(in_truth, in_map, k),
    }


# Inner ---------------------------------------------------------------------------------------------------------------


def _distances(
    map: ArrayLike, true: ArrayLike, k: int
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n n"], int]:
    """Distances between taxels finite in both, infinite to themselves."""
    k = whole("k", k, least=1)
    places, truth = as_float_array(map, "map", ndim=2), as_float_array(true, "true", ndim=2)
    if places.shape[:-1] != truth.shape[:-1]:
        raise InvalidArray(f"map has shape {places.shape} but true {truth.shape}; all axes but the last must agree")
    places, truth = places.reshape(-1, places.shape[-1]), truth.reshape(-1, truth.shape[-1])
    used = np.isfinite(places).all(-1) & np.isfinite(truth).all(-1)
    found = []
    for points in (places[used], truth[used]):
        distance = scipy.spatial.distance.cdist(points, points)
        np.fill_diagonal(distance, np.inf)
        found.append(distance)
    return found[0], found[1], k


def _reach(distance: Float[np.ndarray, "n n"], k: int) -> Float[np.ndarray, "n 1"]:
    """Distance to the k-th nearest."""
    return np.partition(distance, k - 1, axis=1)[:, k - 1 : k]


def _within(distance: Float[np.ndarray, "n n"], k: int) -> Bool[np.ndarray, "n n"]:
    """Who is no farther than the k-th nearest."""
    return np.asarray(distance <= (1 + _TIE) * _reach(distance, k))


def _membership(distance: Float[np.ndarray, "n n"], k: int) -> Float[np.ndarray, "n n"]:
    """How much of each counts among the k nearest: rows sum to k, those that tie for the last places share them."""
    within = _within(distance, k)
    nearer = distance < (1 - _TIE) * _reach(distance, k)
    left, tied = k - nearer.sum(1, keepdims=True), (within & ~nearer).sum(1, keepdims=True)
    return np.where(nearer, 1.0, np.where(within, left / tied, 0.0))


def _kept(in_map: Float[np.ndarray, "n n"], in_truth: Float[np.ndarray, "n n"], k: int) -> float:
    if len(in_map) <= k:
        return float("nan")
    return float((_membership(in_map, k) * _within(in_truth, k)).sum() / (k * len(in_map)))


def _free_of_strangers(here: Float[np.ndarray, "n n"], there: Float[np.ndarray, "n n"], k: int) -> float:
    """One less the mean penalty for being among the k nearest here and of a rank beyond k there."""
    n = len(here)
    if n <= 2 * k:
        return float("nan")
    member = _membership(here, k)
    row, column = np.nonzero((member > 0) & ~_within(there, k))
    # Strictly nearer ones and itself: the rank of a tie is the lowest that it may have.
    rank = 1 + (there[row] < (1 - _TIE) * there[row, column, None]).sum(1)
    return float(1 - 2 / (n * k * (2 * n - 3 * k - 1)) * (member[row, column] * (rank - k)).sum())
