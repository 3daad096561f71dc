"""What is tested: a kinematics library behind the thinnest adapter, called in one way whatever it is made of."""

from __future__ import annotations

import inspect
import unittest
from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np
import torch
from jaxtyping import Float

from bodyimage_kin.errors import BodyImageKinError, InvalidConfig
from bodyimage_kin.testing._spec import RobotSpec

OFFERS = ("batch", "float32", "gradient", "threads")
"""What a library may say it offers beyond a pose and a Jacobian of one posture in float64."""


class Library(Protocol):
    """The adapter to write for your library: built as ``Class(urdf)``, with one method.

    ``urdf`` is the text. A class whose first parameter is called ``robot`` gets a :class:`bodyimage_kin.Robot` instead.
    The robot is given whole, followers (mimic joints) included.

    Postures ``q`` are float64 numpy arrays (n,): the values of the moving joints that follow no other, in the order
    in which the file names them. The library may have these optional members:

    - ``joint_names``: its own order of the same joints; q and columns are then permuted for it.
    - ``hessian(q, link)``: (6, n, n), ``[:, i, k]`` is the derivative of Jacobian column i by q[k].
    - ``jacobian(q, link, reference)``: the Jacobian in ``"local_world_aligned"``, ``"local"`` and ``"world"``.
    - ``offers``: words out of ``"batch"`` (q may be ``(*batch, n)``), ``"float32"`` (q may be float32, and so are the
      results), ``"gradient"`` (q is always a torch tensor, and the results can be differentiated twice), ``"threads"``
      (one object may be called from several threads at once).

    A library that has poses only offers ``pose(q, link)`` in place of ``pose_and_jacobian``.

    A law that needs what is not offered is reported as not offered, never as passed.
    """

    def pose_and_jacobian(self, q: Any, link: str) -> tuple[Any, Any]:
        """root_T_link (4, 4), and the Jacobian (6, n), rows linear then angular, in ``local_world_aligned``."""
        ...


Build: TypeAlias = Callable[[Any], Any]
"""A class or function that makes a :class:`Library` of a URDF text (or of a ``robot``)."""


class NotOffered(BodyImageKinError, unittest.SkipTest):
    """A law needs what the library does not offer. Counts as a skipped test in pytest and unittest."""


class OurKinematics:
    """A backend of this package, by name, together with all the shared code above it."""

    offers = OFFERS

    def __init__(self, urdf: str, backend: str) -> None:
        from bodyimage_kin.backends import kinematics
        from bodyimage_kin.robot import Robot

        self._kinematics = kinematics(Robot.from_urdf(urdf), backend)
        self.pose_and_jacobian = self._kinematics.pose_and_jacobian
        self.jacobian = self._kinematics.jacobian
        self.hessian = self._kinematics.hessian


class Wrapped:
    """A built library, called with numpy arrays in the robot's own order of joints, and giving float arrays.

    Attributes:
        offers: All it offers: out of :data:`OFFERS`, ``"jacobian"``, ``"hessian"`` and ``"references"``.
        rows: Of its Jacobian: 6, or 0 when it has poses only.
    """

    def __init__(self, build: Build, robot: RobotSpec) -> None:
        self._library = build(argument(build, robot.to_urdf()))
        self.offers = offers(self._library)
        if "jacobian" not in self.offers and not callable(getattr(self._library, "pose", None)):
            raise InvalidConfig(f"{_name(build)} has no method pose_and_jacobian(q, link)")
        self.rows = 6 if "jacobian" in self.offers else 0
        self._order = _order(getattr(self._library, "joint_names", robot.joint_names), robot.joint_names)

    def pose_and_jacobian(self, q: Any, link: str) -> tuple[np.ndarray, np.ndarray]:
        """Pose (*batch, 4, 4) and Jacobian (*batch, 6, n) as float arrays of the library's own dtype."""
        pose, jacobian = self.tensors(q, link)
        return _array(pose), _array(jacobian)

    def tensors(self, q: Any, link: str) -> tuple[Any, Any]:
        """The same as the library gives them, differentiable when it is."""
        if not self.rows:
            # No rows are equal to no rows: what compares both compares poses.
            return self._library.pose(self._given(q), link), np.empty((*q.shape[:-1], 0, q.shape[-1]))
        pose, jacobian = self._library.pose_and_jacobian(self._given(q), link)
        return pose, self._taken(jacobian, -1)

    def jacobian(self, q: Float[np.ndarray, "n"], link: str, reference: str) -> Float[np.ndarray, "6 n"]:
        """The Jacobian in another reference."""
        return _array(self._taken(self._library.jacobian(self._given(q), link, reference), -1))

    def hessian(self, q: Float[np.ndarray, "n"], link: str) -> Float[np.ndarray, "6 n n"]:
        """The derivative of the Jacobian."""
        hessian = self._taken(self._library.hessian(self._given(q), link), -1)
        return _array(self._taken(hessian, -2))

    def _given(self, q: Any) -> Any:
        """Postures in the library's order, as a tensor if it works on tensors."""
        if self._order is not None:
            q = q[..., self._order]
        return torch.as_tensor(q) if "gradient" in self.offers else q

    def _taken(self, values: Any, axis: int) -> Any:
        """Values along one axis of joints, from the library's order to the robot's."""
        if self._order is None:
            return values
        inverse = [self._order.index(column) for column in range(len(self._order))]
        return values[..., inverse] if axis == -1 else values[..., inverse, :]


def offers(library: Any) -> frozenset[str]:
    """All that a library offers beyond a pose and a Jacobian, by what it says and what methods it has.

    Raises:
        InvalidConfig: It says it offers something unheard of.
    """
    said = getattr(library, "offers", ())
    if isinstance(said, str) or not set(said) <= set(OFFERS):
        raise InvalidConfig(f"{type(library).__name__}.offers is {said!r}; give words out of {', '.join(OFFERS)}")
    has = {"jacobian": "pose_and_jacobian", "hessian": "hessian", "references": "jacobian"}
    return frozenset(said) | {word for word, method in has.items() if callable(getattr(library, method, None))}


def argument(build: Build, urdf: str) -> Any:
    """What a library is built from: the URDF text, or a Robot when its first parameter is called so."""
    try:
        first = next(iter(inspect.signature(build).parameters), None)
    except (TypeError, ValueError):
        first = None
    if first != "robot":
        return urdf
    from bodyimage_kin.robot import Robot

    return Robot.from_urdf(urdf)


def _order(theirs: Sequence[str], ours: Sequence[str]) -> list[int] | None:
    """Where the library's joints stand in our order; None when both are the same."""
    theirs = list(theirs)
    if sorted(theirs) != sorted(ours):
        raise InvalidConfig(f"joint_names of the library are {theirs}; give these, in any order: {list(ours)}")
    return None if theirs == list(ours) else [list(ours).index(name) for name in theirs]


def _array(values: Any) -> Any:
    if isinstance(values, torch.Tensor):
        values = values.detach().cpu().numpy()
    return np.asarray(values)


def _name(build: Build) -> str:
    return getattr(build, "__name__", type(build).__name__)
