"""The motions over which errors are foretold: near and far, wide and narrow, driven and free, long and short."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import xarray as xr

from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.recordings import Noise, motions, simulate
from bodyimage_kin.study.grid import stream


@dataclass(frozen=True)
class Condition:
    """One way to look at the hand before it touches.

    Touch and each circle have random streams of their own, by seed and not by name: conditions stay paired.

    Attributes:
        name: Its name in results.
        family: Conditions of one family differ in distance alone.
        distances: Of the circle from touching, one a trial [m].
        radius: Of the circle [m].
        turns: Each way, of each trial.
        dynamics: A passive arm in a dynamics simulator, or kinematic motion with the least joint displacement.
        torque_noise: Standard deviation of the random torque on the hand, with dynamics [N m].
        encoder_noise: Standard deviation of the noise on felt joint values [rad].
        image_noise: Standard deviation of the noise on the felt hand image [m].
    """

    name: str
    family: str
    distances: tuple[float, ...]
    radius: float = 0.05
    turns: float = 3.0
    dynamics: bool = True
    torque_noise: float = 0.1
    encoder_noise: float = 0.0
    image_noise: float = 0.0

    def circle(self, body: Embodiment, seed: int) -> xr.Dataset:
        """The recording in sight; several distances are as many trials of it."""
        trials = [
            simulate(body, motions.Circle(self.radius, distance, self.turns), own, **self._settings)
            for own, distance in zip(self.streams(seed)[1:], self.distances, strict=True)
        ]
        return _one_recording(trials)

    def touch(self, body: Embodiment, seed: int, duration: float) -> xr.Dataset:
        """The recording out of sight, moved likewise."""
        return simulate(body, motions.RandomTouch(duration), self.streams(seed)[0], **self._settings)

    def streams(self, seed: int) -> list[int]:
        """Seeds of touch, then of each circle: the first ones are those of every other condition."""
        return stream(0, f"foreknowledge/{seed}", 1 + len(self.distances))

    @property
    def _settings(self) -> dict[str, Any]:
        torque = self.torque_noise if self.dynamics else 0.0
        return {"dynamics": self.dynamics, "noise": Noise(torque, self.encoder_noise, self.image_noise)}


def _one_recording(trials: Sequence[xr.Dataset]) -> xr.Dataset:
    if len(trials) == 1:
        return trials[0]
    numbered = [trial.assign_coords(trial=[index]) for index, trial in enumerate(trials)]
    unfelt = {"touched": -1, "true_touched": -1, "at_reference": False}
    return xr.concat(
        numbered, "trial", data_vars="minimal", coords="minimal", compat="override", join="outer", fill_value=unfelt
    )


def _at(centimetres: int) -> str:
    return f"{centimetres} cm"


CONDITIONS: tuple[Condition, ...] = (
    *(Condition(_at(d), "noisy", (d / 100,)) for d in (2, 3, 4, 6, 8, 10, 12)),
    *(Condition(f"noise-free, {_at(d)}", "noise-free", (d / 100,), torque_noise=0.0) for d in (3, 8)),
    *(Condition(f"kinematic, {_at(d)}", "kinematic", (d / 100,), dynamics=False) for d in (3, 8)),
    *(Condition(f"radius {_at(r)}, 3 cm", f"radius {_at(r)}", (0.03,), radius=r / 100) for r in (3, 7)),
    Condition("one turn, 3 cm", "one turn", (0.03,), turns=1.0),
    *(
        Condition(f"noisy sensors, {_at(d)}", "noisy sensors", (d / 100,), encoder_noise=1e-3, image_noise=2e-4)
        for d in (3, 8)
    ),
    Condition("three distances", "three distances", (0.02, 0.05, 0.08), turns=1.0),
)
"""The infant's arm reaches no farther than 12 cm in front with a circle of 5 cm."""
