"""What an estimator is, what it returns, and what is asked of a Jacobian that was learned anywhere.

An estimator is a frozen spec: its fields say everything but the data and the seed. ``fit`` is pure and returns a
learned Jacobian.
"""

from __future__ import annotations

import abc
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike, as_postures
from bodyimage_kin.errors import InvalidConfig, InvalidPosture
from bodyimage_kin.estimators import _kept

__all__ = [
    "Drawn",
    "Estimator",
    "HasDisplacement",
    "Learned",
    "LearnedImage",
    "LearnedJacobian",
    "Uncertain",
    "check_many",
    "load_learned",
]


@runtime_checkable
class HasDisplacement(Protocol):
    """The least that a learned Jacobian can be asked: all that integration needs."""

    def displacement(self, q: ArrayLike, dq: ArrayLike) -> Tensor:
        """Predicted displacement of the hand image ``(*batch, m)`` when the joints move by dq from q."""


@runtime_checkable
class Learned(HasDisplacement, Protocol):
    """What is asked of a learned Jacobian, whoever learned it; tensors in, tensors out.

    Postures are ``(*batch, p)`` [rad or m], displacements of the joints likewise. Hand images have m coordinates, in
    the unit of the camera. Some know more: :class:`LearnedImage`, :class:`Uncertain`, :class:`Drawn`.
    """

    @property
    def p(self) -> int:
        """Number of felt joints."""

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""

    def jacobian(self, q: ArrayLike) -> Tensor:
        """Derivative of the predicted displacement with respect to dq, at dq = 0, ``(*batch, m, p)``."""


@runtime_checkable
class LearnedImage(Learned, Protocol):
    """A learned Jacobian that is the derivative of a learned map from posture to hand image."""

    def hand_image(self, q: ArrayLike) -> Tensor:
        """The hand image that is predicted, ``(*batch, m)``."""


@runtime_checkable
class Uncertain(Learned, Protocol):
    """A learned Jacobian that knows how sure it is."""

    def covariance(self, q: ArrayLike) -> Tensor:
        """Covariance of the Jacobian's entries, row by row, ``(*batch, m p, m p)``: entry ``axis * p + joint``."""

    def displacement_covariance(self, q: ArrayLike, dq: ArrayLike) -> Tensor:
        """Covariance of the predicted displacement, ``(*batch, m, m)``."""


@runtime_checkable
class Drawn(Learned, Protocol):
    """A learned Jacobian of whose kind others are as plausible: whole functions, not independent steps."""

    def draws(self, n: int, seed: int = 0) -> Sequence[Learned]:
        """So many of them; the same seed gives the same."""


@dataclass(frozen=True, eq=False)
class LearnedJacobian(_kept.Kept, abc.ABC):
    """A learned Jacobian: predicts how the hand image moves with the felt joints.

    Subclasses are frozen dataclasses that give :meth:`_displacement`, and :meth:`_jacobian` where there is a closed
    form, on checked tensors. p, m and the files follow from the fields: their annotations name the dimensions ``p`` and
    ``m``, and a ``kind`` is the name under which what was saved is found again.

    Attributes:
        unit: Of the hand image, such as ``"m"`` or ``"px"``; empty where it is not known.
    """

    unit: str = field(default="", kw_only=True)

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return self._size("p")

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return self._size("m")

    def _glance(self) -> str:
        return f"{super()._glance()} {self.p} joints -> {self.m} coordinates [{self.unit or '?'}]"

    def displacement(self, q: ArrayLike, dq: ArrayLike) -> Float[Tensor, "*batch m"]:
        """Predicted displacement of the hand image, in :attr:`unit`.

        Args:
            q: Postures ``(*batch, p)`` [rad or m].
            dq: Displacements of the joints ``(*batch, p)`` [rad or m]; shapes broadcast.

        Raises:
            InvalidPosture: A last axis that is not of p joints.
        """
        q, dq = as_postures(q, self.p), as_postures(dq, self.p, "displacement dq")
        if q.shape != dq.shape:
            try:
                shape = np.broadcast_shapes(q.shape, dq.shape)
            except ValueError:
                raise InvalidPosture(
                    f"posture q {tuple(q.shape)} and displacement dq {tuple(dq.shape)} do not fit together"
                ) from None
            q, dq = q.expand(shape), dq.expand(shape)
        return self._displacement(q, dq)

    def jacobian(self, q: ArrayLike) -> Float[Tensor, "*batch m p"]:
        """Derivative of the predicted displacement with respect to dq, at dq = 0, in :attr:`unit` over rad or m.

        Args:
            q: Postures ``(*batch, p)`` [rad or m].

        Raises:
            InvalidPosture: A last axis that is not of p joints.
        """
        return self._jacobian(as_postures(q, self.p))

    @abc.abstractmethod
    def _displacement(self, q: Float[Tensor, "*batch p"], dq: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        """The displacement, for checked tensors of one shape."""

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        flat = q.reshape(-1, self.p)
        derivative = torch.func.vmap(torch.func.jacrev(self._displacement, argnums=1))
        return derivative(flat, torch.zeros_like(flat)).reshape(*q.shape[:-1], self.m, self.p)

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Writes ``learned.safetensors`` and ``learned.json`` into a folder, which is made when missing.

        Raises:
            InvalidConfig: It holds prior knowledge such as a body, or values that are not finite.
        """
        _kept.save(self, folder)


def load_learned(folder: str | os.PathLike[str]) -> LearnedJacobian:
    """A learned Jacobian that ``learned.save(folder)`` wrote.

    Raises:
        InvalidConfig: The folder holds none, or one that lacks something or is not finite.
        UnknownName: One of a kind that this version does not know.
    """
    loaded: LearnedJacobian = _kept.load(folder, LearnedJacobian)
    return loaded


class Estimator(abc.ABC):
    """A frozen spec that learns a Jacobian from an experience."""

    @abc.abstractmethod
    def fit(self, exp: xr.Dataset, seed: int = 0) -> LearnedJacobian:
        """Learns from an experience; pure: same experience and seed, same bits.

        Args:
            exp: An experience (:func:`bodyimage_kin.recordings.experience`).
            seed: Of whatever is drawn at random.

        Raises:
            InvalidRecording: Nothing in it to learn from.
        """

    def fit_many(self, experiences: Sequence[xr.Dataset], seeds: Sequence[int]) -> list[LearnedJacobian]:
        """Learns from several experiences, one seed each.

        Args:
            experiences: One for each seed.
            seeds: One for each experience.

        Raises:
            InvalidConfig: Unequal numbers of experiences and seeds.
        """
        check_many(experiences, seeds)
        return [self.fit(exp, seed) for exp, seed in zip(experiences, seeds, strict=True)]


def check_many(experiences: Sequence[xr.Dataset], seeds: Sequence[int]) -> None:
    """Raises InvalidConfig unless there is one seed for each experience."""
    if len(experiences) != len(seeds):
        raise InvalidConfig(f"fit_many got {len(experiences)} experiences and {len(seeds)} seeds; give one seed each")
