"""Ridge regression of the hand image on products of sines and cosines of the joints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.estimators._field import ImageModel
from bodyimage_kin.estimators._hold_out import choose
from bodyimage_kin.estimators._samples import Mask, samples
from bodyimage_kin.estimators._trigonometric import TrigBasis
from bodyimage_kin.estimators.base import Estimator
from bodyimage_kin.estimators.ridge import ridge


@dataclass(frozen=True, eq=False)
class TrigImage(ImageModel):
    """``r(q) = phi(q) W`` with trigonometric products phi; the derivative is exact.

    Attributes:
        basis: The products.
        weights: (functions, m), in the unit of the hand image.
    """

    basis: TrigBasis
    weights: Float[Tensor, "functions m"]

    kind = "trigonometric_image"

    def __post_init__(self) -> None:
        self.basis.check(self.weights)

    @cached_property
    def _derivative(self) -> Float[Tensor, "functions mp"]:
        return self.basis.derivative(self.weights).flatten(1)

    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return self.basis(q) @ self.weights.to(q)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return (self.basis(q) @ self._derivative.to(q)).reshape(*q.shape[:-1], self.m, self.p)


def check_trigonometric(degree: int | None, penalty: float | None, roughness: float, folds: int) -> None:
    """Raises InvalidConfig unless these are settings of a trigonometric estimator."""
    if degree is not None:
        _checks.whole("degree", degree, least=1)
    if penalty is not None:
        _checks.number("penalty", penalty, above=0.0)
    _checks.number("roughness", roughness, least=1.0)
    _checks.whole("folds", folds, least=2)


@dataclass(frozen=True)
class TrigRidge(Estimator):
    """Ridge regression of r(q) on products of sines and cosines of joints, differentiated exactly.

    Attributes:
        degree: Most joints in a product; None: all of them.
        penalty: Of squared weights against the mean squared error; None: the best of 33 on what is held out.
        roughness: How many times more a function is penalised for each further order in the joints.
        folds: Number of parts of the experience, each held out once to choose the penalty.
    """

    degree: int | None = 3
    penalty: float | None = None
    roughness: float = 16.0
    folds: int = 5

    def __post_init__(self) -> None:
        check_trigonometric(self.degree, self.penalty, self.roughness, self.folds)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> TrigImage:
        """Learns from an experience; the seed changes nothing. See :meth:`Estimator.fit`."""
        data = samples(exp)
        p = data.q.shape[1]
        basis = TrigBasis(data.q.mean(0), min(self.degree or p, p))
        scale = self.roughness ** (-basis.orders / 2)
        features = (basis(data.q) * scale)[:, 1:]
        # The constant is not penalised: both sides are centred, and it takes up what is left.
        mean, mean_image = features.mean(0), data.image.mean(0)
        X, Y = features - mean, data.image - mean_image
        penalty = self.penalty
        if penalty is None:
            penalties = torch.logspace(-11, 0, 33, dtype=X.dtype)

            def errors(learn: Mask, predict: Mask) -> Tensor:
                return ((X[predict] @ ridge(X[learn], Y[learn], penalties) - Y[predict]) ** 2).sum((-1, -2))

            penalty = float(penalties[choose(errors, data.folds(self.folds))])
        slopes = ridge(X, Y, torch.tensor([penalty], dtype=X.dtype))[0]
        constant = mean_image - mean @ slopes
        return TrigImage(basis, torch.cat([constant[None], slopes]) * scale[:, None], unit=data.unit)
