"""Ratios: the exact form of a projected chain of revolute joints, and ratios of polynomials.

A point on such a chain, in the camera's axes, is multilinear in (1, sin q_i, cos q_i); its image is
``h_z (x, y) / z``. So ``r = n(q) / z(q)`` with n and z in one space of functions, all 3^p products of the joints. This
is what makes depth a part of the model: the same coefficients that explain how a displacement's size changes with
posture in sight foretell its size where the eye does not see. A ratio of polynomials has a depth as well, and assumes
no chain.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.estimators._basis import PolynomialBasis, TrigBasis
from bodyimage_kin.estimators._field import Doubt, ImageModel, in_parts
from bodyimage_kin.estimators._hold_out import choose
from bodyimage_kin.estimators._samples import Mask, Samples, samples
from bodyimage_kin.estimators.base import Estimator
from bodyimage_kin.estimators.basis_ridge import check_basis_settings, polynomial, trigonometric

__all__ = ["RationalImage", "RationalPolynomial", "RationalProcess", "RationalTrig"]

_PENALTIES = torch.logspace(0, -11, 23, dtype=torch.float64)
"""From stiff to supple: each fit starts from the one before."""
_NEAREST = 0.3
"""Least depth, relative to that at the centre, by which an equation is divided."""


@dataclass(frozen=True, eq=False)
class RationalImage(ImageModel):
    """``r(q) = n(q) / z(q)`` with ``[n, z] = phi(q) W``; the derivative is exact.

    Attributes:
        basis: The functions phi.
        weights: (functions, m + 1): of n, in the unit of the hand image, then of z, over the depth at the centre.
    """

    basis: TrigBasis | PolynomialBasis
    weights: Float[Tensor, "functions coordinates"]

    kind = "rational_image"

    def __post_init__(self) -> None:
        self.basis.check(self.weights)

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return self.weights.shape[1] - 1

    @cached_property
    def _values_and_derivatives(self) -> Float[Tensor, "functions coordinates columns"]:
        return torch.cat([self.weights[..., None], self.basis.derivative(self.weights)], -1)

    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        values = self.basis(q) @ self.weights.to(q)
        return values[..., :-1] / values[..., -1:]

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        values, slopes = self._values_and_slopes(q)
        depth = values[..., -1, None, None]
        image = values[..., :-1, None] / depth
        return (slopes[..., :-1, :] - image * slopes[..., -1:, :]) / depth

    def _values_and_slopes(
        self, q: Float[Tensor, "*batch p"]
    ) -> tuple[Float[Tensor, "*batch coordinates"], Float[Tensor, "*batch coordinates p"]]:
        """Of n, then of z."""
        table = self._values_and_derivatives.to(q)
        both = (self.basis(q) @ table.flatten(1)).reshape(*q.shape[:-1], *table.shape[1:])
        return both[..., 0], both[..., 1:]


@dataclass(frozen=True, eq=False)
class RationalProcess(Doubt, RationalImage):
    """The same with normally distributed weights of n and z; the Jacobian's covariance is to first order in them.

    Attributes:
        root: (functions, m + 1, rank) a root of the covariance of all weights together.
    """

    root: Float[Tensor, "functions coordinates rank"]

    kind = "rational_process"

    def _covariance(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count entries entries"]:
        def of(part: Tensor) -> Tensor:
            values, slopes = self._values_and_slopes(part)
            depth = values[:, -1, None, None, None]
            image = values[:, :-1, None, None] / depth
            jacobian = ((slopes[:, :-1] - image[..., 0] * slopes[:, -1:]) / depth[..., 0])[..., None]
            shape = (len(part), self.m + 1, self.root.shape[-1])
            # How values (count, m + 1, 1, rank) and slopes (count, m + 1, p, rank) go with each direction of doubt.
            of_values = (self.basis(part) @ self.root.flatten(1)).reshape(shape)[:, :, None]
            of_slopes = self.basis.slopes(part) @ self.root.flatten(1)
            of_slopes = of_slopes.reshape(len(part), self.p, *shape[1:]).transpose(1, 2)
            of_image = (of_values[:, :-1] - image * of_values[:, -1:]) / depth
            moved = of_slopes[:, :-1] - image * of_slopes[:, -1:] - of_image * slopes[:, -1:, :, None]
            open_ = ((moved - jacobian * of_values[:, -1:]) / depth).flatten(1, 2)
            return open_ @ open_.transpose(-1, -2)

        return in_parts(of, q, 4 * self.p * (self.m + 1) * self.root.shape[-1])

    def draws(self, n: int, seed: int = 0) -> tuple[RationalImage, ...]:
        """Functions drawn from the weights' distribution.

        Args:
            n: How many.
            seed: Same seed, same functions.

        Raises:
            InvalidConfig: Not a positive number.
        """
        _checks.whole("n", n, least=1)
        generator = torch.Generator().manual_seed(seed)
        normal = torch.randn(n, self.root.shape[-1], generator=generator, dtype=torch.float64)
        return tuple(RationalImage(self.basis, self.weights + self.root @ one, unit=self.unit) for one in normal)


@dataclass(frozen=True)
class _Ratio(Estimator):
    """Fits ``r = n(q) / z(q)`` by iteratively reweighted ridge regression on ``z r - n = 0``, each row divided by z."""

    def _fit(
        self,
        data: Samples,
        basis: TrigBasis | PolynomialBasis,
        penalty: float | None,
        roughness: float,
        folds: int,
        iterations: int,
    ) -> RationalProcess:
        scale = roughness ** (-basis.orders[1:] / 2)
        # Ridge is blind to rotations of its features, so the principal ones of those seen do the work of all.
        U, strengths, V = torch.linalg.svd(basis(data.q)[:, 1:] * scale, full_matrices=False)
        kept = strengths > 1e-8 * float(strengths[0])
        X, V = U[:, kept] * strengths[kept], V[kept].T
        mean, unit = data.image.mean(0), data.image.std(correction=0).clamp(min=1e-12)
        Y = (data.image - mean) / unit
        if penalty is None:

            def errors(learn: Mask, predict: Mask) -> Tensor:
                return _errors(X[learn], Y[learn], X[predict], Y[predict], iterations)

            penalties = _PENALTIES[: choose(errors, data.folds(folds)) + 1]
        else:
            stiffer = [float(one) for one in _PENALTIES if float(one) > penalty]
            penalties = torch.tensor([*stiffer, penalty], dtype=X.dtype)
        depth = torch.ones(len(X), dtype=X.dtype)
        for one in penalties:
            solution, depth = _solve(X, Y, depth, float(one), iterations)
        open_ = _posterior(X, Y, solution, depth, float(penalties[-1]))
        weights, root = (
            torch.cat([found[:1], (V @ found[1:].flatten(1)).unflatten(1, found.shape[1:]) * scaled])
            for found, scaled in ((solution, scale[:, None]), (open_, scale[:, None, None]))
        )
        n, z = weights[:, :-1], weights[:, -1:]
        of_n, of_z = root[:, :-1], root[:, -1:]
        return RationalProcess(
            basis,
            torch.cat([n * unit + z * mean, z], 1),
            torch.cat([of_n * unit + of_z * mean[:, None], of_z], 1),
            unit=data.unit,
        )


@dataclass(frozen=True)
class RationalTrig(_Ratio):
    """Fits ``r = n(q) / z(q)`` with products of sines and cosines of joints, by ridge regression on ``z r - n = 0``.

    Each row is divided by the depth found before, again and again. The equation is homogeneous: the depth at the mean
    posture is set to one. Penalised are all coefficients but n's constant. Prior knowledge: the joints are revolute,
    and the camera is a pinhole.

    Attributes:
        degree: Most joints in a product; None: all of them, the exact form (3^p functions; give 3 for long arms).
        penalty: Of squared coefficients against the mean squared error in units of the images' variance; None: the
            best of 23 on what is held out.
        roughness: How many times more a function is penalised for each further order in the joints.
        folds: Number of parts of the experience, each held out once to choose the penalty.
        iterations: Number of reweightings at each penalty.
    """

    degree: int | None = None
    penalty: float | None = None
    roughness: float = 16.0
    folds: int = 5
    iterations: int = 2

    def __post_init__(self) -> None:
        check_basis_settings(self.degree, self.penalty, self.roughness, self.folds)
        _checks.whole("iterations", self.iterations, least=1)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> RationalProcess:
        """Learns from an experience; the seed changes nothing. See :meth:`Estimator.fit`."""
        data = samples(exp, type(self).__name__)
        basis = trigonometric(data, self.degree)
        return self._fit(data, basis, self.penalty, self.roughness, self.folds, self.iterations)


@dataclass(frozen=True)
class RationalPolynomial(_Ratio):
    """The same with monomials of the joints, centred and divided by one spread: a depth, but no chain.

    Attributes:
        degree: Of both polynomials.
        penalty: As of :class:`RationalTrig`.
        roughness: How many times more a function is penalised for each further degree.
        folds: As of :class:`RationalTrig`.
        iterations: As of :class:`RationalTrig`.
    """

    degree: int = 2
    penalty: float | None = None
    roughness: float = 16.0
    folds: int = 5
    iterations: int = 2

    def __post_init__(self) -> None:
        _checks.whole("degree", self.degree, least=1)
        check_basis_settings(self.degree, self.penalty, self.roughness, self.folds)
        _checks.whole("iterations", self.iterations, least=1)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> RationalProcess:
        """Learns from an experience; the seed changes nothing. See :meth:`Estimator.fit`."""
        data = samples(exp, type(self).__name__)
        basis = polynomial(data, self.degree)
        return self._fit(data, basis, self.penalty, self.roughness, self.folds, self.iterations)


def _errors(X: Tensor, Y: Tensor, X_held: Tensor, Y_held: Tensor, iterations: int) -> Float[Tensor, "candidates"]:
    """Squared error of each penalty on what was held out."""
    depth = torch.ones(len(X), dtype=X.dtype)
    errors = []
    for penalty in _PENALTIES:
        solution, depth = _solve(X, Y, depth, float(penalty), iterations)
        values = solution[0] + X_held @ solution[1:]
        squared = ((values[:, :-1] / values[:, -1:] - Y_held) ** 2).sum(1)
        # A pole among the held-out samples is as bad as can be, but one number must not decide alone.
        errors.append(torch.where(values[:, -1] > 0.05, squared.clamp(max=4.0), 4.0).sum())
    return torch.stack(errors)


def _posterior(
    X: Float[Tensor, "count k"],
    Y: Float[Tensor, "count m"],
    solution: Float[Tensor, "terms coordinates"],
    depth: Float[Tensor, "count"],
    penalty: float,
) -> Float[Tensor, "terms coordinates rank"]:
    """A root of the covariance of the coefficients, about the last equations: ridge regression's own, see there."""
    (count, k), m = X.shape, Y.shape[1]
    matrix, _ = _normal_equations(X, Y, depth, penalty)
    factor, failed = torch.linalg.cholesky_ex(matrix)
    if int(failed):
        values, vectors = torch.linalg.eigh(matrix)
        root = vectors * values.clamp(min=float(values[-1]) * torch.finfo(X.dtype).eps) ** -0.5
    else:
        root = torch.linalg.solve_triangular(factor.T, torch.eye(len(matrix), dtype=X.dtype), upper=True)
    values = solution[0] + X @ solution[1:]
    left = ((values[:, -1:] * Y - values[:, :-1]) / depth.clamp(min=_NEAREST)[:, None]) ** 2
    # A penalised coefficient is spent as far as the data hold it, and not the penalty.
    penalised = torch.ones(len(matrix), dtype=X.dtype)
    penalised[: m * (k + 1) : k + 1] = 0.0
    spent = len(matrix) - penalty * count * float(penalised @ (root**2).sum(1))
    noise = (left.sum() / max(count * m - spent, 1.0)).sqrt()
    of_n = root[: m * (k + 1)].reshape(m, k + 1, -1).transpose(0, 1)
    of_z = torch.cat([torch.zeros(1, root.shape[1], dtype=X.dtype), root[m * (k + 1) :]])
    return noise * torch.cat([of_n, of_z[:, None]], 1)


