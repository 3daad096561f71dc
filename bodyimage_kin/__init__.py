"""Learned kinematics held against the analytic truth, and the body image built on it.

Public names are loaded when first used, so that ``import bodyimage_kin`` and ``bodyimage-kin --help`` stay quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

if TYPE_CHECKING:
    from bodyimage_kin import body_image as body_image
    from bodyimage_kin import calibration as calibration
    from bodyimage_kin import errors as errors
    from bodyimage_kin import estimators as estimators
    from bodyimage_kin import figures as figures
    from bodyimage_kin import metrics as metrics
    from bodyimage_kin import published as published
    from bodyimage_kin import recordings as recordings
    from bodyimage_kin import report as report
    from bodyimage_kin import study as study
    from bodyimage_kin import testing as testing
    from bodyimage_kin import view as view
    from bodyimage_kin.backends import Kinematics as Kinematics
    from bodyimage_kin.backends import RobotKinematics as RobotKinematics
    from bodyimage_kin.backends import backends as backends
    from bodyimage_kin.backends import kinematics as kinematics
    from bodyimage_kin.body import Camera as Camera
    from bodyimage_kin.body import Hand as Hand
    from bodyimage_kin.body import Pinhole as Pinhole
    from bodyimage_kin.body import Skin as Skin
    from bodyimage_kin.body import Stereo as Stereo
    from bodyimage_kin.body import Tracker as Tracker
    from bodyimage_kin.body import VirtualScreen as VirtualScreen
    from bodyimage_kin.body.embodiment import Embodiment as Embodiment
    from bodyimage_kin.body.file import embodiments as embodiments
    from bodyimage_kin.body.file import load_embodiment as load_embodiment
    from bodyimage_kin.body_image import BodyImage as BodyImage
    from bodyimage_kin.body_image import BodyImageDraws as BodyImageDraws
    from bodyimage_kin.body_image import integrate as integrate
    from bodyimage_kin.body_image import integrate_draws as integrate_draws
    from bodyimage_kin.calibration import calibrate as calibrate
    from bodyimage_kin.calibration import next_postures as next_postures
    from bodyimage_kin.errors import BodyImageKinError as BodyImageKinError
    from bodyimage_kin.estimators import load_learned as load_learned
    from bodyimage_kin.metrics import probes as probes
    from bodyimage_kin.recordings import Drag as Drag
    from bodyimage_kin.recordings import Noise as Noise
    from bodyimage_kin.recordings import experience as experience
    from bodyimage_kin.recordings import motions as motions
    from bodyimage_kin.recordings import read_recording as read_recording
    from bodyimage_kin.recordings import recording as recording
    from bodyimage_kin.recordings import write_recording as write_recording
    from bodyimage_kin.recordings.simulation import simulate as simulate
    from bodyimage_kin.robot import Robot as Robot
    from bodyimage_kin.study import Study as Study
    from bodyimage_kin.study import read_study as read_study
    from bodyimage_kin.study import score as score

# Public name -> the module that it is, or module:name. ``backends`` is a module that can be called: it lists them.
_PUBLIC = {
    "BodyImage": "body_image:BodyImage",
    "BodyImageDraws": "body_image:BodyImageDraws",
    "BodyImageKinError": "errors:BodyImageKinError",
    "Camera": "body:Camera",
    "Drag": "recordings:Drag",
    "Embodiment": "body.embodiment:Embodiment",
    "Hand": "body:Hand",
    "Kinematics": "backends:Kinematics",
    "Noise": "recordings:Noise",
    "Pinhole": "body:Pinhole",
    "Robot": "robot:Robot",
    "RobotKinematics": "backends:RobotKinematics",
    "Skin": "body:Skin",
    "Stereo": "body:Stereo",
    "Study": "study:Study",
    "Tracker": "body:Tracker",
    "VirtualScreen": "body:VirtualScreen",
    "backends": "backends",
    "body_image": "body_image",
    "calibrate": "calibration:calibrate",
    "calibration": "calibration",
    "embodiments": "body.file:embodiments",
    "errors": "errors",
    "estimators": "estimators",
    "experience": "recordings:experience",
    "figures": "figures",
    "integrate": "body_image:integrate",
    "integrate_draws": "body_image:integrate_draws",
    "kinematics": "backends:kinematics",
    "load_embodiment": "body.file:load_embodiment",
    "load_learned": "estimators:load_learned",
    "metrics": "metrics",
    "motions": "recordings.motions",
    "next_postures": "calibration:next_postures",
    "probes": "metrics.probes",
    "published": "published",
    "read_recording": "recordings:read_recording",
    "read_study": "study:read_study",
    "recording": "recordings:recording",
    "recordings": "recordings",
    "report": "report",
    "score": "study:score",
    "simulate": "recordings.simulation:simulate",
    "study": "study",
    "testing": "testing",
    "view": "view",
    "write_recording": "recordings:write_recording",
}

__all__ = ["__version__", *sorted(_PUBLIC)]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'bodyimage_kin' has no attribute {name!r}")
    module, _, attribute = _PUBLIC[name].partition(":")
    value: Any = importlib.import_module(f"bodyimage_kin.{module}")
    if attribute:
        value = getattr(value, attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
