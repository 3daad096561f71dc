"""What the hand does: the three motions of the paper, others in view of the eye, and the base of any other.

A motion is a frozen spec. It says where the hand is led; :func:`bodyimage_kin.simulate` says how the arm follows, what
is felt of it and what disturbs it. A motion of your own is a frozen dataclass with a ``path``::

    @dataclass(frozen=True)
    class Wave(bk.motions.Motion):
        height: float = 0.05
        in_view: ClassVar[bool] = True

        def path(self, body, rng, sampling):
            return bk.motions.Path(centres)  # (time, 3) in the axes of body.front_link [m]
"""

from __future__ import annotations

import abc
import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np
from jaxtyping import Float

from bodyimage_kin import _checks
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.recordings.paths import Path, Timeline, along, lengths

__all__ = ["TOUR", "Babbling", "Circle", "Circles", "FaceTour", "Lissajous", "Motion", "Path", "RandomTouch"]

MOST_SAMPLES = 10**6
"""Of one trial of a motion."""
TOUR = ("mouth", "nose", "right_eye", "left_eye", "nose")
"""The paper's sequence of landmarks (section 4.1)."""

_FINE = 20_000
"""Pieces of a figure along which its length is measured."""
_Knots: TypeAlias = Float[np.ndarray, "knots"]


@dataclass(frozen=True, kw_only=True)
class Motion(abc.ABC):
    """What the hand does, and how it is sampled.

    A class says by two attributes what it is for; an embodiment that does not fit is told so. ``in_view``: the eye sees
    the hand in every sample. ``touches``: the hand is on the skin all the time, and the eye sees it in none; with
    dynamics it is pressed on.

    Attributes:
        speed: Of the hand [m/s].
        sampling: Time between samples [s].
        rest_spread: Each trial's rest posture is home plus a uniform draw of this half width a joint [rad].
        rest_pull: Rate at which joints return to rest where the hand leaves them free [1/s]; without dynamics.
    """

    speed: float = 0.05
    sampling: float = 0.1
    rest_spread: float = 0.1
    rest_pull: float = 0.5
    in_view: ClassVar[bool] = False
    touches: ClassVar[bool] = False

    def __post_init__(self) -> None:
        self._positive("speed", "sampling")
        self._not_negative("rest_spread", "rest_pull")

    @property
    def silence(self) -> float:
        """Probability that a touch is not reported; a motion may have a setting of this name."""
        return 0.0

    @abc.abstractmethod
    def path(self, body: Embodiment, rng: np.random.Generator, sampling: float) -> Path:
        """The path of one trial.

        Args:
            body: The embodiment.
            rng: Draws whatever differs from trial to trial.
            sampling: Time between the path's samples [s]; with dynamics they are finer than the recording's.
        """

    def _positive(self, *names: str) -> None:
        self._check(names, above=0.0)

    def _not_negative(self, *names: str) -> None:
        self._check(names, least=0.0)

    def _check(self, names: tuple[str, ...], **bounds: Any) -> None:
        """Makes fields plain numbers, within bounds."""
        for name in names:
            value = _checks.number(f"{type(self).__name__}: {name}", getattr(self, name), **bounds)
            object.__setattr__(self, name, value)

    def _refuse_endless(self, seconds: float, remedy: str) -> None:
        """Refuses a trial of more samples than a recording can hold."""
        if not seconds / self.sampling <= MOST_SAMPLES:
            raise InvalidConfig(
                f"{type(self).__name__}: a trial of {seconds:.3g} s, sampled every {self.sampling:g} s, has more than "
                f"{MOST_SAMPLES} samples; give {remedy}"
            )


