"""How far from its goal a visual servo may start and still arrive, on the true robot with a learned Jacobian.

The laws of :mod:`bodyimage_kin.metrics.servo` hold near the goal; this follows the servo itself, limits and all. See
Chaumette and Hutchinson, "Visual servo control, part I" (2006), and Nakamura and Hanafusa (1986) on damped inverses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from bodyimage_kin._arrays import ArrayLike, Floats, as_float_array
from bodyimage_kin._checks import number, refuse, whole
from bodyimage_kin._shown import Shown
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.metrics._fields import Field, answer

__all__ = ["Basin", "servo_basin"]

_CHUNK = 1 << 15  # trials advanced together, so that temporaries stay in the tens of megabytes
_SETTLED = 0.01  # of the tolerance: a trial this near its goal is done, not merely passing
_APPROACH, _POLISH = 8, 30  # steps on the way to a start, and at most as many more to get there exactly
_ARRIVED = 1e-6  # of the distance
_START_DAMPING = 1e-3
_LEAST_DAMPING = 1e-6  # its square is still well above rounding


@dataclass(frozen=True, eq=False)
class Basin(Shown):
    """Which trials of a visual servo converge: one a goal, distance and direction.

    Attributes:
        converged: (goals, distances, directions) 1 where the trial converges, 0 where not, NaN where there is no trial:
            no posture within the limits has its image there.
        starts: (goals, distances, directions, p) posture each trial starts from [rad or m], NaN where there is none.
        distances: (distances,) of the starts' images from the goal's, ascending [unit].
        directions: (directions, m) unit vectors from the goal's image to those of the starts.
    """

    converged: Float[np.ndarray, "goals distances directions"]
    starts: Float[np.ndarray, "goals distances directions p"]
    distances: Float[np.ndarray, "distances"]
    directions: Float[np.ndarray, "directions m"]

    @property
    def unreached(self) -> Int[np.ndarray, "goals"]:
        """How many starts of each goal do not exist."""
        return np.asarray(np.isnan(self.converged).sum((1, 2)))

    @property
    def share(self) -> Float[np.ndarray, "goals"]:
        """Share of each goal's trials that converge, in [0, 1]; NaN where a goal has no trial."""
        trials = np.isfinite(self.converged).sum((1, 2))
        return np.where(trials > 0, np.nansum(self.converged, (1, 2)) / trials.clip(min=1), np.nan)

    @property
    def radius(self) -> Float[np.ndarray, "goals"]:
        """Largest distance [unit] up to which every trial converges, whatever its direction.

        0 where a trial from the smallest distance fails, NaN where there is none from there. A larger distance without
        any trial ends the basin: nothing vouches for it.
        """
        tried = np.isfinite(self.converged).any(2)
        safe = np.logical_and.accumulate(tried & ~(self.converged == 0).any(2), axis=1).sum(1)
        return np.where(tried[:, 0], np.concatenate([[0.0], self.distances])[safe], np.nan)


