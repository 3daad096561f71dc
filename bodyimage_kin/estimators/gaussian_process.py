"""Gaussian processes over the hand image r(q), and the posterior of their derivative.

A derivative of a Gaussian process is one as well, so Jacobians come with an uncertainty (Rasmussen and Williams 2006,
section 9.4). Draws are of whole functions: the same draw at two postures, or in two calls, is one function. The
settings of the kernel maximise the evidence (their equation 5.8), the image's axes sharing them.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.optimize
import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin._arrays import ArrayLike, as_postures
from bodyimage_kin.errors import InvalidArray, InvalidRecording
from bodyimage_kin.estimators._field import ImageModel
from bodyimage_kin.estimators._samples import samples
from bodyimage_kin.estimators._trigonometric import TrigBasis
from bodyimage_kin.estimators.base import Estimator

_WAVES = 2048
"""Random waves that a draw from a radial prior is made of."""
_LEAST_NOISE = 1e-4
"""Standard deviation of the images' noise, over that of the images: what rounding needs."""


class ImageProcess(ImageModel):
    """A Gaussian process over the hand image: its mean is the image that is predicted."""

    def jacobian_draws(self, q: ArrayLike, draws: int, seed: int = 0) -> Float[Tensor, "draws *batch m p"]:
        """Jacobians of functions drawn from the posterior [m/rad].

        Args:
            q: Postures ``(*batch, p)`` [rad].
            draws: How many functions.
            seed: Same seed, same functions, whatever the postures.

        Raises:
            InvalidConfig: Not a positive number of draws.
            InvalidPosture: A last axis that is not of p joints.
        """
        _checks.whole("draws", draws, least=1)
        q = as_postures(q, self.p)
        drawn = self._draws(q.reshape(-1, self.p).to(torch.float64), draws, torch.Generator().manual_seed(seed))
        return drawn.to(q).reshape(draws, *q.shape[:-1], self.m, self.p)

    def jacobian_std(self, q: ArrayLike) -> Float[Tensor, "*batch m p"]:
        """Standard deviation of each entry of the Jacobian [m/rad].

        Args:
            q: Postures ``(*batch, p)`` [rad].

        Raises:
            InvalidPosture: A last axis that is not of p joints.
        """
        q = as_postures(q, self.p)
        spread = self._std(q.reshape(-1, self.p).to(torch.float64)).to(q)
        return spread.reshape(*q.shape[:-1], 1, self.p).repeat(*[1] * (q.ndim - 1), self.m, 1)

    @abc.abstractmethod
    def _draws(
        self, q: Float[Tensor, "count p"], draws: int, generator: torch.Generator
    ) -> Float[Tensor, "draws count m p"]:
        """Jacobians of drawn functions."""

    @abc.abstractmethod
    def _std(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count p"]:
        """Standard deviation of the Jacobian's entries, the same for every axis of the image."""


@dataclass(frozen=True, eq=False)
class TrigProcess(ImageProcess):
    """A process with a trigonometric kernel: finitely many functions, so its draws are exact.

    Attributes:
        basis: The functions.
        weights: (functions, m) posterior mean of their weights, in the unit of the hand image.
        root: (functions, functions) a root of the weights' posterior covariance, the same for every axis and in its
            unit.
    """

    basis: TrigBasis
    weights: Float[Tensor, "functions m"]
    root: Float[Tensor, "functions functions"]

    kind = "trigonometric_process"

    def __post_init__(self) -> None:
        self.basis.check(self.weights)
        self.basis.check(self.root)

    @cached_property
    def _derivative(self) -> Float[Tensor, "functions columns"]:
        return self.basis.derivative(self.weights).flatten(1)

    @cached_property
    def _root_derivative(self) -> Float[Tensor, "functions functions p"]:
        return self.basis.derivative(self.root)

    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return self.basis(q) @ self.weights.to(q)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return (self.basis(q) @ self._derivative.to(q)).reshape(*q.shape[:-1], self.m, self.p)

    def _draws(
        self, q: Float[Tensor, "count p"], draws: int, generator: torch.Generator
    ) -> Float[Tensor, "draws count m p"]:
        normal = torch.randn(draws, len(self.weights), self.m, generator=generator, dtype=torch.float64)
        weights = (self.weights + self.root @ normal).transpose(0, 1).flatten(1)
        drawn = self.basis(q) @ self.basis.derivative(weights).flatten(1)
        return drawn.reshape(len(q), draws, self.m, self.p).transpose(0, 1)

    def _std(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count p"]:
        features = self.basis(q)
        each = [torch.linalg.vector_norm(features @ self._root_derivative[..., k], dim=-1) for k in range(self.p)]
        return torch.stack(each, -1)


@dataclass(frozen=True, eq=False)
class RadialProcess(ImageProcess):
    """A process with the kernel ``linear^2 (q - c)'(q' - c) + height^2 exp(-|q - q'|^2 / (2 length^2)) + constant``.

    Draws follow Matheron's rule (Wilson et al. 2020): a draw from the prior, corrected where data are. The prior's
    radial part is drawn as random waves (Rahimi and Recht 2007): the spread of draws is right to a few per cent.

    Attributes:
        q: (count, p) postures of the data, less their mean [rad].
        centre: (p,) their mean [rad].
        image: (count, m) images of the data, less their mean.
        mean: (m,) their mean.
        settings: (4,) height, length [rad], linear [1/rad] and noise; all but the length in the unit of the image.
    """

    q: Float[Tensor, "count p"]
    centre: Float[Tensor, "p"]
    image: Float[Tensor, "count m"]
    mean: Float[Tensor, "m"]
    settings: Float[Tensor, "4"]

    kind = "radial_process"

    def __post_init__(self) -> None:
        if not bool((self.settings > 0).all()):
            raise InvalidArray(f"settings of a radial process are {self.settings.tolist()}; give positive ones")

    @cached_property
    def _factor(self) -> Float[Tensor, "count count"]:
        covariance = _radial(self.q, self.q, self.settings)
        noise = self.settings[3] ** 2 * torch.eye(len(self.q), dtype=torch.float64)
        factor, failed = torch.linalg.cholesky_ex(covariance + noise)
        if int(failed):
            raise InvalidArray(
                "the noise of a radial process is too small for its postures: its covariance is singular"
            )
        return factor

    @cached_property
    def _dual(self) -> Float[Tensor, "count m"]:
        return torch.cholesky_solve(self.image, self._factor)

    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        image = self.mean + _radial(self._centred(q), self.q, self.settings) @ self._dual
        return image.to(q).reshape(*q.shape[:-1], self.m)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return self._slope(self._centred(q), self._dual).to(q).reshape(*q.shape[:-1], self.m, self.p)

    def _centred(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "rows p"]:
        """In float64, whatever comes: large terms of the dual cancel."""
        return (q.to(torch.float64) - self.centre).reshape(-1, self.p)

    def _slope(self, q: Float[Tensor, "rows p"], dual: Float[Tensor, "count m"]) -> Float[Tensor, "rows m p"]:
        """Derivative of ``k(q, data) @ dual``, postures centred; matrix products alone."""
        height, length, linear, _ = self.settings
        bump = _bumps(q, self.q, height, length)
        pulled = (bump @ (dual[:, :, None] * self.q[:, None, :]).flatten(1)).reshape(len(q), dual.shape[1], self.p)
        pulled = pulled - (bump @ dual)[..., None] * q[:, None, :]
        return pulled / length**2 + linear**2 * (dual.T @ self.q)

    def _draws(
        self, q: Float[Tensor, "count p"], draws: int, generator: torch.Generator
    ) -> Float[Tensor, "draws count m p"]:
        height, length, linear, noise = self.settings
        columns = draws * self.m

        def normal(*shape: int) -> Tensor:
            return torch.randn(*shape, generator=generator, dtype=torch.float64)

        frequencies = normal(self.p, _WAVES) / length
        phases = 2.0 * math.pi * torch.rand(_WAVES, generator=generator, dtype=torch.float64)
        heights = height * math.sqrt(2.0 / _WAVES) * normal(_WAVES, columns)
        slopes = linear * normal(self.p, columns)
        prior = torch.cos(self.q @ frequencies + phases) @ heights + self.q @ slopes
        prior = prior + _constant(self.settings) * normal(1, columns) + noise * normal(len(self.q), columns)
        dual = torch.cholesky_solve(self.image.repeat(1, draws) - prior, self._factor)
        centred = q - self.centre
        waves = (heights.T[..., None] * frequencies.T).transpose(0, 1).flatten(1)
        of_prior = -(torch.sin(centred @ frequencies + phases) @ waves).reshape(len(q), columns, self.p) + slopes.T
        drawn = of_prior + self._slope(centred, dual)
        return drawn.reshape(len(q), draws, self.m, self.p).transpose(0, 1)

    def _std(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count p"]:
        height, length, linear, _ = self.settings
        centred = q - self.centre
        bump = _bumps(centred, self.q, height, length)
        each = []
        for joint in range(self.p):
            away = self.q[:, joint] - centred[:, joint, None]
            cross = bump * away / length**2 + linear**2 * self.q[:, joint]
            known = torch.linalg.solve_triangular(self._factor, cross.T, upper=False)
            each.append((height**2 / length**2 + linear**2 - (known**2).sum(0)).clamp(min=0.0).sqrt())
        return torch.stack(each, -1)


@dataclass(frozen=True)
class GaussianProcess(Estimator):
    """A Gaussian process over r(q), differentiated; the kernel's settings maximise the evidence.

    Attributes:
        kernel: ``"trigonometric"``: products of sines and cosines of the joints, of falling size with their order;
            ``"radial"``: a bump on top of a linear map.
        degree: Most joints in a product of the trigonometric kernel; None: all of them.
        most: Most samples that are used, spread evenly over the experience (the cost grows with their cube).
    """

    kernel: Literal["trigonometric", "radial"] | str = "trigonometric"
    degree: int | None = 3
    most: int = 1000

    def __post_init__(self) -> None:
        _checks.choice("kernel", self.kernel, ("trigonometric", "radial"))
        if self.degree is not None:
            _checks.whole("degree", self.degree, least=1)
        _checks.whole("most", self.most, least=2)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> ImageProcess:
        """Learns from an experience; the seed changes nothing. See :meth:`Estimator.fit`."""
        data = samples(exp)
        kept = torch.linspace(0, len(data.q) - 1, min(self.most, len(data.q))).round().long()
        q, image = data.q[kept], data.image[kept]
        centre, mean = q.mean(0), image.mean(0)
        q, image = q - centre, image - mean
        unit = float(image.pow(2).mean().sqrt())
        if not unit > 0:
            raise InvalidRecording("the hand image never moves in the experience, so it has no scale; record a motion")
        spread = float(q.pow(2).sum(1).mean().sqrt())
        if self.kernel == "radial":
            start = [1.0, spread, 1.0 / spread, 0.03]
            settings = _most_evident(lambda s: _radial(q, q, s), image / unit, start)
            settings = settings * torch.tensor([unit, 1.0, unit, unit], dtype=torch.float64)
            return RadialProcess(q, centre, image, mean, settings, unit=data.unit)
        p = q.shape[1]
        basis = TrigBasis(centre, min(self.degree or p, p))
        features = basis(q + centre)[:, 1:]
        orders = basis.orders[1:]

        def covariance(s: Tensor) -> Tensor:
            scaled = features * s[0] * s[1] ** (-orders / 2)
            return scaled @ scaled.T + _constant(s) ** 2

        settings = _most_evident(covariance, image / unit, [1.0 / spread, 4.0, 0.03])
        deviations = settings[0] * settings[1] ** (-basis.orders / 2)
        deviations[0] = _constant(settings)
        scaled = torch.cat([torch.ones(len(q), 1, dtype=q.dtype), features], 1) * deviations / settings[-1]
        precision = scaled.T @ scaled + torch.eye(len(orders) + 1, dtype=q.dtype)
        factor = torch.linalg.cholesky(precision)
        weights = torch.cholesky_solve(scaled.T @ (image / settings[-1]), factor) * deviations[:, None]
        weights[0] += mean
        inverse = torch.linalg.solve_triangular(factor.T, torch.eye(len(factor), dtype=q.dtype), upper=True)
        return TrigProcess(basis, weights, unit * deviations[:, None] * inverse, unit=data.unit)


def _constant(settings: Float[Tensor, "settings"]) -> Tensor:
    """Standard deviation of the process's constant: the data are centred, so it is of the size of what they leave."""
    return settings[0]


def _bumps(
    q: Float[Tensor, "rows p"], seen: Float[Tensor, "count p"], height: Tensor, length: Tensor
) -> Float[Tensor, "rows count"]:
    squared = (q**2).sum(1)[:, None] + (seen**2).sum(1) - 2.0 * q @ seen.T
    return height**2 * torch.exp(-0.5 * squared.clamp(min=0.0) / length**2)


def _radial(
    q: Float[Tensor, "rows p"], seen: Float[Tensor, "count p"], settings: Float[Tensor, "4"]
) -> Float[Tensor, "rows count"]:
    """The radial kernel without its noise, postures centred."""
    height, length, linear, _ = settings
    return _bumps(q, seen, height, length) + linear**2 * q @ seen.T + _constant(settings) ** 2


def _most_evident(
    covariance: Callable[[Tensor], Tensor], y: Float[Tensor, "count m"], start: list[float]
) -> Float[Tensor, "settings"]:
    """The positive settings that maximise the evidence of y; the last one is the noise's standard deviation."""
    identity = torch.eye(len(y), dtype=y.dtype)

    def minus_log_evidence(logs: Float[np.ndarray, "settings"]) -> tuple[float, Float[np.ndarray, "settings"]]:
        parameters = torch.from_numpy(logs).requires_grad_()
        settings = parameters.exp()
        factor, failed = torch.linalg.cholesky_ex(covariance(settings) + (settings[-1] ** 2 + 1e-10) * identity)
        if int(failed):
            return 1e25, np.zeros_like(logs)
        explained = torch.cholesky_solve(y, factor)
        value = 0.5 * (y * explained).sum() + y.shape[1] * factor.diagonal().log().sum()
        (gradient,) = torch.autograd.grad(value / len(y), parameters)
        return float(value.detach()) / len(y), gradient.numpy()

    bounds = [(math.log(value) - 8.0, math.log(value) + 8.0) for value in start]
    bounds[-1] = (math.log(_LEAST_NOISE), 0.0)
    found = scipy.optimize.minimize(
        minus_log_evidence, np.log(start), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 60}
    )
    return torch.from_numpy(np.exp(found.x))