@dataclass(frozen=True)
class Circle(Motion):
    """Circles in front of the face, in view, as many one way as the other: what a Jacobian is learned from (Fig. 7).

    Each trial begins at a phase of its own. The circle is frontal; its centre lies on the line through the hand's
    centre on the middle taxel, or, of a body without skin, on the camera's axis.

    Attributes:
        radius: Of the circle [m].
        distance: In front of touching, along the face's forward direction; without a skin, the depth in front of the
            camera [m].
        turns: Each way.
    """

    radius: float = 0.05
    distance: float = 0.03
    turns: float = 3.0
    in_view: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self._positive("radius", "turns")
        self._not_negative("distance")
        self._refuse_endless(4 * np.pi * self.turns * (self.radius / self.speed), "fewer turns or a smaller radius")

    @property
    def duration(self) -> float:
        """Of a trial, both ways [s]."""
        return 4 * np.pi * self.turns * self.radius / self.speed

    def path(self, body: Embodiment, rng: np.random.Generator, sampling: float) -> Path:
        """The circles, from a random phase."""
        frame = body.circle_frame(self.distance)
        way = 2 * np.pi * self.turns
        duration = way * self.radius / self.speed
        times = np.arange(0.0, 2 * duration + 1e-9, sampling)
        turned = np.where(times <= duration, times, 2 * duration - times) * self.speed / self.radius
        angle = rng.uniform(0, 2 * np.pi) + turned
        # Clockwise first, as the eye behind the screen sees it: right, then down.
        aside = np.cos(angle)[:, None] * frame.right + np.sin(angle)[:, None] * frame.down
        return Path(frame.origin + self.radius * aside)


@dataclass(frozen=True)
class Circles(Motion):
    """Circles at several distances, and of several radii, in view: first all of them one way, then the way back.

    A monocular eye tells depth only by how the image moves with it: a learner that saw one distance takes it for all
    (:class:`Circle`). From one circle to the next the hand goes straight, without turning, at the same speed.

    Attributes:
        distances: Of each circle, as of :class:`Circle` [m].
        radii: Of each circle, or one for all [m].
        turns: Of each circle, each way.
    """

    distances: Sequence[float] = (0.02, 0.05, 0.10)
    radii: Sequence[float] = (0.05,)
    turns: float = 1.0
    in_view: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self._positive("turns")
        distances = _checks.numbers_of("Circles: distances", self.distances, least=0.0)
        radii = _checks.numbers_of("Circles: radii", self.radii, above=0.0)
        if not distances:
            _checks.refuse("Circles: distances", self.distances, "one distance or more")
        if len(radii) not in (1, len(distances)):
            _checks.refuse("Circles: radii", self.radii, f"one for all, or {len(distances)}, one a distance")
        object.__setattr__(self, "distances", distances)
        object.__setattr__(self, "radii", radii)

    @property
    def duration(self) -> float:
        """Of a trial, both ways [s]."""
        return float(2 * self._knots()[0][-1] / self.speed)

    def path(self, body: Embodiment, rng: np.random.Generator, sampling: float) -> Path:
        """The circles, from a random phase."""
        frame = body.circle_frame(self.distances[0])
        way, turned, radius, ahead = self._knots()
        times = np.arange(0.0, 2 * way[-1] / self.speed + 1e-9, sampling)
        gone = np.minimum(times * self.speed, 2 * way[-1] - times * self.speed)
        angle = rng.uniform(0, 2 * np.pi) + np.interp(gone, way, turned)
        aside = np.cos(angle)[:, None] * frame.right + np.sin(angle)[:, None] * frame.down
        centre = frame.origin + (np.interp(gone, way, ahead) - ahead[0])[:, None] * frame.forward
        return Path(centre + np.interp(gone, way, radius)[:, None] * aside)

    def _knots(self) -> tuple[_Knots, _Knots, _Knots, _Knots]:
        """One way: length of the way so far, angle turned, radius and distance; each linear from knot to knot."""
        radii = np.broadcast_to(np.array(self.radii), len(self.distances))
        knots = [(0.0, 0.0, float(radii[0]), self.distances[0])]
        for radius, distance in zip(radii, self.distances, strict=True):
            way, turned, last_radius, last_distance = knots[-1]
            way += float(np.hypot(radius - last_radius, distance - last_distance))
            knots.append((way, turned, float(radius), distance))
            angle = 2 * np.pi * self.turns
            knots.append((way + angle * float(radius), turned + angle, float(radius), distance))
        way, turned, radius, ahead = np.array(knots).T
        return way, turned, radius, ahead


