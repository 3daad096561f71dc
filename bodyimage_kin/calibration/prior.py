"""What is known of a body before anything was observed: how far each measure may be from what it is thought to be."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

from bodyimage_kin import _checks
from bodyimage_kin.estimators.parametric import Parameter

__all__ = ["Prior"]


@dataclass(frozen=True)
class Prior:
    """Standard deviations of a body's measures about what they are thought to be; inf says that nothing is known.

    Attributes:
        axes: Tilt of a joint's axis, in each of two directions [rad].
        offsets: Shift of a joint's origin, in each of three directions [m].
        encoders: Zero of a revolute joint's encoder [rad]; of a prismatic one a tenth of that [m].
        hand_shift: Place of the hand on its link [m].
        hand_turn: Its orientation, which matters where several points of it are observed [rad].
        camera_shift: Place of the camera on its link [m].
        camera_turn: Its orientation [rad].
        skin_shift: Place of the skin on its link [m].
        skin_turn: Its orientation [rad].
        tracker_shift: Place of a tracker's frame [m]; nothing is known of it by default.
        tracker_turn: Its orientation [rad].
        intrinsics: Relative, of focal lengths and of the screen's distance; principal points move by as much of the
            focal length, and distortion coefficients by ten times as much.
        plane: Place of a plane [m], and its tilt [rad]; nothing is known of it by default.
    """

    axes: float = 0.05
    offsets: float = 0.005
    encoders: float = 0.02
    hand_shift: float = 0.02
    hand_turn: float = 0.1
    camera_shift: float = 0.01
    camera_turn: float = 0.05
    skin_shift: float = 0.02
    skin_turn: float = 0.1
    tracker_shift: float = math.inf
    tracker_turn: float = math.inf
    intrinsics: float = 0.01
    plane: float = math.inf

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value != math.inf:
                _checks.number(field.name, value, above=0.0)

    def sd(self, parameter: Parameter) -> float:
        """Standard deviation of one parameter [its unit]."""
        if parameter.group in ("hand", "camera", "skin", "tracker"):
            turns = parameter.unit == "rad"
            return float(getattr(self, f"{parameter.group}_{'turn' if turns else 'shift'}"))
        if parameter.group == "encoders":
            return self.encoders if parameter.unit == "rad" else self.encoders / 10
        if parameter.group == "intrinsics":
            return self.intrinsics * parameter.size
        return float(getattr(self, parameter.group))

    def sds(self, parameters: tuple[Parameter, ...]) -> Float[np.ndarray, "parameters"]:
        """Standard deviation of each parameter [its unit]."""
        return np.array([self.sd(parameter) for parameter in parameters])
