"""How a motion is carried out: the drag that moves a passive arm, and the noise that disturbs it and what it feels."""

from __future__ import annotations

from dataclasses import dataclass, fields

from bodyimage_kin import _checks

__all__ = ["Drag", "Noise"]


@dataclass(frozen=True)
class Noise:
    """What disturbs a recording; all standard deviations, all independent and normal.

    Attributes:
        torque: Of each component of the random torque on the hand [N m]; with dynamics alone. Table 1's variance of
            0.01 is 0.1.
        encoder: Of what is felt of each joint [rad or m].
        image: Of each coordinate of the hand image, in the camera's unit.
        torque_hold: How long a random torque is held before the next is drawn [s]: its effect grows with this.
    """

    torque: float = 0.0
    encoder: float = 0.0
    image: float = 0.0
    torque_hold: float = 0.002

    def __post_init__(self) -> None:
        _checks_of(self, "noise", positive=("torque_hold",))


@dataclass(frozen=True)
class Drag:
    """How the hand is dragged, and how the arm follows.

    Attributes:
        stiffness: Of the spring between the hand and its target [N/m].
        damping: Of the damper between them [N s/m].
        press: How deep in the skin the target lies while the hand touches [m]: presses it on.
        friction: Coefficient of friction between hand and skin.
        tolerance: Largest gap between hand and skin that counts as touch [m].
        joint_damping: Of every joint [N m s/rad].
        rest_stiffness: Of the spring that pulls every joint to its rest posture [N m/rad].
        step: Of the simulation [s].
    """

    stiffness: float = 60.0
    damping: float = 4.0
    press: float = 0.01
    friction: float = 0.0
    tolerance: float = 1e-3
    joint_damping: float = 0.025
    rest_stiffness: float = 0.05
    step: float = 0.002

    def __post_init__(self) -> None:
        _checks_of(self, "drag", positive=("stiffness", "step"))


def _checks_of(settings: Noise | Drag, what: str, *, positive: tuple[str, ...]) -> None:
    """Makes every field a float that is positive, or not negative."""
    for field in fields(settings):
        above, least = (0.0, float("-inf")) if field.name in positive else (None, 0.0)
        value = _checks.number(f"{what}: {field.name}", getattr(settings, field.name), above=above, least=least)
        object.__setattr__(settings, field.name, value)