@dataclass(frozen=True)
class Lissajous(Motion):
    """A figure that fills a box in view: each coordinate swings at a rate of its own.

    ``width sin(a t)`` to the right, ``height sin(b t + pi/3)`` down and ``depth sin(c t + 2 pi/3)`` ahead, at constant
    speed; each trial begins somewhere else on it.

    Attributes:
        distance: Of the box's middle, as of :class:`Circle` [m].
        width: Half the box's size to the right [m].
        height: Half its size downwards [m].
        depth: Half its size ahead [m].
        rates: The whole numbers a, b, c, whose ratio alone counts.
        duration: Of a trial [s].
    """

    distance: float = 0.06
    width: float = 0.04
    height: float = 0.04
    depth: float = 0.04
    rates: Sequence[int] = (5, 4, 3)
    duration: float = 40.0
    in_view: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self._positive("width", "height", "duration")
        self._not_negative("distance")
        self._check(("depth",), least=0.0, most=self.distance)
        if not isinstance(self.rates, list | tuple | np.ndarray) or len(self.rates) != 3:
            _checks.refuse("Lissajous: rates", self.rates, "three whole numbers")
        rates = tuple(_checks.whole(f"Lissajous: rates[{i}]", rate, least=1) for i, rate in enumerate(self.rates))
        object.__setattr__(self, "rates", rates)

    def path(self, body: Embodiment, rng: np.random.Generator, sampling: float) -> Path:
        """The figure, from a random place on it."""
        frame = body.circle_frame(self.distance)
        phase = np.linspace(0.0, 2 * np.pi, _FINE + 1)
        swings = np.sin(phase[:, None] * np.array(self.rates) + np.array([0.0, 1.0, 2.0]) * np.pi / 3)
        figure = swings * np.array([self.width, self.height, self.depth])
        length = lengths(figure)
        times = np.arange(0.0, self.duration - 1e-9, sampling)
        gone = (rng.uniform(0.0, length[-1]) + self.speed * times) % length[-1]
        return Path(along(frame.origin, (frame.right, frame.down, frame.forward), figure, length, gone))


@dataclass(frozen=True)
class Babbling(Motion):
    """The hand goes straight to one place after another, drawn at random from a cylinder in view.

    Places are uniform over the cylinder's volume. It is the hand that babbles: joints that a place leaves free stay
    near their rest posture.

    Attributes:
        nearest: Distance of the cylinder's near end, as of :class:`Circle` [m].
        farthest: Distance of its far end [m].
        radius: Of the cylinder [m].
        duration: Of a trial [s].
    """

    nearest: float = 0.02
    farthest: float = 0.10
    radius: float = 0.05
    duration: float = 40.0
    in_view: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self._positive("radius", "duration")
        self._not_negative("nearest")
        self._check(("farthest",), least=self.nearest)

    def path(self, body: Embodiment, rng: np.random.Generator, sampling: float) -> Path:
        """From place to place."""
        frame = body.circle_frame(self.nearest)
        places: list[np.ndarray] = []
        way = 0.0
        while way <= self.speed * self.duration:
            angle, aside = rng.uniform(0.0, 2 * np.pi), self.radius * np.sqrt(rng.uniform())
            ahead = (self.farthest - self.nearest) * rng.uniform()
            places.append(np.array([aside * np.cos(angle), aside * np.sin(angle), ahead]))
            way += float(np.linalg.norm(places[-1] - places[-2])) if len(places) > 1 else 0.0
        stops = np.array(places)
        gone = self.speed * np.arange(0.0, self.duration - 1e-9, sampling)
        return Path(along(frame.origin, (frame.right, frame.down, frame.forward), stops, lengths(stops), gone))


