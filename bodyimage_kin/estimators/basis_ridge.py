"""Ridge regression of the hand image on functions of the posture: trigonometric products, or monomials."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.estimators._basis import PolynomialBasis, TrigBasis
from bodyimage_kin.estimators._field import Doubt, ImageModel, in_parts, of_each_axis
from bodyimage_kin.estimators._hold_out import choose
from bodyimage_kin.estimators._samples import Mask, Samples, samples
from bodyimage_kin.estimators.base import Estimator
from bodyimage_kin.estimators.ridge import ridge, ridge_posterior

__all__ = [
    "BasisImage",
    "BasisProcess",
    "Polynomial",
    "TrigRidge",
    "check_basis_settings",
    "fit_basis",
    "polynomial",
    "trigonometric",
]


@dataclass(frozen=True, eq=False)
class BasisImage(ImageModel):
    """``r(q) = phi(q) W`` with the functions phi of a basis; the derivative is exact.

    Attributes:
        basis: The functions.
        weights: (functions, m), in the unit of the hand image.
    """

    basis: TrigBasis | PolynomialBasis
    weights: Float[Tensor, "functions m"]

    kind = "basis_image"

    def __post_init__(self) -> None:
        self.basis.check(self.weights)

    @cached_property
    def _derivative(self) -> Float[Tensor, "functions mp"]:
        return self.basis.derivative(self.weights).flatten(1)

    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return self.basis(q) @ self.weights.to(q)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return (self.basis(q) @ self._derivative.to(q)).reshape(*q.shape[:-1], self.m, self.p)


@dataclass(frozen=True, eq=False)
class BasisProcess(Doubt, BasisImage):
    """The same with normally distributed weights: a Gaussian process of finitely many functions.

    Attributes:
        root: (functions, functions) a root of the covariance of an axis's weights, at unit noise.
        noise: (m,) of each axis.
    """

    root: Float[Tensor, "functions functions"]
    noise: Float[Tensor, "m"]

    kind = "basis_process"

    def _covariance(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count entries entries"]:
        def of(part: Tensor) -> Tensor:
            open_ = self.basis.slopes(part) @ self.root
            return of_each_axis(self.noise, open_ @ open_.transpose(-1, -2))

        return in_parts(of, q, 2 * self.p * len(self.root))

    def draws(self, n: int, seed: int = 0) -> tuple[BasisImage, ...]:
        """Functions drawn from the posterior.

        Args:
            n: How many.
            seed: Same seed, same functions.

        Raises:
            InvalidConfig: Not a positive number.
        """
        _checks.whole("n", n, least=1)
        generator = torch.Generator().manual_seed(seed)
        normal = torch.randn(n, len(self.weights), self.m, generator=generator, dtype=torch.float64)
        drawn = self.weights + (self.root @ normal) * self.noise
        return tuple(BasisImage(self.basis, one.contiguous(), unit=self.unit) for one in drawn)


def check_basis_settings(degree: int | None, penalty: float | None, roughness: float, folds: int) -> None:
    """Raises InvalidConfig unless these are settings of an estimator with a basis."""
    if degree is not None:
        _checks.whole("degree", degree, least=1)
    if penalty is not None:
        _checks.number("penalty", penalty, above=0.0)
    _checks.number("roughness", roughness, least=1.0)
    _checks.whole("folds", folds, least=2)


def trigonometric(data: Samples, degree: int | None) -> TrigBasis:
    """Products about the mean of what was felt, of at most so many joints."""
    p = data.q.shape[1]
    return TrigBasis(data.q.mean(0), min(degree or p, p))


def polynomial(data: Samples, degree: int) -> PolynomialBasis:
    """Monomials about the mean of what was felt, in one unit: the spread of all joints together.

    Dividing each joint by its own would blow up the noise of those that hardly move.
    """
    centre = data.q.mean(0)
    spread = ((data.q - centre) ** 2).mean().sqrt()
    return PolynomialBasis(centre, degree, torch.full_like(centre, float(spread)))


def fit_basis(
    data: Samples, basis: TrigBasis | PolynomialBasis, penalty: float | None, roughness: float, folds: int
) -> BasisProcess:
    """Ridge regression on the functions of a basis, each of them scaled down by its order.

    Args:
        data: What was seen.
        basis: The functions.
        penalty: Of squared weights against the mean squared error; None: the best of 33 on what is held out.
        roughness: How many times more a function is penalised for each further order.
        folds: Number of parts, each held out once to choose the penalty.
    """
    scale = roughness ** (-basis.orders / 2)
    features = (basis(data.q) * scale)[:, 1:]
    # The constant is not penalised: both sides are centred, and it takes up what is left.
    mean, mean_image = features.mean(0), data.image.mean(0)
    X, Y = features - mean, data.image - mean_image
    if penalty is None:
        penalties = torch.logspace(-11, 0, 33, dtype=X.dtype)

        def errors(learn: Mask, predict: Mask) -> Tensor:
            return ((X[predict] @ ridge(X[learn], Y[learn], penalties) - Y[predict]) ** 2).sum((-1, -2))

        penalty = float(penalties[choose(errors, data.folds(folds))])
    slopes = ridge(X, Y, torch.tensor([penalty], dtype=X.dtype))[0]
    constant = mean_image - mean @ slopes
    open_, noise = ridge_posterior(X, Y, slopes, penalty, spent=1)
    # The mean image is known to its noise over the root of their number, independently of the slopes.
    root = torch.zeros(len(scale), len(scale), dtype=X.dtype)
    root[0, 0], root[0, 1:], root[1:, 1:] = len(X) ** -0.5, -mean @ open_, open_
    weights = torch.cat([constant[None], slopes]) * scale[:, None]
    return BasisProcess(basis, weights, root * scale[:, None], noise, unit=data.unit)


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
        check_basis_settings(self.degree, self.penalty, self.roughness, self.folds)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> BasisProcess:
        """Learns from an experience; the seed changes nothing. See :meth:`Estimator.fit`."""
        data = samples(exp, type(self).__name__)
        return fit_basis(data, trigonometric(data, self.degree), self.penalty, self.roughness, self.folds)


@dataclass(frozen=True)
class Polynomial(Estimator):
    """Ridge regression of r(q) on all monomials of the joints up to a degree, differentiated exactly.

    Assumes nothing of the body; joints are centred and divided by one spread.

    Attributes:
        degree: Of the polynomial.
        penalty: Of squared weights against the mean squared error; None: the best of 33 on what is held out.
        roughness: How many times more a function is penalised for each further degree.
        folds: Number of parts of the experience, each held out once to choose the penalty.
    """

    degree: int = 3
    penalty: float | None = None
    roughness: float = 4.0
    folds: int = 5

    def __post_init__(self) -> None:
        _checks.whole("degree", self.degree, least=1)
        check_basis_settings(self.degree, self.penalty, self.roughness, self.folds)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> BasisProcess:
        """Learns from an experience; the seed changes nothing. See :meth:`Estimator.fit`."""
        data = samples(exp, type(self).__name__)
        return fit_basis(data, polynomial(data, self.degree), self.penalty, self.roughness, self.folds)
