"""One constant Jacobian, shrunk towards zero where the motion says little (Hoerl and Kennard 1970)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.estimators._field import Doubt, of_each_axis
from bodyimage_kin.estimators._hold_out import choose
from bodyimage_kin.estimators._samples import Pairs, pairs
from bodyimage_kin.estimators.base import Estimator
from bodyimage_kin.estimators.least_squares import ConstantJacobian

__all__ = ["Ridge", "RidgeJacobian", "ridge", "ridge_posterior"]

_FULL = 500
"""Directions of which all are kept, seen or not; of more only those seen, to the precision of their sum."""


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


def ridge_posterior(
    X: Float[Tensor, "count k"], Y: Float[Tensor, "count m"], W: Float[Tensor, "k m"], penalty: float, spent: int = 0
) -> tuple[Float[Tensor, "k k"], Float[Tensor, "m"]]:
    """What ridge regression leaves open: Bayesian linear regression with the prior that the penalty stands for.

    The posterior covariance of a column of weights is ``noise^2 (X'X + count penalty)^-1`` (Bishop 2006, section 3.3);
    the noise is what the fit leaves, over the degrees of freedom that it has not spent.

    Args:
        X: What was learned from.
        Y: Likewise.
        W: What was learned.
        penalty: Of the fit; where it is 0, directions in which nothing moved are as open as rounding can say.
        spent: Degrees of freedom that are spent beside those of W.

    Returns:
        A root of the covariance at unit noise, and the noise of each column of Y.
    """
    count, k = X.shape
    _, strengths, V = torch.linalg.svd(X, full_matrices=count < k <= _FULL)
    stiffness = max(penalty * count, (float(strengths[0]) * torch.finfo(X.dtype).eps) ** 2 * count)
    open_ = (strengths**2 + stiffness) ** -0.5
    if len(V) == k:
        beyond = torch.full((k - len(open_),), stiffness**-0.5, dtype=X.dtype)
        root = (V.T * torch.cat([open_, beyond])) @ V
    else:
        # The prior's spread everywhere, less what was learned along the directions seen.
        root = stiffness**-0.5 * torch.eye(k, dtype=X.dtype) + (V.T * (open_ - stiffness**-0.5)) @ V
    free = max(count - spent - float((strengths * open_).pow(2).sum()), 1.0)
    return root, (((Y - X @ W) ** 2).sum(0) / free).sqrt()


@dataclass(frozen=True, eq=False)
class RidgeJacobian(Doubt, ConstantJacobian):
    """The same Jacobian at every posture, and how sure it is.

    Attributes:
        root: (p, p) a root of the covariance of each row, at unit noise [1/rad].
        noise: (m,) standard deviation of what the fit leaves of each axis, in the unit of the hand image.
    """

    root: Float[Tensor, "p p"]
    noise: Float[Tensor, "m"]

    kind = "ridge"

    def _covariance(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count entries entries"]:
        one = of_each_axis(self.noise, self.root @ self.root.T)
        return one.expand(len(q), *one.shape).clone()

    def draws(self, n: int, seed: int = 0) -> tuple[ConstantJacobian, ...]:
        """Jacobians drawn from the posterior.

        Args:
            n: How many.
            seed: Same seed, same draws.

        Raises:
            InvalidConfig: Not a positive number.
        """
        _checks.whole("n", n, least=1)
        generator = torch.Generator().manual_seed(seed)
        normal = torch.randn(n, self.p, self.m, generator=generator, dtype=torch.float64)
        drawn = self.matrix + ((self.root @ normal) * self.noise).transpose(1, 2)
        return tuple(ConstantJacobian(one.contiguous(), unit=self.unit) for one in drawn)


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

    def fit(self, exp: xr.Dataset, seed: int = 0) -> RidgeJacobian:
        """Learns from an experience; the seed changes nothing. See :meth:`Estimator.fit`."""
        data = pairs(exp, type(self).__name__)
        penalty = self.penalty
        if penalty is None:
            motion = (data.dq**2).sum(-1).mean()
            penalties = motion * torch.logspace(-8, 0, 33, dtype=motion.dtype)

            def errors(learn: Pairs, predict: Pairs) -> Tensor:
                return ((predict.dq @ ridge(learn.dq, learn.dr, penalties) - predict.dr) ** 2).sum((-1, -2))

            penalty = float(penalties[choose(errors, data.folds(self.folds))])
        weights = ridge(data.dq, data.dr, torch.tensor([penalty], dtype=data.dq.dtype))[0]
        root, noise = ridge_posterior(data.dq, data.dr, weights, penalty)
        return RidgeJacobian(weights.T.contiguous(), root, noise, unit=data.unit)
