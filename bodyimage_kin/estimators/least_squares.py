"""One constant Jacobian: the baseline that a network has to beat."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.estimators._carry import warn_few
from bodyimage_kin.estimators._samples import pairs
from bodyimage_kin.estimators.base import Estimator, LearnedJacobian

__all__ = ["ConstantJacobian", "LeastSquares"]


@dataclass(frozen=True, eq=False)
class ConstantJacobian(LearnedJacobian):
    """The same Jacobian at every posture.

    Attributes:
        matrix: (m, p), in the unit of the hand image over rad or m.
    """

    matrix: Float[Tensor, "m p"]

    kind = "constant"

    def _displacement(self, q: Float[Tensor, "*batch p"], dq: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return dq @ self.matrix.to(dq).T

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return self.matrix.to(q).expand(*q.shape[:-1], self.m, self.p).clone()


@dataclass(frozen=True)
class LeastSquares(Estimator):
    """The constant Jacobian that minimises ``sum |dr - J dq|^2``; of all that do, the smallest (pseudoinverse).

    Attributes:
        scale: Factor of what was found. Other than one it is prior knowledge, such as the ratio of the depths at which
            the hand was seen and will be used, which a single eye cannot know.
    """

    scale: float = 1.0

    def __post_init__(self) -> None:
        _checks.number("scale", self.scale)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> ConstantJacobian:
        """Learns from an experience; the seed changes nothing. See :meth:`Estimator.fit`."""
        data = pairs(exp, type(self).__name__)
        warn_few(type(self).__name__, data.dr.numel(), data.dq.shape[1] * data.dr.shape[1])
        solution = torch.linalg.lstsq(data.dq, data.dr, driver="gelsd").solution
        return ConstantJacobian(self.scale * solution.T.contiguous(), unit=data.unit)
