"""Posture sets at which Jacobians are scored, and how far each posture is from what was seen.

The sets leave the training set step by step: its own postures, the taxels a little in front of the face, the taxels
touched, the whole joint space.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import numpy as np
import scipy.spatial
import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidRecording, NotVisible
from bodyimage_kin.study.specs import Table

_DRAWS = 100
"""Postures that are drawn at most for each one wanted."""
_CHUNK = 50_000
"""Postures worked on at once: bounds the memory of wide probes."""


def probe_postures(
    body: Embodiment, training: xr.Dataset, probes: Mapping[str, Table]
) -> dict[str, Float[Tensor, "postures p"]]:
    """Postures of each probe.

    Args:
        body: The embodiment.
        training: The recording that is learned from.
        probes: Name -> table of :func:`bodyimage_kin.study.specs.probe_table`. ``training``: the recording's own true
            postures. ``face``: one posture a taxel, the hand touching it or ``distance`` [m] in front. ``joint_space``:
            ``count`` postures uniform within the joint limits, of which the hand has an image (depth at least the
            near plane); the same for every recording.

    Raises:
        Unreachable: A taxel that the hand cannot reach.
        NotVisible: A body whose hand hardly ever comes before the camera.
        InvalidRecording: A recording without postures.
    """
    found = {}
    for name, table in probes.items():
        ((kind, settings),) = table.items()
        if kind == "training":
            found[name] = torch.from_numpy(_training_postures(training))
        elif kind == "face":
            found[name] = _face(body, float(settings["distance"]))
        else:
            found[name] = _joint_space(body, **settings)
    return found


def distances(
    body: Embodiment, training: xr.Dataset, q: ArrayLike
) -> tuple[Float[np.ndarray, "postures"], Float[np.ndarray, "postures"]]:
    """How far postures are from those of training.

    Args:
        body: The embodiment.
        training: The recording that is learned from.
        q: (postures, p) [rad].

    Returns:
        Mahalanobis distance in the joint space of training (mean and covariance of its true postures, with 1e-6 of its
        mean diagonal added so that it can be inverted; dimensionless), and distance of the hand from the nearest place
        where it was in training [m].
    """
    seen = _training_postures(training)
    postures = np.asarray(q, dtype=np.float64)
    whitened = np.linalg.solve(spread_root(seen), (postures - seen.mean(0)).T)
    places, here = (_in_chunks(body.hand_position, torch.from_numpy(one)).numpy() for one in (seen, postures))
    return np.linalg.norm(whitened, axis=0), np.asarray(scipy.spatial.KDTree(places).query(here)[0])


def spread_root(postures: Float[np.ndarray, "postures p"]) -> Float[np.ndarray, "p p"]:
    """Cholesky factor of their covariance, 1e-6 of its mean diagonal added [rad]: the unit of Mahalanobis distance."""
    covariance = np.atleast_2d(np.cov(postures.T, bias=True))
    covariance += 1e-6 * np.trace(covariance) / len(covariance) * np.eye(len(covariance))
    return np.asarray(np.linalg.cholesky(covariance))


def _training_postures(training: xr.Dataset) -> Float[np.ndarray, "postures p"]:
    q = training["true_q"].values
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
    """Uniform within the limits; postures whose hand is nearer than the near plane, or behind, are drawn again."""
    # The first postures of a longer draw are those of a shorter one, so no more are drawn than it takes.
    drawn = seen = body.felt_robot.sample(0, seed=seed)
    draws = 2 * count
    while len(seen) < count and len(drawn) < count * _DRAWS:
        drawn = body.felt_robot.sample(min(draws, count * _DRAWS), seed=seed)
        seen = drawn[_in_chunks(body.hand_in_camera, drawn)[:, 2] >= body.camera.screen.near]
        draws = 1 + int(1.1 * draws * count / max(1, len(seen)))
    if len(seen) < count:
        raise NotVisible(
            f"embodiment '{body.name}': the hand is before the camera in only {len(seen)} of {len(drawn)} postures; "
            f"probe fewer than {count} of the joint space"
        )
    return seen[:count].clone()


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
