"""The motions over which errors are foretold: near and far, wide and narrow, driven and free, long and short."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bodyimage_kin import _checks
from bodyimage_kin.estimators import LeastSquares, PaperMLP, Polynomial, RationalTrig
from bodyimage_kin.estimators.base import Estimator
from bodyimage_kin.metrics.probes import Face
from bodyimage_kin.published.foreknowledge.scores import SCORES
from bodyimage_kin.recordings import Noise
from bodyimage_kin.recordings.motions import Circle, RandomTouch
from bodyimage_kin.study import Simulation, Study

__all__ = ["CONDITIONS", "ESTIMATORS", "Condition", "grid"]

ESTIMATORS: Mapping[str, Estimator] = {
    "least_squares": LeastSquares(),
    "paper_mlp": PaperMLP(hidden=10, learning_rate=0.2, steps=500),
    "polynomial": Polynomial(degree=3),
    "rational_trig": RationalTrig(),
}
"""Whose errors are foretold: a constant, the paper's network, and two that model depth."""
_TORQUE = Noise(torque=0.1)
_STREAM = "foreknowledge"
"""All conditions are paired by seed: what they do not differ in is the same."""


@dataclass(frozen=True)
class Condition:
    """One way to look at the hand before it touches.

    Attributes:
        name: Its name in results, as a reader calls it.
        family: Conditions of one family differ in distance alone.
        distances: Of the circle from touching, one a trial [m].
        radius: Of the circle [m].
        turns: Each way, of each trial.
        dynamics: A passive arm in a dynamics simulator, or kinematic motion with the least joint displacement.
        noise: Of the hand's torque, the encoders and the image.
    """

    name: str
    family: str
    distances: tuple[float, ...]
    radius: float = 0.05
    turns: float = 3.0
    dynamics: bool = True
    noise: Noise = _TORQUE

    @property
    def recording(self) -> str:
        """Its name in the study."""
        return self.name.replace(",", "").replace(" ", "_")

    def simulation(self, touch_duration: float) -> Simulation:
        """The recordings in sight and out of it; several distances are as many trials."""
        circles = tuple(Circle(self.radius, distance, self.turns) for distance in self.distances)
        return Simulation(
            circles if len(circles) > 1 else circles[0],
            use=RandomTouch(touch_duration),
            tour="none",
            dynamics=self.dynamics,
            noise=self.noise,
            stream=_STREAM,
        )


def _at(centimetres: int) -> str:
    return f"{centimetres} cm"


CONDITIONS: tuple[Condition, ...] = (
    *(Condition(_at(d), "noisy", (d / 100,)) for d in (2, 3, 4, 6, 8, 10, 12)),
    *(Condition(f"noise-free, {_at(d)}", "noise-free", (d / 100,), noise=Noise()) for d in (3, 8)),
    *(Condition(f"kinematic, {_at(d)}", "kinematic", (d / 100,), dynamics=False, noise=Noise()) for d in (3, 8)),
    *(Condition(f"radius {_at(r)}, 3 cm", f"radius {_at(r)}", (0.03,), radius=r / 100) for r in (3, 7)),
    Condition("one turn, 3 cm", "one turn", (0.03,), turns=1.0),
    *(Condition(f"noisy sensors, {_at(d)}", "noisy sensors", (d / 100,), noise=Noise(0.1, 1e-3, 2e-4)) for d in (3, 8)),
    Condition("three distances", "three distances", (0.02, 0.05, 0.08), turns=1.0),
)
"""The infant's arm reaches no farther than 12 cm in front with a circle of 5 cm."""


def grid(
    embodiment: str = "infant",
    seeds: int = 30,
    *,
    touch_duration: float = 80.0,
    conditions: Sequence[Condition] = CONDITIONS,
    backend: str | None = None,
) -> Study:
    """Every condition as a study; its scores are what is foretold, and what an onlooker then measures.

    Args:
        embodiment: Name, or path of a TOML file.
        seeds: Recordings of each condition.
        touch_duration: How long the face is touched [s].
        conditions: The motions.
        backend: Kinematics backend; None: the default.

    Raises:
        InvalidConfig: A setting out of range.
        UnknownName: No such embodiment.
    """
    duration = _checks.number("touch_duration", touch_duration, above=0.0)
    return Study(
        {"body": {"embodiment": embodiment, **({"backend": backend} if backend else {})}},
        {one.recording: one.simulation(duration) for one in conditions},
        dict(ESTIMATORS),
        probes={"on_face": Face()},
        seeds=seeds,
        scores=SCORES,
        facts=("excitation",),
        block=1,
    )
