"""The exact form of a projected chain of revolute joints: a ratio of trigonometric polynomials.

A point on such a chain, in the camera's axes, is multilinear in (1, sin q_i, cos q_i); its image is
``h_z (x, y) / z``. So ``r = n(q) / z(q)`` with n and z in one space of functions, all 3^p products of the joints. This
is what makes depth a part of the model: the same coefficients that explain how a displacement's size changes with
posture in sight foretell its size where the eye does not see.
"""

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
from bodyimage_kin.estimators._samples import samples
from bodyimage_kin.estimators._trigonometric import TrigBasis
from bodyimage_kin.estimators.base import Estimator
from bodyimage_kin.estimators.trig_ridge import check_trigonometric

_PENALTIES = torch.logspace(0, -11, 23, dtype=torch.float64)
"""From stiff to supple: each fit starts from the one before."""
_NEAREST = 0.3
"""Least depth, relative to that at the centre, by which an equation is divided."""


@dataclass(frozen=True, eq=False)
class RationalImage(ImageModel):
    """``r(q) = n(q) / z(q)`` with ``[n, z] = phi(q) W``; the derivative is exact.

    Attributes:
        basis: The products phi.
        weights: (functions, m + 1): of n, in the unit of the hand image, then of z, over the depth at the centre.
    """

    basis: TrigBasis
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
        table = self._values_and_derivatives.to(q)
        both = (self.basis(q) @ table.flatten(1)).reshape(*q.shape[:-1], *table.shape[1:])
        values, slopes = both[..., 0], both[..., 1:]
        depth = values[..., -1, None, None]
        image = values[..., :-1, None] / depth
        return (slopes[..., :-1, :] - image * slopes[..., -1:, :]) / depth


@dataclass(frozen=True)
class RationalTrig(Estimator):
    """Fits ``r = n(q) / z(q)`` by iteratively reweighted ridge regression on ``z r - n = 0``, each row divided by z.

    The equation is homogeneous: the depth at the mean posture is set to one. Penalised are all coefficients but n's
    constant. Prior knowledge: the joints are revolute, and the camera is a pinhole.

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
        check_trigonometric(self.degree, self.penalty, self.roughness, self.folds)
        _checks.whole("iterations", self.iterations, least=1)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> RationalImage:
        """Learns from an experience; the seed changes nothing. See :meth:`Estimator.fit`."""
        data = samples(exp)
        p = data.q.shape[1]
        basis = TrigBasis(data.q.mean(0), min(self.degree or p, p))
        scale = self.roughness ** (-basis.orders[1:] / 2)
        # Ridge is blind to rotations of its features, so the principal ones of those seen do the work of all.
        U, strengths, V = torch.linalg.svd(basis(data.q)[:, 1:] * scale, full_matrices=False)
        kept = strengths > 1e-8 * float(strengths[0])
        X, V = U[:, kept] * strengths[kept], V[kept].T
        mean, unit = data.image.mean(0), data.image.std(correction=0).clamp(min=1e-12)
        Y = (data.image - mean) / unit
        if self.penalty is None:
            best = choose(lambda learn, predict: self._errors(X, Y, learn, predict), data.folds(self.folds))
            penalties = _PENALTIES[: best + 1]
        else:
            stiffer = [float(penalty) for penalty in _PENALTIES if float(penalty) > self.penalty]
            penalties = torch.tensor([*stiffer, self.penalty], dtype=X.dtype)
        depth = torch.ones(len(X), dtype=X.dtype)
        for penalty in penalties:
            solution, depth = _solve(X, Y, depth, float(penalty), self.iterations)
        weights = torch.cat([solution[:1], V @ solution[1:] * scale[:, None]])
        n, z = weights[:, :-1], weights[:, -1:]
        return RationalImage(basis, torch.cat([n * unit + z * mean, z], 1))

    def _errors(self, X: Tensor, Y: Tensor, learn: Tensor, predict: Tensor) -> Float[Tensor, "candidates"]:
        depth = torch.ones(int(learn.sum()), dtype=X.dtype)
        errors = []
        for penalty in _PENALTIES:
            solution, depth = _solve(X[learn], Y[learn], depth, float(penalty), self.iterations)
            values = solution[0] + X[predict] @ solution[1:]
            squared = ((values[:, :-1] / values[:, -1:] - Y[predict]) ** 2).sum(1)
            # A pole among the held-out samples is as bad as can be, but one number must not decide alone.
            errors.append(torch.where(values[:, -1] > 0.05, squared.clamp(max=4.0), 4.0).sum())
        return torch.stack(errors)


def _solve(
    X: Float[Tensor, "count k"], Y: Float[Tensor, "count m"], depth: Float[Tensor, "count"], penalty: float, steps: int
) -> tuple[Float[Tensor, "terms coordinates"], Float[Tensor, "count"]]:
    """Coefficients of n and z, the constant first, and the depth they give the samples.

    Minimises ``mean |(z y - n) / depth|^2 + penalty (|a|^2 + |b|^2)`` with ``n = n0 + X a`` and ``z = 1 + X b``.
    """
    (count, k), m = X.shape, Y.shape[1]
    with_constant = torch.cat([torch.ones(count, 1, dtype=X.dtype), X], 1)
    block = k + 1
    size = m * block + k
    diagonal = torch.full((size,), penalty * count, dtype=X.dtype)
    diagonal[: m * block : block] = 1e-12
    of_z = slice(m * block, size)
    solution = torch.zeros(block, m + 1, dtype=X.dtype)
    for _ in range(steps):
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
        factor, failed = torch.linalg.cholesky_ex(matrix)
        if int(failed):
            break
        unknown = torch.cholesky_solve(side[:, None], factor)[:, 0]
        n = unknown[: m * block].reshape(m, block).T
        z = torch.cat([torch.ones(1, dtype=X.dtype), unknown[of_z]])
        solution = torch.cat([n, z[:, None]], 1)
        depth = with_constant @ z
    return solution, depth