def _solve(
    X: Float[Tensor, "count k"], Y: Float[Tensor, "count m"], depth: Float[Tensor, "count"], penalty: float, steps: int
) -> tuple[Float[Tensor, "terms coordinates"], Float[Tensor, "count"]]:
    """Coefficients of n and z, the constant first, and the depth they give the samples.

    Minimises ``mean |(z y - n) / depth|^2 + penalty (|a|^2 + |b|^2)`` with ``n = n0 + X a`` and ``z = 1 + X b``.
    """
    (count, k), m = X.shape, Y.shape[1]
    with_constant = torch.cat([torch.ones(count, 1, dtype=X.dtype), X], 1)
    solution = torch.zeros(k + 1, m + 1, dtype=X.dtype)
    for _ in range(steps):
        matrix, side = _normal_equations(X, Y, depth, penalty)
        factor, failed = torch.linalg.cholesky_ex(matrix)
        if int(failed):
            break
        unknown = torch.cholesky_solve(side[:, None], factor)[:, 0]
        n = unknown[: m * (k + 1)].reshape(m, k + 1).T
        z = torch.cat([torch.ones(1, dtype=X.dtype), unknown[m * (k + 1) :]])
        solution = torch.cat([n, z[:, None]], 1)
        depth = with_constant @ z
    return solution, depth


