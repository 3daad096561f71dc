"""Where the hand is led: paths of its centre in the axes of the skin's link (or the camera's), sampled.

A path knows no joints; motions (:mod:`bodyimage_kin.recordings.motions`) make them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from bodyimage_kin._arrays import as_float_array
from bodyimage_kin._shown import Shown
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig

__all__ = ["Coordinates", "Path", "Timeline", "along", "lengths"]

Coordinates = Float[np.ndarray, "count d"]
_FINE = 64
"""Points on which the length of a stroke along the skin is measured."""


@dataclass(frozen=True, eq=False)
class Path(Shown):
    """A path of the hand's centre.

    Attributes:
        centres: (time, 3) in the axes of the body's ``front_link`` [m].
        at_reference: (time,) whether the hand rests at the reference taxel; None: nowhere.
    """

    centres: Float[np.ndarray, "time 3"]
    at_reference: Bool[np.ndarray, "time"] | None = None

    def __post_init__(self) -> None:
        centres = as_float_array(self.centres, "path: centres", error=InvalidConfig)
        if centres.ndim != 2 or centres.shape[1] != 3 or not len(centres) or not np.isfinite(centres).all():
            raise InvalidConfig(f"path: centres have shape {centres.shape}; give finite numbers of shape (time, 3) [m]")
        object.__setattr__(self, "centres", centres)
        if self.resting.shape != (len(centres),) or self.resting.dtype != bool:
            raise InvalidConfig(f"path: at_reference has shape {self.resting.shape}; give one true or false a sample")

    @property
    def resting(self) -> Bool[np.ndarray, "time"]:
        """(time,) whether the hand rests at the reference taxel."""
        return np.zeros(len(self.centres), dtype=bool) if self.at_reference is None else np.asarray(self.at_reference)


def lengths(places: Float[np.ndarray, "places 3"]) -> Float[np.ndarray, "places"]:
    """Length of the way to each place [m]."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])


def along(
    origin: Float[np.ndarray, "3"],
    axes: tuple[Float[np.ndarray, "3"], ...],
    places: Float[np.ndarray, "places 3"],
    length: Float[np.ndarray, "places"],
    gone: Float[np.ndarray, "time"],
) -> Float[np.ndarray, "time 3"]:
    """Where one is on a straight way from place to place once so much of it is gone.

    Args:
        origin: Of the places [m].
        axes: Three unit vectors, along which places are told.
        places: [m].
        length: Of the way to each [m].
        gone: [m].
    """
    told = np.stack([np.interp(gone, length, places[:, axis]) for axis in range(3)], axis=1)
    return np.asarray(origin + told @ np.stack(axes))


class Timeline:
    """Strokes and rests on the skin, one after the other."""

    def __init__(self, body: Embodiment, speed: float) -> None:
        self.body, self.speed = body, speed
        self.clock = 0.0
        self.times: list[np.ndarray] = []
        self.coordinates: list[np.ndarray] = []
        self.rests: list[tuple[float, float]] = []

    def rest(self, taxel: int, duration: float) -> None:
        """Stays at a taxel, which is the reference."""
        self.rests.append((self.clock, self.clock + duration))
        self._add(np.array([0.0, duration]), self.body.require_skin().coordinates(np.array([taxel, taxel])))

    def stroke(
        self,
        start: int,
        end: int,
        profile: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> None:
        """Slides from one taxel to another; time runs with the length of the way of the hand's centre.

        On a whole grid the way is straight in its coordinates, on any other skin it follows the graph of neighbours.
        """
        skin = self.body.require_skin()
        stops = skin.coordinates(np.array(skin.way(start, end)))
        share = np.linspace(0.0, 1.0, _FINE * (len(stops) - 1))
        if len(stops) == 2:
            coordinates = stops[0] + share[:, None] * (stops[1] - stops[0])
        else:
            legs = np.linalg.norm(np.diff(stops[:, :3], axis=0), axis=1)
            passed = np.concatenate([[0.0], np.cumsum(legs)]) / legs.sum()
            coordinates = np.stack([np.interp(share, passed, axis) for axis in stops.T], axis=1)
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.centres(coordinates), axis=0), axis=1))])
        if length[-1] == 0.0:
            return
        if profile is None:
            self._add(length / self.speed, coordinates)
            return
        times = np.linspace(0.0, length[-1] / self.speed, len(share))
        along = profile(share) * length[-1]
        self._add(
            times, np.stack([np.interp(along, length, coordinates[:, axis]) for axis in range(stops.shape[1])], axis=1)
        )

    def centres(self, coordinates: Coordinates) -> Float[np.ndarray, "count 3"]:
        """Centres of a hand that touches the skin at these coordinates."""
        points, normals = self.body.require_skin().surface_at(coordinates)
        return points + self.body.hand.radius * normals

    def sampled(self, sampling: float, end: float) -> Path:
        """The path at equal steps of time, from zero to ``end`` [s]."""
        times = np.arange(0.0, end + 1e-9, sampling)
        known, places = np.concatenate(self.times), np.concatenate(self.coordinates)
        coordinates = np.stack([np.interp(times, known, axis) for axis in places.T], axis=1)
        resting = np.zeros(len(times), dtype=bool)
        for begin, until in self.rests:
            resting |= (times >= begin - 1e-9) & (times <= until + 1e-9)
        return Path(self.centres(coordinates), resting)

    def _add(self, times: np.ndarray, coordinates: np.ndarray) -> None:
        self.times.append(self.clock + times)
        self.coordinates.append(coordinates)
        self.clock += float(times[-1])
