"""Calibration: bodies fitted to recordings, with priors and with what remains unknown."""

from bodyimage_kin.calibration.calibrated import Calibrated as Calibrated
from bodyimage_kin.calibration.calibrated import HeldOut as HeldOut
from bodyimage_kin.calibration.choice import NextPostures as NextPostures
from bodyimage_kin.calibration.choice import next_postures as next_postures
from bodyimage_kin.calibration.drawn import drawn_bodies as drawn_bodies
from bodyimage_kin.calibration.fitting import calibrate as calibrate
from bodyimage_kin.calibration.fitting import halves as halves
from bodyimage_kin.calibration.prior import Prior as Prior
from bodyimage_kin.calibration.problem import Observed as Observed

__all__ = [
    "Calibrated",
    "HeldOut",
    "NextPostures",
    "Observed",
    "Prior",
    "calibrate",
    "drawn_bodies",
    "halves",
    "next_postures",
]
