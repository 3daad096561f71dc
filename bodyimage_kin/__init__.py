"""Learned kinematics held against the analytic truth, and the body image built on it.

Public names are loaded when first used, so that ``import bodyimage_kin`` and ``bodyimage-kin --help`` stay quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from bodyimage_kin import errors as errors
    from bodyimage_kin import estimators as estimators
    from bodyimage_kin import metrics as metrics
    from bodyimage_kin import report as report
    from bodyimage_kin.backends import Kinematics as Kinematics
    from bodyimage_kin.backends import RobotKinematics as RobotKinematics
    from bodyimage_kin.backends import backends as backends
    from bodyimage_kin.backends import kinematics as kinematics
    from bodyimage_kin.body.embodiment import Embodiment as Embodiment
    from bodyimage_kin.body.file import embodiments as embodiments
    from bodyimage_kin.body.file import load_embodiment as load_embodiment
    from bodyimage_kin.body_image import BodyImage as BodyImage
    from bodyimage_kin.body_image import integrate as integrate
    from bodyimage_kin.errors import BodyImageKinError as BodyImageKinError
    from bodyimage_kin.estimators import load_learned as load_learned
    from bodyimage_kin.metrics import probes as probes
    from bodyimage_kin.recordings import Drag as Drag
    from bodyimage_kin.recordings import Noise as Noise
    from bodyimage_kin.recordings import experience as experience
    from bodyimage_kin.recordings import motions as motions
    from bodyimage_kin.recordings import read_recording as read_recording
    from bodyimage_kin.recordings import write_recording as write_recording
    from bodyimage_kin.recordings.simulation import simulate as simulate
    from bodyimage_kin.robot import Robot as Robot
    from bodyimage_kin.study import Study as Study

# Public name -> the module that has it.
_EXPORTS = {
    "BodyImage": "bodyimage_kin.body_image",
    "BodyImageKinError": "bodyimage_kin.errors",
    "Drag": "bodyimage_kin.recordings",
    "Embodiment": "bodyimage_kin.body.embodiment",
    "Kinematics": "bodyimage_kin.backends",
    "Noise": "bodyimage_kin.recordings",
    "Robot": "bodyimage_kin.robot",
    "RobotKinematics": "bodyimage_kin.backends",
    "Study": "bodyimage_kin.study",
    "embodiments": "bodyimage_kin.body.file",
    "experience": "bodyimage_kin.recordings",
    "integrate": "bodyimage_kin.body_image",
    "kinematics": "bodyimage_kin.backends",
    "load_embodiment": "bodyimage_kin.body.file",
    "load_learned": "bodyimage_kin.estimators",
    "read_recording": "bodyimage_kin.recordings",
    "simulate": "bodyimage_kin.recordings",
    "write_recording": "bodyimage_kin.recordings",
}
# Public modules. ``backends`` is one that can be called: ``bk.backends()`` lists them.
_MODULES = {
    "backends": "bodyimage_kin.backends",
    "errors": "bodyimage_kin.errors",
    "estimators": "bodyimage_kin.estimators",
    "metrics": "bodyimage_kin.metrics",
    "motions": "bodyimage_kin.recordings.motions",
    "probes": "bodyimage_kin.metrics.probes",
    "report": "bodyimage_kin.report",
}

__all__ = ["__version__", *sorted({*_EXPORTS, *_MODULES})]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        value: Any = importlib.import_module(_MODULES[name])
    elif name in _EXPORTS:
        value = getattr(importlib.import_module(_EXPORTS[name]), name)
    else:
        raise AttributeError(f"module 'bodyimage_kin' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
