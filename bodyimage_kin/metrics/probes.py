"""Probes: frozen specs of the postures at which a learned Jacobian is scored, and how far those are from what was seen.

They leave the training set step by step: its own postures, the taxels a little in front of the face, the taxels
touched, the whole joint space. A probe of one's own is a subclass of :class:`Probe`, or any object with its method.
"""

from __future__ import annotations

import abc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol, runtime_checkable

import numpy as np
import scipy.spatial
import torch
import xarray as xr
from jaxtyping import Bool, Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike, as_float_array, as_postures, refuse_not_finite
from bodyimage_kin._checks import number, whole
from bodyimage_kin.body.cameras import VirtualScreen
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig, InvalidPosture, InvalidRecording, NotVisible
from bodyimage_kin.recordings import check, require_aligned

__all__ = [
    "Face",
    "HasPostures",
    "JointSpace",
    "Probe",
    "Training",
    "by_posture",
    "distances",
    "probe_postures",
    "spread_root",
]

_MOST = 10**6
"""Postures of a joint space."""
_DRAWS = 100
"""Postures that are drawn at most for each one wanted."""
_CHUNK = 50_000
"""Postures worked on at once: bounds the memory of wide probes."""


@runtime_checkable
class HasPostures(Protocol):
    """What counts as a probe: all that is asked of a :class:`Probe`."""

    def postures(self, body: Embodiment, seen: xr.Dataset | None) -> ArrayLike:
        """As :meth:`Probe.postures`."""


class Probe(abc.ABC):
    """A frozen spec of the postures at which a learned Jacobian is scored."""

    @abc.abstractmethod
    def postures(self, body: Embodiment, seen: xr.Dataset | None) -> ArrayLike:
        """The postures; pure: the same body and recording, the same bits.

        Args:
            body: The embodiment.
            seen: The recording that is learned from.

        Returns:
            (postures, p) [rad or m], finite, in the order of the body's joints.
        """


@dataclass(frozen=True)
class Training(Probe):
    """The postures of what was learned from: the true ones where the recording has a truth, else the felt ones."""

    def postures(self, body: Embodiment | None, seen: xr.Dataset | None) -> Float[Tensor, "postures p"]:
        """All finite postures of all trials, in order; where there is a body, of its joints.

        Raises:
            InvalidRecording: A recording without postures, or of other joints.
            UnknownName: A joint that the body does not feel.
        """
        if seen is None:
            raise InvalidRecording("the training postures are those of a recording; give what was learned from")
        return torch.from_numpy(_training_postures(seen, body))


@dataclass(frozen=True)
class Face(Probe):
    """One posture a taxel, the hand touching it or a little in front.

    Attributes:
        distance: Of the hand in front of the skin [m]; 0 touches it.
    """

    distance: float | int = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "distance", number("distance", self.distance, least=0.0))

    def postures(self, body: Embodiment, seen: xr.Dataset | None) -> Float[Tensor, "postures p"]:
        """One a taxel, in their order; whatever was seen.

        Raises:
            Unreachable: A taxel that the hand cannot reach.
        """
        return _face(body, self.distance)


@dataclass(frozen=True)
class JointSpace(Probe):
    """Postures uniform within the joint limits at which the hand has an image; the same for every recording.

    An image within the camera's sensor; on a virtual screen, which has no border, beyond its near plane.

    Attributes:
        count: How many.
        seed: Which ones.
    """

    count: int = 441
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "count", whole("count", self.count, least=1, most=_MOST))
        object.__setattr__(self, "seed", whole("seed", self.seed, least=0))

    def postures(self, body: Embodiment, seen: xr.Dataset | None) -> Float[Tensor, "postures p"]:
        """The postures; those of fewer are the first ones of more.

        Raises:
            NotVisible: A body whose hand hardly ever comes before the camera.
        """
        return _joint_space(body, self.count, self.seed)


def probe_postures(
    probe: HasPostures | object, body: Embodiment, seen: xr.Dataset | None
) -> Float[Tensor, "postures p"]:
    """The postures of any probe, known to be such.

    Args:
        probe: One of ours, or anybody's.
        body: The embodiment.
        seen: The recording that is learned from; None: nothing was seen.

    Raises:
        InvalidConfig: Not a probe.
        InvalidPosture: No finite postures (postures, p) of this body.
        BodyImageKinError: Whatever the probe itself refuses.
    """
    if not isinstance(probe, HasPostures) or isinstance(probe, type):
        raise InvalidConfig(f"probe {probe!r}: give an object with a method postures(body, seen), such as Training()")
    what = f"postures of probe {type(probe).__name__}"
    q = as_postures(probe.postures(body, seen), body.p, what)
    if q.ndim != 2 or len(q) == 0:
        raise InvalidPosture(f"{what} have shape {tuple(q.shape)}; give at least one, (postures, {body.p})")
    refuse_not_finite(q, what)
    return q


