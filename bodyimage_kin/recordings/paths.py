"""Where the hand is led: paths of its centre in the axes of the skin's link, sampled in time.

A path knows no joints. The three motions of the paper are a circle in front of the face (Fig. 7), a tour of the
landmarks (Fig. 8) and touches at random (section 4.2).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig, UnknownName

Coordinates = Float[np.ndarray, "count 2"]
_FINE = 64
"""Points on which the length of a stroke along the skin is measured."""


@dataclass(frozen=True, eq=False)
class Path:
    """A path of the hand's centre.

    Attributes:
        centres: (time, 3) in the skin's link [m].
        at_reference: (time,) whether the hand rests at the reference taxel.
    """

    centres: Float[np.ndarray, "time 3"]
    at_reference: Bool[np.ndarray, "time"]


def circle(
    body: Embodiment,
    rng: np.random.Generator,
    *,
    radius: float,
    distance: float,
    turns: float,
    speed: float,
    sampling: float,
) -> Path:
    """Circles in front of the face, as many one way as the other, from a random phase.

    The circle is frontal; its centre lies on the line through the hand's centre on the middle taxel, ``distance`` in
    front of it.

    Args:
        body: The embodiment.
        rng: Draws the phase.
        radius: Of the circle [m].
        distance: In front of touching [m].
        turns: Each way.
        speed: [m/s].
        sampling: Time between samples [s].
    """
    patch = body.require_skin().patch
    middle = (body.require_skin().shape[0] // 2) * body.require_skin().shape[1] + body.require_skin().shape[1] // 2
    centre = body.touch_centres([middle], distance)[0].numpy()
    way = 2 * np.pi * turns
    duration = way * radius / speed
    times = np.arange(0.0, 2 * duration + 1e-9, sampling)
    angle = rng.uniform(0, 2 * np.pi) + np.where(times <= duration, times, 2 * duration - times) * speed / radius
    # Clockwise first, as the eye behind the screen sees it: right, then down.
    aside = np.cos(angle)[:, None] * patch.right + np.sin(angle)[:, None] * patch.down
    return Path(centre + radius * aside, np.zeros(len(times), dtype=bool))


def face_tour(body: Embodiment, *, landmarks: Sequence[str], speed: float, sampling: float) -> Path:
    """A tour of landmarks along the skin, each stroke with a minimum-jerk profile of this mean speed.

    Flash and Hogan (1985) for the profile ``10 s^3 - 15 s^4 + 6 s^5``.

    Args:
        body: The embodiment.
        landmarks: Two or more names, in order.
        speed: Mean speed of a stroke [m/s].
        sampling: Time between samples [s].

    Raises:
        UnknownName: A landmark the skin does not have.
        InvalidConfig: Fewer than two landmarks.
    """
    if len(landmarks) < 2:
        raise InvalidConfig("landmarks: a tour visits two or more")
    for name in landmarks:
        if name not in body.require_skin().landmarks:
            raise UnknownName("landmark", name, body.require_skin().landmarks)
    stops = body.require_skin().coordinates(np.array([body.require_skin().landmarks[name] for name in landmarks]))
    timeline = _Timeline(body, speed)
    for start, end in itertools.pairwise(stops):
        timeline.stroke(start, end, lambda s: 10 * s**3 - 15 * s**4 + 6 * s**5)
    return timeline.sampled(sampling, timeline.clock)


def random_touch(
    body: Embodiment,
    rng: np.random.Generator,
    *,
    duration: float,
    speed: float,
    reset_interval: float | None,
    rest: float,
    sampling: float,
) -> Path:
    """The hand slides over the skin from one random taxel to the next, and returns to the reference to rest.

    Targets are uniform over all taxels. The hand starts at rest at the reference; it sets out to return there at the
    first target after each multiple of ``reset_interval``.

    Args:
        body: The embodiment.
        rng: Draws the targets.
        duration: [s].
        speed: [m/s].
        reset_interval: Time between returns [s]; None: it never returns.
        rest: How long it rests at the reference [s].
        sampling: Time between samples [s].
    """
    reference = body.require_skin().coordinates(np.array([body.require_skin().reference]))[0]
    timeline = _Timeline(body, speed)
    timeline.rest(reference, rest)
    here, next_reset = reference, reset_interval
    while timeline.clock < duration:
        if next_reset is not None and reset_interval is not None and timeline.clock >= next_reset:
            timeline.stroke(here, reference)
            timeline.rest(reference, rest)
            here = reference
            next_reset += reset_interval * max(1, np.ceil((timeline.clock - next_reset) / reset_interval))
            continue
        target = body.require_skin().coordinates(rng.integers(body.require_skin().count, size=1))[0]
        timeline.stroke(here, target)
        here = target
    return timeline.sampled(sampling, duration - sampling / 2)


class _Timeline:
    """Strokes and rests on the skin, one after the other."""

    def __init__(self, body: Embodiment, speed: float) -> None:
        self.body, self.speed = body, speed
        self.clock = 0.0
        self.times: list[np.ndarray] = []
        self.coordinates: list[np.ndarray] = []
        self.rests: list[tuple[float, float]] = []

    def rest(self, place: Float[np.ndarray, "2"], duration: float) -> None:
        """Stays at a place, which is the reference."""
        self.rests.append((self.clock, self.clock + duration))
        self._add(np.array([0.0, duration]), np.stack([place, place]))

    def stroke(
        self,
        start: Float[np.ndarray, "2"],
        end: Float[np.ndarray, "2"],
        profile: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> None:
        """Slides straight in the grid's coordinates; time runs with the length of the way of the hand's centre."""
        share = np.linspace(0.0, 1.0, _FINE)
        coordinates = start + share[:, None] * (end - start)
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.centres(coordinates), axis=0), axis=1))])
        if length[-1] == 0.0:
            return
        if profile is None:
            self._add(length / self.speed, coordinates)
            return
        times = np.linspace(0.0, length[-1] / self.speed, _FINE)
        along = profile(share) * length[-1]
        self._add(times, np.stack([np.interp(along, length, coordinates[:, axis]) for axis in (0, 1)], axis=1))

    def centres(self, coordinates: Coordinates) -> Float[np.ndarray, "count 3"]:
        """Centres of a hand that touches the skin at these coordinates."""
        points, normals = self.body.require_skin().surface(coordinates)
        return points + self.body.hand.radius * normals

    def sampled(self, sampling: float, end: float) -> Path:
        """The path at equal steps of time, from zero to ``end`` [s]."""
        times = np.arange(0.0, end + 1e-9, sampling)
        known, places = np.concatenate(self.times), np.concatenate(self.coordinates)
        coordinates = np.stack([np.interp(times, known, places[:, axis]) for axis in (0, 1)], axis=1)
        resting = np.zeros(len(times), dtype=bool)
        for begin, until in self.rests:
            resting |= (times >= begin - 1e-9) & (times <= until + 1e-9)
        return Path(self.centres(coordinates), resting)

    def _add(self, times: np.ndarray, coordinates: np.ndarray) -> None:
        self.times.append(self.clock + times)
        self.coordinates.append(coordinates)
        self.clock += float(times[-1])
