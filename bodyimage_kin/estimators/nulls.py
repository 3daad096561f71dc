"""Corrupted truths: estimators that are wrong in a known way, which every metric must catch.

Each corrupts something that knows better: the analytic truth of a body, or any learned Jacobian or estimator.
"""

from __future__ import annotations

import abc
import math
from dataclasses import dataclass
from typing import TypeAlias

import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators._field import JacobianField
from bodyimage_kin.estimators.analytic import Analytic
from bodyimage_kin.estimators.base import Estimator, LearnedJacobian

__all__ = ["CorruptedJacobian", "Null", "OtherArm", "RankOne", "Rotated", "Scaled", "Truth", "Zero"]

Truth: TypeAlias = Embodiment | LearnedJacobian | Estimator
"""A body, whose analytic Jacobian is meant, a learned Jacobian, or an estimator that learns one."""


@dataclass(frozen=True, eq=False)
class CorruptedJacobian(JacobianField):
    """What a null estimator makes of the Jacobian it was given.

    Attributes:
        truth: The Jacobian that is corrupted.
        null: How.
    """

    truth: LearnedJacobian
    null: Null

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return self.truth.p

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return self.truth.m

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return self.null.corrupt(self.truth.jacobian(q))


@dataclass(frozen=True, eq=False)
class Null(Estimator):
    """Corrupts a Jacobian, whatever the experience.

    Attributes:
        truth: A body, a learned Jacobian, or an estimator that is fitted first.
    """

    truth: Truth

    def fit(self, exp: xr.Dataset, seed: int = 0) -> CorruptedJacobian:
        """The corrupted Jacobian. See :meth:`Estimator.fit`."""
        truth = self._known(self.truth, exp, seed)
        return CorruptedJacobian(truth, self, unit=truth.unit)

    @staticmethod
    def _known(truth: Truth, exp: xr.Dataset, seed: int) -> LearnedJacobian:
        if isinstance(truth, Embodiment):
            return Analytic(truth).fit(exp)
        return truth if isinstance(truth, LearnedJacobian) else truth.fit(exp, seed)

    @abc.abstractmethod
    def corrupt(self, jacobian: Float[Tensor, "*batch m p"]) -> Float[Tensor, "*batch m p"]:
        """What becomes of a Jacobian."""


@dataclass(frozen=True, eq=False)
class Scaled(Null):
    """The right directions, the wrong size.

    Attributes:
        truth: As in :class:`Null`.
        factor: Of the Jacobian.
    """

    factor: float = 0.1

    def __post_init__(self) -> None:
        _checks.number("factor", self.factor)

    def corrupt(self, jacobian: Float[Tensor, "*batch m p"]) -> Float[Tensor, "*batch m p"]:
        """The Jacobian times the factor."""
        return self.factor * jacobian


@dataclass(frozen=True, eq=False)
class Zero(Null):
    """The hand never moves."""

    def corrupt(self, jacobian: Float[Tensor, "*batch m p"]) -> Float[Tensor, "*batch m p"]:
        """Nothing."""
        return torch.zeros_like(jacobian)


@dataclass(frozen=True, eq=False)
class Rotated(Null):
    """The image turned: every displacement has the right length and the wrong direction.

    Attributes:
        truth: As in :class:`Null`.
        degrees: By which the image's first two axes are turned, from the first towards the second.
    """

    degrees: float = 30.0

    def __post_init__(self) -> None:
        _checks.number("degrees", self.degrees)

    def corrupt(self, jacobian: Float[Tensor, "*batch m p"]) -> Float[Tensor, "*batch m p"]:
        """The Jacobian, its first two rows turned."""
        if jacobian.shape[-2] < 2:
            raise InvalidConfig("Rotated turns an image of at least two coordinates; this one has a single one")
        cosine, sine = math.cos(math.radians(self.degrees)), math.sin(math.radians(self.degrees))
        x, y = jacobian[..., :1, :], jacobian[..., 1:2, :]
        return torch.cat([cosine * x - sine * y, sine * x + cosine * y, jacobian[..., 2:, :]], -2)


@dataclass(frozen=True, eq=False)
class RankOne(Null):
    """Sees one direction alone: the strongest singular direction of the Jacobian at each posture."""

    def corrupt(self, jacobian: Float[Tensor, "*batch m p"]) -> Float[Tensor, "*batch m p"]:
        """The nearest Jacobian of rank one (Eckart and Young 1936)."""
        U, strengths, V = torch.linalg.svd(jacobian, full_matrices=False)
        return strengths[..., :1, None] * U[..., :, :1] @ V[..., :1, :]


@dataclass(frozen=True, eq=False)
class OtherArm(Null):
    """The Jacobian of another arm at the same joint values.

    Attributes:
        truth: As in :class:`Null`.
        other: The other arm, with as many felt joints; None: the mirror image of this one, seen by the mirrored eye.
    """

    other: Truth | None = None

    def fit(self, exp: xr.Dataset, seed: int = 0) -> CorruptedJacobian:
        """The other arm's Jacobian. See :meth:`Estimator.fit`.

        Raises:
            InvalidConfig: The other arm has another number of felt joints or image coordinates.
        """
        truth = self._known(self.truth, exp, seed)
        if self.other is None:
            return CorruptedJacobian(truth, self, unit=truth.unit)
        other = self._known(self.other, exp, seed)
        if (other.p, other.m) != (truth.p, truth.m):
            raise InvalidConfig(
                f"other: its Jacobian is {other.m} x {other.p} and that of the truth {truth.m} x {truth.p}; give an "
                "arm with as many felt joints"
            )
        return CorruptedJacobian(other, self, unit=other.unit)

    def corrupt(self, jacobian: Float[Tensor, "*batch m p"]) -> Float[Tensor, "*batch m p"]:
        """Mirrored along the image's first axis, unless the other arm is given."""
        if self.other is not None:
            return jacobian
        return torch.cat([-jacobian[..., :1, :], jacobian[..., 1:, :]], -2)
