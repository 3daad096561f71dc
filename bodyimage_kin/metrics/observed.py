"""Scores without a true Jacobian: predictions held against what was observed and never learned from.

An observation has noise of its own, which no learner can foretell: errors are given raw and with that floor taken off.
And observations speak of the directions alone in which the joints moved: the local spectrum says which those are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.spatial
import torch
from jaxtyping import Bool, Float

from bodyimage_kin._arrays import ArrayLike, as_float_array, as_pair
from bodyimage_kin._checks import number, whole
from bodyimage_kin._shown import Shown
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.estimators import Learned, Pairs, edges
from bodyimage_kin.metrics._fields import Field, line_integrals
from bodyimage_kin.metrics._whitening import ratio

__all__ = [
    "LocalSpectrum",
    "ObservedError",
    "displacements_along",
    "image_error",
    "local_spectrum",
    "noise_floor",
    "pair_error",
    "predicted_pairs",
    "stated_noise",
]


@dataclass(frozen=True)
class ObservedError(Shown):
    """The error of predictions against observations, and what of it the noise of the observations makes.

    Attributes:
        error: Root of the mean squared error [unit].
        size: Root of the mean squared size of what was to be predicted, as observed [unit].
        floor: Root of the mean squared error that a perfect prediction would have [unit].
        count: Observations that count.
    """

    error: float
    size: float
    floor: float
    count: int

    @property
    def relative(self) -> float:
        """Error over size; NaN where nothing is observed to move."""
        return float(ratio(self.error, self.size))

    @property
    def corrected(self) -> float:
        """The error without the floor [unit], squares subtracted, never below 0."""
        return _without(self.error, self.floor)

    @property
    def relative_corrected(self) -> float:
        """Error over size, the floor taken off both: NaN where all that is observed is noise."""
        return float(ratio(self.corrected, _without(self.size, self.floor)))


def pair_error(predicted: ArrayLike, observed: ArrayLike, noise: float | int = 0.0) -> ObservedError:
    """The error of predicted displacements of the hand image on held-out edges (or steps).

    ``sqrt(mean |d - (r_j - r_i)|^2)``, and over ``sqrt(mean |r_j - r_i|^2)``: predicting that nothing moves has 1.

    Args:
        predicted: Of each edge, (edges, m) [unit], such as :func:`predicted_pairs` gives.
        observed: The change of the observed image, of the same shape.
        noise: Root of the mean squared noise of one observed image [unit], of :func:`noise_floor` or
            :func:`stated_noise`: an edge has that of both ends.

    Returns:
        Over edges finite in both; NaN when there is none.

    Raises:
        InvalidArray: Not two arrays of numbers of one shape.
        InvalidConfig: Noise that is no number of at least 0.
    """
    d, r = _finite_rows(predicted, observed)
    return ObservedError(_rms(d - r), _rms(r), float(np.sqrt(2) * number("noise", noise, least=0.0)), len(r))


def image_error(predicted: ArrayLike, observed: ArrayLike, noise: float | int = 0.0) -> ObservedError:
    """The error of predicted hand images at held-out postures, for models of the image itself.

    Args:
        predicted: (postures, m) [unit].
        observed: Of the same shape.
        noise: Root of the mean squared noise of one observed image [unit], as of :func:`pair_error`.

    Returns:
        Over postures finite in both, the size being the spread of the observed images about their mean: predicting that
        has 1. NaN when there is none.

    Raises:
        InvalidArray: Not two arrays of numbers of one shape.
        InvalidConfig: Noise that is no number of at least 0.
    """
    guess, r = _finite_rows(predicted, observed)
    size = _rms(r - r.mean(0)) if len(r) else float("nan")
    return ObservedError(_rms(guess - r), size, number("noise", noise, least=0.0), len(r))


def predicted_pairs(learned: Learned, hidden: Pairs) -> Float[np.ndarray, "edges m"]:
    """What a learned Jacobian says of pairs of postures: its integral along the straight line between the two.

    Args:
        learned: Of any kind; asked for its Jacobian alone.
        hidden: Pairs it has not learned from, such as those of a :class:`~bodyimage_kin.metrics.held_out.HeldOut`.

    Returns:
        Displacements to hold against ``hidden.dr`` [unit].
    """
    # The posture of an edge is half way, that of a step before it.
    start = hidden.q if hidden.postures is None else hidden.q - hidden.dq / 2
    return displacements_along(
        lambda q: learned.jacobian(torch.from_numpy(q)), start.numpy(), (start + hidden.dq).numpy(), hidden.dr.shape[1]
    )


def displacements_along(
    jacobian: Field, start: ArrayLike, end: ArrayLike, m: int, nodes: int = 16
) -> Float[np.ndarray, "edges m"]:
    """The integral of a Jacobian along straight lines in joint space, by Gauss-Legendre quadrature.

    Args:
        jacobian: Of postures, (k, p) -> (k, m, p) [unit/rad].
        start: (edges, p) [rad or m].
        end: Likewise.
        m: Number of coordinates of the image.
        nodes: On each line: exact for a Jacobian of degree ``2 nodes - 1`` along it.

    Raises:
        InvalidArray: Postures of different shapes, or a value of the Jacobian of a wrong shape.
        InvalidConfig: Less than one node.
    """
    first, last = as_pair(start, end, ("start", "end"), ndim=1)
    if first.ndim != 2:
        raise InvalidArray(f"start has shape {first.shape}; give postures (edges, p)")
    return line_integrals(jacobian, "jacobian", first, last, whole("nodes", nodes, least=1), whole("m", m, least=1))


def noise_floor(image: ArrayLike, repeat: ArrayLike) -> float:
    """The noise of one observed image, from repeats of a posture.

    Args:
        image: (*samples, m) [unit], NaN where unseen.
        repeat: (*samples) number of the posture that each repeats, negative for none.

    Returns:
        Root of the mean squared noise [unit]: deviations from the mean of each repeated posture, each having one degree
        of freedom less than it has images. NaN where no posture is seen twice.

    Raises:
        InvalidArray: Shapes that do not fit, or repeats that are no whole numbers.
    """
    seen, numbers = as_float_array(image, "image", ndim=1), np.asarray(repeat)
    if numbers.shape != seen.shape[:-1] or numbers.dtype.kind not in "iu":
        raise InvalidArray(
            f"image has shape {seen.shape}, repeat {numbers.shape} of {numbers.dtype}; give (*samples, m) and whole "
            "numbers (*samples)"
        )
    seen, numbers = seen.reshape(-1, seen.shape[-1]), numbers.ravel()
    used = np.isfinite(seen).all(-1) & (numbers >= 0)
    seen, (_, group, count) = seen[used], np.unique(numbers[used], return_inverse=True, return_counts=True)
    sums = np.zeros((len(count), seen.shape[1]))
    np.add.at(sums, group, seen)
    off = seen - (sums / count[:, None])[group]
    return float(np.sqrt(ratio((off**2).sum(), (count - 1).sum())))


def stated_noise(m: int, image: float | int, encoder: float | int = 0.0, jacobian: ArrayLike | None = None) -> float:
    """The noise of one observed image, from what is stated of the sensors.

    Args:
        m: Number of coordinates of the image.
        image: Standard deviation of each coordinate [unit].
        encoder: Standard deviation of each felt joint [rad].
        jacobian: What turns that into the image, (*postures, m, p) [unit/rad]; a learned one will do.

    Returns:
        Root of the mean squared noise [unit]: ``sqrt(m image^2 + encoder^2 mean |J|^2)``.

    Raises:
        InvalidConfig: Not numbers of at least 0, or noise of encoders without a Jacobian.
        InvalidArray: A Jacobian of another m, or without a finite posture.
    """
    squared = whole("m", m, least=1) * number("image", image, least=0.0) ** 2
    if number("encoder", encoder, least=0.0) > 0:
        J = as_float_array([[[]]] if jacobian is None else jacobian, "jacobian", ndim=2)
        J = J.reshape(-1, *J.shape[-2:])
        J = J[np.isfinite(J).all((-1, -2))]
        if len(J) == 0 or J.shape[1] != m:
            raise InvalidArray(f"jacobian has finite postures {J.shape}; give (*postures, {m}, p)")
        squared += encoder**2 * float((J**2).sum((-1, -2)).mean())
    return float(np.sqrt(squared))


@dataclass(frozen=True, eq=False)
class LocalSpectrum(Shown):
    """In which directions the joints moved about each posture, joints over their spread.

    Attributes:
        values: (postures, p) singular values of the displacements to the neighbours, descending; root mean squares.
        directions: (postures, p, p) their right singular vectors, as rows.
        spread: (p,) what each joint is counted in [rad or m].
        cut: A direction counts as moved from this share of the posture's largest on.
    """

    values: Float[np.ndarray, "postures p"]
    directions: Float[np.ndarray, "postures p p"]
    spread: Float[np.ndarray, "p"]
    cut: float

    @property
    def moved(self) -> Bool[np.ndarray, "postures p"]:
        """Which directions were moved."""
        return (self.values >= self.cut * self.values[:, :1]) & (self.values > 0)

    @property
    def share(self) -> float:
        """Share of directions moved, mean over postures: 1 where a recording can speak of the full Jacobian."""
        return float(self.moved.mean())

    def restrict(self, jacobians: ArrayLike) -> Float[np.ndarray, "postures m p"]:
        """Jacobians at these postures, by the spread of the joints and along the directions moved alone, ``J S P``.

        The error of such a pair is that of the full Jacobian restricted to what the recording can know of it:
        ``pooled_relative_error(spectrum.restrict(J), spectrum.restrict(Jh))``.

        Args:
            jacobians: (postures, m, p) [unit/rad].

        Raises:
            InvalidArray: Of other postures or joints.
        """
        J = as_float_array(jacobians, "jacobians", ndim=3)
        count, p = self.values.shape
        if J.ndim != 3 or (len(J), J.shape[2]) != (count, p):
            raise InvalidArray(f"jacobians have shape {J.shape}; give ({count}, m, {p}), one a posture")
        kept = self.directions * self.moved[..., None]
        return np.asarray(J * self.spread @ kept.swapaxes(-1, -2) @ kept)


def local_spectrum(
    q: ArrayLike, neighbours: int | None = None, noise: float | int = 0.0, cut: float | int = 0.1
) -> LocalSpectrum:
    """Singular values of the displacements from each posture to its neighbours, joints over their spread.

    Postures of one table or circle move the joints in few directions locally; of the others a recording says nothing,
    and an error of the full Jacobian is then an opinion about them.

    Args:
        q: Postures (postures, p) [rad or m], of a stream or scattered.
        neighbours: How many nearest postures are looked at; ``2 p`` when None. Repeats of a posture are none.
        noise: Standard deviation of a felt joint [rad]: postures that differ by no more than twice that in every joint
            repeat one another.
        cut: A direction counts as moved from this share of the largest on.

    Raises:
        InvalidArray: No finite postures, or less than two that differ.
        InvalidConfig: A setting out of its range.
    """
    postures = as_float_array(q, "postures", ndim=2)
    if postures.ndim != 2 or not np.isfinite(postures).all():
        raise InvalidArray(f"postures have shape {postures.shape}; give (postures, p), all finite")
    count, p = postures.shape
    near = 2 * p if neighbours is None else whole("neighbours", neighbours, least=1)
    share = number("cut", cut, above=0.0, most=1.0)
    twice = 2.0 * number("noise", noise, least=0.0)
    # Every distinct posture has an edge to another.
    distinct = np.unique(edges(postures, 1, noise=twice / 2))
    if len(distinct) < 2:
        raise InvalidArray("postures do not differ beyond their noise; give those of a motion")
    spread = postures.std(axis=0)
    spread = np.where(spread > 0, spread, 1.0)
    near = min(near, len(distinct) - 1)
    # One more than wanted, for a posture is its own nearest, or that is its repeat.
    _, found = scipy.spatial.KDTree(postures[distinct] / spread).query(postures / spread, k=near + 1)
    away = postures[distinct[found]] - postures[:, None]
    same = (np.abs(away) <= twice).all(-1)
    # Those that are no repeats first, in order of distance, and of them as many as wanted.
    order = np.argsort(same, axis=1, kind="stable")[:, :near]
    away = np.take_along_axis(np.where(same[..., None], 0.0, away / spread), order[..., None], axis=1)
    kept = np.maximum((~np.take_along_axis(same, order, axis=1)).sum(1), 1)
    tall = np.zeros((count, max(p, near), p))
    tall[:, :near] = away
    _, values, directions = np.linalg.svd(tall, full_matrices=False)
    return LocalSpectrum(values / np.sqrt(kept)[:, None], directions, spread, share)


# Inner ---------------------------------------------------------------------------------------------------------------


def _finite_rows(
    predicted: ArrayLike, observed: ArrayLike
) -> tuple[Float[np.ndarray, "rows m"], Float[np.ndarray, "rows m"]]:
    d, r = as_pair(predicted, observed, ("predicted", "observed"), ndim=1)
    d, r = d.reshape(-1, d.shape[-1]), r.reshape(-1, r.shape[-1])
    known = np.isfinite(d).all(-1) & np.isfinite(r).all(-1)
    return d[known], r[known]


def _rms(rows: Float[np.ndarray, "rows m"]) -> float:
    return float(np.sqrt((rows**2).sum(-1).mean())) if len(rows) else float("nan")


def _without(error: float, floor: float) -> float:
    """The root of the difference of squares, never below 0."""
    return float(np.sqrt(max(error**2 - floor**2, 0.0))) if error == error else error