@dataclass(frozen=True)
class FaceTour(Motion):
    """The hand visits landmarks of the face, touching it: where velocities are compared (Figs. 8 and 9).

    Each stroke along the skin has a minimum-jerk profile, ``10 s^3 - 15 s^4 + 6 s^5`` (Flash and Hogan 1985);
    ``speed`` is its mean.

    Attributes:
        landmarks: Two or more names of landmarks of the skin, in order.
        silence: Probability that a touch is not reported.
    """

    landmarks: Sequence[str] = TOUR
    silence: float = 0.0
    touches: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check(("silence",), least=0.0, most=1.0)
        listed = isinstance(self.landmarks, list | tuple)
        if not (listed and all(isinstance(name, str) for name in self.landmarks)):
            _checks.refuse("FaceTour: landmarks", self.landmarks, "names of landmarks in a list")
        if len(self.landmarks) < 2:
            _checks.refuse("FaceTour: landmarks", self.landmarks, "two landmarks or more")
        object.__setattr__(self, "landmarks", tuple(self.landmarks))

    def path(self, body: Embodiment, rng: np.random.Generator, sampling: float) -> Path:
        """The strokes, the same in every trial.

        Raises:
            UnknownName: A landmark the skin does not have.
        """
        skin = body.require_skin()
        for name in self.landmarks:
            if name not in skin.landmarks:
                raise UnknownName("landmark", name, skin.landmarks)
        stops = [skin.landmarks[name] for name in self.landmarks]
        timeline = Timeline(body, self.speed)
        for start, end in itertools.pairwise(stops):
            timeline.stroke(start, end, lambda s: 10 * s**3 - 15 * s**4 + 6 * s**5)
        self._refuse_endless(timeline.clock, "a higher speed")
        return timeline.sampled(sampling, timeline.clock)


@dataclass(frozen=True)
class RandomTouch(Motion):
    """The hand slides over the face from one random taxel to the next: what maps are learned from (section 4.2).

    Targets are uniform over all taxels. The hand starts at rest at the reference; it sets out to return there at the
    first target after each multiple of ``reset_interval``.

    Attributes:
        duration: [s].
        reset_interval: Time between returns to the reference [s]; None: it never returns.
        rest: How long the hand rests at the reference [s].
        silence: Probability that a touch is not reported (0.2 in the paper).
    """

    duration: float = 800.0
    reset_interval: float | None = 10.0
    rest: float = 0.5
    silence: float = 0.2
    touches: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self._positive("duration", "rest", *(() if self.reset_interval is None else ("reset_interval",)))
        self._check(("silence",), least=0.0, most=1.0)
        self._refuse_endless(self.duration, "a shorter duration")

    def path(self, body: Embodiment, rng: np.random.Generator, sampling: float) -> Path:
        """Strokes between random taxels."""
        skin = body.require_skin()
        reference = skin.reference
        timeline = Timeline(body, self.speed)
        timeline.rest(reference, self.rest)
        here, next_reset = reference, self.reset_interval
        while timeline.clock < self.duration:
            if next_reset is not None and self.reset_interval is not None and timeline.clock >= next_reset:
                timeline.stroke(here, reference)
                timeline.rest(reference, self.rest)
                here = reference
                next_reset += self.reset_interval * max(1, np.ceil((timeline.clock - next_reset) / self.reset_interval))
                continue
            target = int(rng.integers(skin.count, size=1)[0])
            timeline.stroke(here, target)
            here = target
        return timeline.sampled(sampling, self.duration - sampling / 2)


def written(motion: object) -> dict[str, dict[str, Any]]:
    """A motion as a table, ``{CLASS: {field: value}}``: the class by name, or as ``package.module:Class``.

    Raises:
        InvalidConfig: No motion, or one whose own settings cannot be told.
    """
    if not isinstance(motion, Motion):
        named = f"{motion.__name__} (the class)" if isinstance(motion, type) else type(motion).__name__
        raise InvalidConfig(f"motion is {named}; give a motion, such as bk.motions.Circle()")
    cls = type(motion)
    if "__dataclass_fields__" not in vars(cls):
        raise InvalidConfig(f"motion {cls.__name__} is no dataclass; write @dataclass(frozen=True) above the class")
    name = cls.__name__ if cls.__module__ == __name__ else f"{cls.__module__}:{cls.__qualname__}"
    return {name: {field.name: getattr(motion, field.name) for field in dataclasses.fields(motion)}}