def _normal_equations(
    X: Float[Tensor, "count k"], Y: Float[Tensor, "count m"], depth: Float[Tensor, "count"], penalty: float
) -> tuple[Float[Tensor, "unknowns unknowns"], Float[Tensor, "unknowns"]]:
    """Of the coefficients of each axis of n, the constant first, then of z without its own."""
    (count, k), m = X.shape, Y.shape[1]
    with_constant = torch.cat([torch.ones(count, 1, dtype=X.dtype), X], 1)
    block = k + 1
    size = m * block + k
    diagonal = torch.full((size,), penalty * count, dtype=X.dtype)
    diagonal[: m * block : block] = 1e-12
    of_z = slice(m * block, size)
    weight = depth.clamp(min=_NEAREST) ** -2
    weighted = with_constant * weight[:, None]
    squared = (Y**2).sum(1) * weight
    matrix = torch.diag(diagonal)
    side = torch.zeros(size, dtype=X.dtype)
    gram = weighted.T @ with_constant
    for axis in range(m):
        of_n = slice(axis * block, (axis + 1) * block)
        mixed = -weighted.T @ (X * Y[:, axis, None])
        matrix[of_n, of_n] += gram
        matrix[of_n, of_z], matrix[of_z, of_n] = mixed, mixed.T
        side[of_n] = weighted.T @ Y[:, axis]
    matrix[of_z, of_z] += X.T @ (X * squared[:, None])
    side[of_z] = -X.T @ squared
    return matrix, side