@np.errstate(all="ignore")
def servo_basin(
    image: Field,
    true_jacobian: Field,
    estimated_jacobian: Field,
    goals: ArrayLike,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    distances: ArrayLike = (0.005, 0.01, 0.02, 0.03, 0.05),
    directions: int | ArrayLike = 8,
    gain: float | int = 0.2,
    damping: float | int = 0.05,
    steps: int = 100,
    tolerance: float | int = 0.001,
) -> Basin:
    """The basin of attraction of goals under the servo law on the true robot, within its limits.

    Each trial starts at a posture whose true image is a given distance and direction from the goal's, and repeats
    ``q <- clip(q - gain Jh' (Jh Jh' + (damping s)^2 I)^-1 e)`` with the image error ``e = image(q) - image(goal)`` and
    s the root mean square of the m singular values of Jh at q. The damping being relative, scaling an estimate by c is
    the same as dividing the gain by c. A trial converges when ``|e| < tolerance`` after the last step; it ends before
    that when its error is below a hundredth of the tolerance (converged), when a step moves nothing, or when the hand
    has no image or the estimate is not finite (diverged). Only kinematics: bodies pass through each other.

    Starts are found from the goal by damped least squares with the true Jacobian, moving the joints that no limit holds
    back, along the straight line on the screen.

    Args:
        image: True hand image of postures (k, p) -> (k, m) [unit], NaN where the hand has none.
        true_jacobian: Its derivative, (k, p) -> (k, m, p) [unit/rad]; asked only where there is an image.
        estimated_jacobian: The learned one, likewise.
        goals: (goals, p) postures [rad or m] whose images are servoed to. One that is not finite, or without image,
            has no trials; one beyond its limits is aimed at from within.
        lower: (p,) joint limits [rad or m], -inf where there is none.
        upper: (p,) likewise, inf where there is none.
        distances: Of the starts' images from the goal's, ascending [unit].
        directions: How many directions the starts lie in: evenly spaced from the first axis towards the second when m
            is 2, else drawn uniformly once for all (from a fixed seed). Or the directions themselves, (directions, m),
            of any length.
        gain: Per step, ``lambda dt``; see :func:`bodyimage_kin.metrics.critical_gain`.
        damping: Of the inverse, relative to s; dimensionless.
        steps: At most.
        tolerance: Image error that counts as arrived [unit].

    Returns:
        The outcome of every trial; the same, goal by goal, whatever other goals there are.

    Raises:
        InvalidArray: Goals, limits or directions of a wrong shape, or a function's value of a wrong shape.
        InvalidConfig: Distances that do not ascend from above the tolerance, or another setting out of range.
    """
    goals = as_float_array(goals, "goals", ndim=1)
    if goals.ndim != 2:
        raise InvalidArray(f"goals has shape {goals.shape}; give postures (goals, p)")
    limits = _limits(lower, upper, goals.shape[1])
    gain = number("gain", gain, above=0.0)
    damping = number("damping", damping, least=_LEAST_DAMPING)
    steps = whole("steps", steps, least=1)
    tolerance = number("tolerance", tolerance, above=0.0)
    away = as_float_array(distances, "distances", ndim=1)
    ascend = away.ndim == 1 and bool(np.isfinite(away).all() and (np.diff(away, prepend=tolerance) > 0).all())
    if not ascend:
        refuse("distances", distances, "ascending distances in the unit of the image, greater than the tolerance")

    centre, m = _images_of_goals(image, goals)
    if np.ndim(directions) == 0:
        directions = whole("directions", directions, least=1)
    unit = _directions(directions, m)
    offsets = away[:, None, None] * unit
    shape = (len(away), len(unit))
    starts = np.full((len(goals), *shape, goals.shape[1]), np.nan)
    converged = np.full((len(goals), *shape), np.nan)
    seen = np.flatnonzero(np.isfinite(centre).all(-1))
    at_once = max(1, _CHUNK // (shape[0] * shape[1]))
    for begin in range(0, len(seen), at_once):
        some = seen[begin : begin + at_once]
        target = np.repeat(centre[some], shape[0] * shape[1], axis=0)
        offset = np.tile(offsets.reshape(-1, m), (len(some), 1))
        home = np.repeat(goals[some], shape[0] * shape[1], axis=0)
        q = _starts(image, true_jacobian, home, target, offset, limits)
        there = np.isfinite(q).all(-1)
        outcome = np.full(len(q), np.nan)
        law = (gain, damping, steps, tolerance)
        outcome[there] = _servo(image, estimated_jacobian, q[there], target[there], limits, *law)
        starts[some] = q.reshape(len(some), *shape, -1)
        converged[some] = outcome.reshape(len(some), *shape)
    return Basin(converged, starts, away, unit)


def _limits(lower: ArrayLike, upper: ArrayLike, p: int) -> tuple[Floats, Floats]:
    low, high = as_float_array(lower, "lower", ndim=1), as_float_array(upper, "upper", ndim=1)
    if low.shape != (p,) or high.shape != (p,) or not (low <= high).all():
        raise InvalidArray(f"lower {low.shape} and upper {high.shape} must be ({p},) each, lower not above upper")
    return low, high


def _images_of_goals(image: Field, goals: Floats) -> tuple[Floats, int]:
    """The true images of the goals, NaN for goals that are not finite, and the number of image coordinates."""
    known = np.isfinite(goals).all(-1)
    if not known.any():
        raise InvalidArray("goals holds no finite posture")
    value = as_float_array(image(goals[known]), "the value of image", ndim=2)
    if value.shape != (int(known.sum()), value.shape[-1]):
        raise InvalidArray(f"the value of image has shape {value.shape}; it must be ({int(known.sum())}, m)")
    images = np.full((len(goals), value.shape[-1]), np.nan)
    images[known] = value
    return images, value.shape[-1]


def _directions(directions: ArrayLike, m: int) -> Float[np.ndarray, "directions m"]:
    """Unit vectors on the screen."""
    if not isinstance(directions, int):
        vectors = as_float_array(directions, "directions", ndim=2)
    elif m == 2:
        angles = 2 * np.pi * np.arange(directions) / directions
        vectors = np.stack([np.cos(angles), np.sin(angles)], -1)
    else:
        vectors = np.random.default_rng(0).normal(size=(directions, m))
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if vectors.ndim != 2 or vectors.shape[1] != m or not (np.isfinite(lengths) & (lengths > 0)).all():
        raise InvalidArray(f"directions must be a number, or vectors (directions, {m}) that are finite and not zero")
    return np.asarray(vectors / lengths)


def _step(J: Floats, wanted: Floats, damping: float) -> Float[np.ndarray, "k p"]:
    """The damped least-squares change of the joints for a wanted change of the image; none for a zero Jacobian."""
    size = np.sqrt(np.einsum("kij,kij->k", J, J) / J.shape[1])[:, None, None]
    # Scaled first, so that neither a tiny nor a huge estimate meets the damping as anything but itself.
    J = np.where(size == 0, 0, J / size)
    gram = np.einsum("kip,kjp->kij", J, J) + damping**2 * np.eye(J.shape[1])
    pull = np.linalg.solve(gram, wanted[..., None])[..., 0]
    return np.asarray(np.einsum("kip,ki->kp", J, pull) / np.where(size == 0, 1, size)[:, 0])


def _step_within(J: Floats, wanted: Floats, q: Floats, limits: tuple[Floats, Floats]) -> Float[np.ndarray, "k p"]:
    """The step over the joints that no limit holds back."""
    lower, upper = limits
    step = _step(J, wanted, _START_DAMPING)
    free = np.ones(q.shape, dtype=bool)
    for _ in range(q.shape[1]):
        held = free & (((q <= lower) & (step < 0)) | ((q >= upper) & (step > 0)))
        rows = held.any(-1)
        if not rows.any():
            break
        free &= ~held
        step[rows] = _step(J[rows] * free[rows, None], wanted[rows], _START_DAMPING)
    return step


def _starts(
    image: Field,
    true_jacobian: Field,
    goals: Floats,
    centre: Floats,
    offset: Floats,
    limits: tuple[Floats, Floats],
) -> Float[np.ndarray, "k p"]:
    """Postures whose images are at an offset from those of goals, NaN where no such posture is found."""
    (k, p), m = goals.shape, centre.shape[1]
    found, live, q = np.full((k, p), np.nan), np.arange(k), np.clip(goals, *limits)
    close = _ARRIVED * np.linalg.norm(offset, axis=-1)
    for step in range(_APPROACH + _POLISH + 1):
        position = answer(image, "image", (len(q), m), q)
        arrived = np.linalg.norm(centre[live] + offset[live] - position, axis=-1) <= close[live]
        found[live[arrived]] = q[arrived]
        going = np.isfinite(position).all(-1) & ~arrived
        live, q, position = live[going], q[going], position[going]
        if len(live) == 0:
            break
        J = answer(true_jacobian, "true_jacobian", (len(q), m, p), q)
        aim = centre[live] + min(1.0, (step + 1) / _APPROACH) * offset[live]
        q = np.clip(q + _step_within(J, aim - position, q, limits), *limits)
        finite = np.isfinite(q).all(-1)
        live, q = live[finite], q[finite]
        if len(live) == 0:
            break
    return found


def _servo(
    image: Field,
    estimated_jacobian: Field,
    q: Floats,
    target: Floats,
    limits: tuple[Floats, Floats],
    gain: float,
    damping: float,
    steps: int,
    tolerance: float,
) -> Bool[np.ndarray, "k"]:
    """Whether each trial converges."""
    (k, p), m = q.shape, target.shape[1]
    converged, live = np.zeros(k, dtype=bool), np.arange(k)
    for step in range(steps + 1):
        if len(live) == 0:
            break
        error = answer(image, "image", (len(q), m), q) - target[live]
        size = np.linalg.norm(error, axis=-1)
        converged[live] = size < tolerance
        going = size >= _SETTLED * tolerance
        live, q, error = live[going], q[going], error[going]
        if step == steps or len(live) == 0:
            break
        J = answer(estimated_jacobian, "estimated_jacobian", (len(q), m, p), q)
        following = np.clip(q - gain * _step(J, error, damping), *limits)
        finite = np.isfinite(following).all(-1)
        converged[live[~finite]] = False
        # Where nothing moves nothing will: the law knows no time.
        moving = finite & (following != q).any(-1)
        live, q = live[moving], following[moving]
    return converged
