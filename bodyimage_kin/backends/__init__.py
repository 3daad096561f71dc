"""Independent kinematics libraries behind one protocol.

``kinematics(robot)`` gives the fastest one, ``kinematics(robot, "pinocchio")`` the oracle. A backend has one method,
pose and Jacobian; everything else is shared (:class:`RobotKinematics`).
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Mapping
from types import ModuleType
from typing import Any

from bodyimage_kin._named import named_class
from bodyimage_kin.backends._protocol import Abilities as Abilities
from bodyimage_kin.backends._protocol import Kinematics as Kinematics
from bodyimage_kin.backends._protocol import abilities as _abilities
from bodyimage_kin.backends._shared import Reference as Reference
from bodyimage_kin.backends._shared import RobotKinematics as RobotKinematics
from bodyimage_kin.backends._shared import somebody_differentiates as somebody_differentiates
from bodyimage_kin.backends.torch_backend import chain_pose as chain_pose
from bodyimage_kin.errors import InvalidConfig, MissingDependency, UnknownName
from bodyimage_kin.robot import Robot

__all__ = [
    "Abilities",
    "Kinematics",
    "Reference",
    "RobotKinematics",
    "backends",
    "chain_pose",
    "kinematics",
    "somebody_differentiates",
]

# Name -> (module it imports, where the class is, how to install it), fastest first.
_KNOWN: Mapping[str, tuple[str, str, str]] = {
    "numba": ("numba", "bodyimage_kin.backends.numba_backend:NumbaBackend", "pip install numba"),
    "torch": ("torch", "bodyimage_kin.backends.torch_backend:TorchBackend", "pip install torch"),
    "pinocchio": ("pinocchio", "bodyimage_kin.backends.pinocchio_backend:PinocchioBackend", "pip install pin"),
    "pytorch_kinematics": (
        "pytorch_kinematics",
        "bodyimage_kin.backends.pytorch_kinematics_backend:PytorchKinematicsBackend",
        "pip install pytorch-kinematics",
    ),
    "mujoco": ("mujoco", "bodyimage_kin.backends.mujoco_backend:MujocoBackend", "pip install mujoco"),
}


def backends() -> dict[str, str]:
    """The known backends, fastest first: ``"installed"``, or the command that installs what is missing."""
    return {
        name: "installed" if importlib.util.find_spec(module) else install
        for name, (module, _, install) in _KNOWN.items()
    }


def kinematics(robot: Robot, backend: str | Kinematics | type | None = None) -> RobotKinematics:
    """The kinematics of a robot, by one backend.

    Args:
        robot: The robot.
        backend: A name (:func:`backends` lists them), ``"package.module:Class"`` (found where it is installed, or in
            the current folder), a class built as ``Class(robot)``,
            an object that has ``pose_and_jacobian`` (built for ``robot.unfolded``, or for the robot itself if it
            resolves followers, see :class:`Abilities`), or None: the fastest one installed (``torch`` in place of
            ``numba`` where ``NUMBA_DISABLE_JIT`` keeps it from compiling).

    Raises:
        UnknownName: A name that is none of the known ones.
        MissingDependency: The backend's library is not installed.
        InvalidConfig: What is named, or given, has no ``pose_and_jacobian``.
    """
    if backend is None:
        from bodyimage_kin._compiled import compiles

        installed = [name for name, state in backends().items() if state == "installed"]
        backend = next(name for name in installed if name != "numba" or compiles())
    if isinstance(backend, str):
        name, built = backend, _load(backend)
    elif isinstance(backend, type):
        name, built = backend.__name__, backend
    else:
        name, built = type(backend).__name__, backend
    if not callable(getattr(built, "pose_and_jacobian", None)):
        raise InvalidConfig(f"backend {name!r} has no method pose_and_jacobian(q, link)")
    if isinstance(built, type):
        built = built(robot if _abilities(built).followers else robot.unfolded)
    return RobotKinematics(robot, built, name)


def _load(name: str) -> Any:
    """The class behind a backend's name."""
    if name in _KNOWN:
        module, place, install = _KNOWN[name]
        if importlib.util.find_spec(module) is None:
            raise MissingDependency(f"backend '{name}' needs {module}, which is not installed; {install}")
        name = place
    if ":" not in name:
        raise UnknownName("backend", name, (*_KNOWN, "package.module:Class"))
    return named_class("backend", name, ("pose_and_jacobian",))


class _Callable(ModuleType):
    """Importing this package puts it in the place of the function ``bodyimage_kin.backends``: so it can be called."""

    def __call__(self) -> dict[str, str]:
        return backends()


sys.modules[__name__].__class__ = _Callable
