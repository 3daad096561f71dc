"""A Jacobian trained elsewhere: a torch module, or a function of postures, under the interface of all the others."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin._arrays import ArrayLike, as_float_tensor
from bodyimage_kin._named import named_object
from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.estimators._field import ImageModel
from bodyimage_kin.estimators.base import Estimator, LearnedJacobian, load_learned

__all__ = ["Function", "Given", "GivenImage", "GivenJacobian", "Saved"]

Function: TypeAlias = Callable[..., ArrayLike] | str
"""A function or torch module, or where it is found: ``"package.module:NAME"``."""
_STEP = 1e-5
"""Of differences, where a function cannot be differentiated [rad or m]."""


@dataclass(frozen=True, eq=False)
class Given(Estimator):
    """What somebody else trained: one function, as a learned Jacobian (:attr:`learned`) and as a row of a study.

    One of the three is enough; a displacement may stand beside a Jacobian, for what is not linear in dq. Functions take
    batches, tensors of float64, and give tensors or arrays; a torch module is asked in its own dtype and device. What
    is missing follows: a Jacobian by derivative (differences of 1e-5 where a function cannot be differentiated), a
    displacement as J dq.

    Attributes:
        p: Number of felt joints.
        m: Number of coordinates of a hand image.
        jacobian: Postures (count, p) -> (count, m, p).
        displacement: Postures and displacements of the joints, both (count, p) -> (count, m).
        hand_image: Postures (count, p) -> (count, m).
        unit: Of the hand image; empty where it is not known.
        batched: Whether the functions take batches; else they are asked posture by posture, (p,) -> (m, p) or (m,).
        arrays: Whether the functions take numpy arrays instead of tensors.
    """

    p: int
    m: int
    jacobian: Function | None = None
    displacement: Function | None = None
    hand_image: Function | None = None
    unit: str = ""
    batched: bool = True
    arrays: bool = False

    def __post_init__(self) -> None:
        _checks.whole("p", self.p, least=1)
        _checks.whole("m", self.m, least=1)
        _checks.flag("batched", self.batched)
        _checks.flag("arrays", self.arrays)
        for name in ("jacobian", "displacement", "hand_image"):
            function = getattr(self, name)
            if function is not None and not isinstance(function, str) and not callable(function):
                _checks.refuse(name, function, "a function, or its place 'package.module:NAME'")
            # Under its place a function can be written down, and workers find it.
            object.__setattr__(self, name, _place(function))
        if self.jacobian is None and self.displacement is None and self.hand_image is None:
            raise InvalidConfig("Given: give jacobian=, displacement= or hand_image=")
        if self.hand_image is not None and not (self.jacobian is None and self.displacement is None):
            raise InvalidConfig("Given: a hand_image has its own Jacobian; give no other function beside it")

    @property
    def learned(self) -> GivenJacobian | GivenImage:
        """The learned Jacobian.

        Raises:
            InvalidConfig: A place at which there is no function.
        """
        of_image, of_jacobian, of_step = (
            None if function is None else _Asked(name, function, shape, self)
            for name, function, shape in (
                ("hand_image", self.hand_image, (self.m,)),
                ("jacobian", self.jacobian, (self.m, self.p)),
                ("displacement", self.displacement, (self.m,)),
            )
        )
        if of_image is not None:
            return GivenImage(self.p, self.m, of_image, unit=self.unit)
        return GivenJacobian(self.p, self.m, of_jacobian, of_step, unit=self.unit)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> GivenJacobian | GivenImage:
        """What was given, whatever the experience. See :meth:`Estimator.fit`."""
        return self.learned


@dataclass(frozen=True)
class Saved(Estimator):
    """What ``learned.save(folder)`` wrote, learned from another experience, as a row of a study.

    Attributes:
        folder: Where it is.
    """

    folder: str | os.PathLike[str]

    def __post_init__(self) -> None:
        folder = os.fspath(self.folder) if isinstance(self.folder, os.PathLike) else self.folder
        object.__setattr__(self, "folder", _checks.text("folder", folder))

    def fit(self, exp: xr.Dataset, seed: int = 0) -> LearnedJacobian:
        """What was saved, whatever the experience. See :meth:`Estimator.fit`.

        Raises:
            InvalidConfig: There is no learned Jacobian in the folder.
        """
        return load_learned(self.folder)


class _Asked:
    """A function that is asked for a batch, and its answer checked."""

    def __init__(self, name: str, function: Function, shape: tuple[int, ...], asked: Given) -> None:
        found = named_object("function", function) if isinstance(function, str) else function
        if not callable(found):
            raise InvalidConfig(f"{name}: {function!r} is {type(found).__name__}, no function; name a function")
        self.name, self.function, self.shape = name, found, shape
        self.batched, self.arrays = asked.batched, asked.arrays

    def __call__(self, *postures: Tensor) -> Tensor:
        """The answer for postures (count, p), in float64."""
        count = len(postures[0])
        if count == 0:
            return torch.zeros(0, *self.shape, dtype=torch.float64)
        asked = self._as_wanted(postures)
        if self.batched:
            return self._checked(self.function(*asked), (count, *self.shape))
        return torch.stack([self._checked(self.function(*one), self.shape) for one in zip(*asked, strict=True)])

    def _as_wanted(self, postures: tuple[Tensor, ...]) -> tuple[Any, ...]:
        """The postures as arrays, or as a torch module's parameters are."""
        if self.arrays:
            return tuple(one.detach().numpy() for one in postures)
        first = next(self.function.parameters(), None) if isinstance(self.function, torch.nn.Module) else None
        return postures if first is None else tuple(one.to(first) for one in postures)

    def _checked(self, answer: Any, shape: tuple[int, ...]) -> Tensor:
        found = as_float_tensor(answer, f"the value of {self.name}")
        if tuple(found.shape) != shape:
            raise InvalidArray(f"the value of {self.name} has shape {tuple(found.shape)}; it must be {shape}")
        return found.to("cpu", torch.float64)