def distances(
    body: Embodiment, training: xr.Dataset, q: ArrayLike
) -> tuple[Float[np.ndarray, "postures"], Float[np.ndarray, "postures"]]:
    """How far postures are from those of training.

    Args:
        body: The embodiment.
        training: The recording that is learned from.
        q: (postures, p) [rad].

    Returns:
        Mahalanobis distance in the joint space of training (mean and covariance of the postures of
        :class:`Training`, with 1e-6 of its mean diagonal added so that it can be inverted; dimensionless), and distance
        of the hand from the nearest place where it was in training [m].
    """
    seen = _training_postures(training, body)
    postures = as_float_array(q, "q", ndim=2)
    whitened = np.linalg.solve(spread_root(seen), (postures - seen.mean(0)).T)
    places, here = (_in_chunks(body.hand_position, torch.from_numpy(one)).numpy() for one in (seen, postures))
    return np.linalg.norm(whitened, axis=0), np.asarray(scipy.spatial.KDTree(places).query(here)[0])


def spread_root(postures: Float[np.ndarray, "postures p"]) -> Float[np.ndarray, "p p"]:
    """Cholesky factor of their covariance, 1e-6 of its mean diagonal added [rad]: the unit of Mahalanobis distance."""
    covariance = np.atleast_2d(np.cov(postures.T, bias=True))
    covariance += 1e-6 * np.trace(covariance) / len(covariance) * np.eye(len(covariance))
    return np.asarray(np.linalg.cholesky(covariance))


def _training_postures(training: xr.Dataset, body: Embodiment | None) -> Float[np.ndarray, "postures p"]:
    training = check(training) if body is None else require_aligned(training, body)
    name = "true_q" if "true_q" in training else "q"
    q = as_float_array(training[name].values, name, ndim=1)
    q = q.reshape(-1, q.shape[-1])
    q = q[np.isfinite(q).all(1)]
    if len(q) == 0:
        raise InvalidRecording("the recording that is learned from has no postures")
    return q


# The same for every recording and estimator of an embodiment, so a worker finds them once.
@lru_cache(maxsize=8)
def _face(body: Embodiment, distance: float) -> Float[Tensor, "postures p"]:
    return body.touch_postures(np.arange(body.require_skin().count), distance)


@lru_cache(maxsize=8)
def _joint_space(body: Embodiment, count: int, seed: int) -> Float[Tensor, "postures p"]:
    """Uniform within the limits; postures whose hand has no image are drawn again."""
    # The first postures of a longer draw are those of a shorter one, so no more are drawn than it takes.
    drawn = seen = body.felt_robot.sample(0, seed=seed)
    draws = 2 * count
    while len(seen) < count and len(drawn) < count * _DRAWS:
        drawn = body.felt_robot.sample(min(draws, count * _DRAWS), seed=seed)
        seen = drawn[_before_the_camera(body, _in_chunks(body.hand_in_camera, drawn))]
        draws = 1 + int(1.1 * draws * count / max(1, len(seen)))
    if len(seen) < count:
        raise NotVisible(
            f"embodiment '{body.name}': the hand is before the camera in only {len(seen)} of {len(drawn)} postures; "
            f"probe fewer than {count} of the joint space"
        )
    return seen[:count].clone()


def _before_the_camera(body: Embodiment, points: Float[Tensor, "postures 3"]) -> Bool[Tensor, "postures"]:
    """Whether points have an image: within the sensor, or anywhere on a virtual screen, which has no border."""
    model = body.camera.model
    return points[:, 2] >= model.near if isinstance(model, VirtualScreen) else model.visible(points)


def _in_chunks(of: Callable[[Tensor], Tensor], q: Float[Tensor, "postures p"]) -> Float[Tensor, "postures ..."]:
    """A function of postures, computed for few of them at a time."""
    with torch.no_grad():
        return torch.cat([of(part) for part in torch.split(q, _CHUNK)])


def by_posture(rows: Sequence[np.ndarray]) -> Float[np.ndarray, "probe posture"]:
    """Arrays of different lengths, one a probe, as one array, NaN beyond each one's end."""
    found = np.full((len(rows), max(map(len, rows))), np.nan)
    for row, values in zip(found, rows, strict=True):
        row[: len(values)] = values
    return found
