"""One constant Jacobian, shrunk towards zero where the motion says little (Hoerl and Kennard 1970)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.estimators._hold_out import choose
from bodyimage_kin.estimators._samples import Pairs, pairs
from bodyimage_kin.estimators.base import Estimator
from bodyimage_kin.estimators.least_squares import ConstantJacobian


def ridge(
    X: Float[Tensor, "count k"], Y: Float[Tensor, "count m"], penalties: Float[Tensor, "candidates"]
) -> Float[Tensor, "candidates k m"]:
    """The weights that minimise ``mean |y - x W|^2 + penalty |W|^2``, for each penalty."""
    U, strengths, V = torch.linalg.svd(X, full_matrices=False)
    # A zero singular value with a zero penalty is 0/0: nothing is learned along it.
    filters = strengths / (strengths**2 + penalties[:, None] * len(X))
    smallest = float(strengths[0]) * len(X) * torch.finfo(X.dtype).eps
    filters = torch.where(strengths > smallest, filters, 0.0)
    return V.T @ (filters[..., None] * (U.T @ Y))


@dataclass(frozen=True)
class Ridge(Estimator):
    """The constant Jacobian that minimises ``mean |dr - J dq|^2 + penalty |J|^2``.

    Attributes:
        penalty: In the units of the data [rad^2 per step]: a direction in which the joints' mean squared displacement
            is less than this is shrunk to less than half. None: the best of 33 on what is held out.
        folds: Number of parts of the experience, each held out once to choose the penalty.
    """

    penalty: float | None = None
    folds: int = 5

    def __post_init__(self) -> None:
        if self.penalty is not None:
            _checks.number("penalty", self.penalty, least=0.0)
        _checks.whole("folds", self.folds, least=2)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> ConstantJacobian:
        """Learns from an experience; the seed changes nothing. See :meth:`Estimator.fit`."""
        data = pairs(exp)
        penalty = self.penalty
        if penalty is None:
            motion = (data.dq**2).sum(-1).mean()
            penalties = motion * torch.logspace(-8, 0, 33, dtype=motion.dtype)

            def errors(learn: Pairs, predict: Pairs) -> Tensor:
                return ((predict.dq @ ridge(learn.dq, learn.dr, penalties) - predict.dr) ** 2).sum((-1, -2))

            penalty = float(penalties[choose(errors, data.folds(self.folds))])
        candidates = torch.tensor([penalty], dtype=data.dq.dtype)
        return ConstantJacobian(ridge(data.dq, data.dr, candidates)[0].T.contiguous(), unit=data.unit)