def _derivative(
    function: Callable[[Tensor], Tensor], x: Float[Tensor, "count p"], m: int
) -> Float[Tensor, "count m p"]:
    """Derivative of each answer with respect to its own row, by back-propagation or by differences."""
    kept = x.requires_grad and torch.is_grad_enabled()
    with torch.enable_grad():
        inputs = x if kept else x.detach().requires_grad_()
        answer = function(inputs)
        if answer.requires_grad:
            rows = [
                torch.autograd.grad(answer[:, axis].sum(), inputs, retain_graph=True, create_graph=kept)[0]
                for axis in range(m)
            ]
            return torch.stack(rows, 1)
    steps = _STEP * torch.eye(x.shape[1], dtype=x.dtype)
    with torch.no_grad():
        columns = [(function(x + step) - function(x - step)) / (2.0 * _STEP) for step in steps]
    return torch.stack(columns, -1)


class _Sized:
    """Numbers of joints and coordinates that are told."""

    joints: int
    axes: int

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return self.joints

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return self.axes


@dataclass(frozen=True, eq=False)
class GivenJacobian(_Sized, LearnedJacobian):
    """A Jacobian that was trained elsewhere.

    Attributes:
        joints: p.
        axes: m.
        of_posture: (count, p) -> (count, m, p); None: the derivative of the displacement.
        of_step: (count, p), (count, p) -> (count, m); None: the Jacobian times the displacement of the joints.
    """

    joints: int
    axes: int
    of_posture: Callable[[Tensor], Tensor] | None
    of_step: Callable[[Tensor, Tensor], Tensor] | None

    def _displacement(self, q: Float[Tensor, "*batch p"], dq: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        if self.of_step is None:
            return (self._jacobian(q) @ dq.to(q)[..., None])[..., 0]
        moved = self.of_step(q.reshape(-1, self.p).to(torch.float64), dq.reshape(-1, self.p).to(torch.float64))
        return moved.to(q.dtype).reshape(*q.shape[:-1], self.m)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        flat = q.reshape(-1, self.p).to(torch.float64)
        if self.of_posture is not None:
            found = self.of_posture(flat)
        else:
            assert self.of_step is not None
            of_step = self.of_step
            found = _derivative(lambda dq: of_step(flat, dq), torch.zeros_like(flat), self.m)
        return found.to(q.dtype).reshape(*q.shape[:-1], self.m, self.p)


@dataclass(frozen=True, eq=False)
class GivenImage(_Sized, ImageModel):
    """A map from posture to hand image that was trained elsewhere, and the Jacobian that is its derivative.

    Attributes:
        joints: p.
        axes: m.
        of_posture: (count, p) -> (count, m).
    """

    joints: int
    axes: int
    of_posture: Callable[[Tensor], Tensor]

    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return self.of_posture(q.reshape(-1, self.p).to(torch.float64)).to(q.dtype).reshape(*q.shape[:-1], self.m)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        found = _derivative(self.of_posture, q.reshape(-1, self.p).to(torch.float64), self.m)
        return found.to(q.dtype).reshape(*q.shape[:-1], self.m, self.p)


def _place(function: Function | None) -> Function | None:
    """Where a function is found, if anybody can find it there; else the function itself."""
    module, name = getattr(function, "__module__", None), getattr(function, "__qualname__", None)
    if isinstance(function, str) or not isinstance(module, str) or not isinstance(name, str) or module == "__main__":
        return function
    found: Any = sys.modules.get(module)
    for part in name.split("."):
        found = getattr(found, part, None)
    return f"{module}:{name}" if found is function else function
