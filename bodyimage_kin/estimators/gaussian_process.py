"""Gaussian processes over the hand image r(q), and the posterior of their derivative.

A derivative of a Gaussian process is one as well, so Jacobians come with an uncertainty (Rasmussen and Williams 2006,
section 9.4). Draws are of whole functions: the same draw at two postures, or in two calls, is one function. The
settings of the kernel maximise the evidence (their equation 5.8), the image's axes sharing them.
"""

from __future__ import annotations

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
from bodyimage_kin.errors import InvalidArray, InvalidRecording
from bodyimage_kin.estimators._basis import TrigBasis
from bodyimage_kin.estimators._field import Doubt, ImageModel, in_parts, of_each_axis
from bodyimage_kin.estimators._samples import samples
from bodyimage_kin.estimators.base import Estimator
from bodyimage_kin.estimators.basis_ridge import BasisProcess

__all__ = ["GaussianProcess", "RadialDraw", "RadialImage", "RadialProcess"]

_WAVES = 2048
"""Random waves that a draw from a radial prior is made of."""
_LEAST_NOISE = 1e-4
"""Standard deviation of the images' noise, over that of the images: what rounding needs."""


@dataclass(frozen=True, eq=False)
class RadialImage(ImageModel):
    """A weighted sum of the radial kernel about postures of the data.

    Attributes:
        q: (count, p) postures of the data, less their mean [rad].
        centre: (p,) their mean [rad].
        mean: (m,) what the sum is added to, in the unit of the hand image.
        dual: (count, m) weights of the kernel, in the unit of the hand image, inverse.
        settings: (4,) as of :class:`RadialProcess`.
    """

    q: Float[Tensor, "count p"]
    centre: Float[Tensor, "p"]
    mean: Float[Tensor, "m"]
    dual: Float[Tensor, "count m"]
    settings: Float[Tensor, "4"]

    kind = "radial_image"

    def __post_init__(self) -> None:
        _check_settings(self.settings)

    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        image = self.mean + _radial(self.centred(q), self.q, self.settings) @ self.dual
        return image.to(q).reshape(*q.shape[:-1], self.m)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        height, length, linear, _ = self.settings
        centred = self.centred(q)
        bump = _bumps(centred, self.q, height, length)
        # Matrix products alone: the sum over the data of bump dual (q_i - q)'.
        pulled = (bump @ (self.dual[:, :, None] * self.q[:, None, :]).flatten(1)).reshape(len(centred), self.m, self.p)
        pulled = pulled - (bump @ self.dual)[..., None] * centred[:, None, :]
        slope = pulled / length**2 + linear**2 * (self.dual.T @ self.q)
        return slope.to(q).reshape(*q.shape[:-1], self.m, self.p)

    def centred(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "rows p"]:
        """In float64, whatever comes: large terms of the dual cancel."""
        return (q.to(torch.float64) - self.centre).reshape(-1, self.p)


@dataclass(frozen=True, eq=False)
class RadialDraw(ImageModel):
    """A function drawn from a radial process: waves and a linear map drawn from the prior, corrected by the data.

    Attributes:
        known: The correction.
        frequencies: (p, waves) [1/rad].
        phases: (waves,).
        heights: (waves, m), in the unit of the hand image.
        slopes: (p, m), in the unit of the hand image over rad.
    """

    known: RadialImage
    frequencies: Float[Tensor, "p waves"]
    phases: Float[Tensor, "waves"]
    heights: Float[Tensor, "waves m"]
    slopes: Float[Tensor, "p m"]

    kind = "radial_draw"

    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        centred = self.known.centred(q)
        drawn = torch.cos(centred @ self.frequencies + self.phases) @ self.heights + centred @ self.slopes
        return self.known._image(q) + drawn.to(q).reshape(*q.shape[:-1], self.m)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        waves = (self.heights.T[..., None] * self.frequencies.T).transpose(0, 1).flatten(1)
        rising = torch.sin(self.known.centred(q) @ self.frequencies + self.phases) @ waves
        drawn = self.slopes.T - rising.reshape(-1, self.m, self.p)
        return self.known._jacobian(q) + drawn.to(q).reshape(*q.shape[:-1], self.m, self.p)


@dataclass(frozen=True, eq=False)
class RadialProcess(Doubt, ImageModel):
    """A process with the kernel ``linear^2 (q - c)'(q' - c) + height^2 exp(-|q - q'|^2 / (2 length^2)) + constant``.

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
        _check_settings(self.settings)

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

    @cached_property
    def _mean(self) -> RadialImage:
        return RadialImage(self.q, self.centre, self.mean, self._dual, self.settings, unit=self.unit)

    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return self._mean._image(q)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return self._mean._jacobian(q)

    def _covariance(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count entries entries"]:
        def of(part: Tensor) -> Tensor:
            return of_each_axis(torch.ones(self.m, dtype=part.dtype), self._of_one_axis(part))

        return in_parts(of, q, 2 * self.p * len(self.q))

    def _of_one_axis(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count p p"]:
        """Covariance of a row of the Jacobian: the prior's, less what the data tell."""
        height, length, linear, _ = self.settings
        centred = q - self.centre
        bump = _bumps(centred, self.q, height, length)
        away = self.q - centred[:, None, :]
        cross = bump[..., None] * away / length**2 + linear**2 * self.q
        shape = (len(q), self.p, len(self.q))
        known = torch.linalg.solve_triangular(self._factor, cross.permute(1, 0, 2).flatten(1), upper=False)
        known = known.reshape(len(self.q), len(q), self.p).permute(1, 2, 0).reshape(shape)
        prior = (height**2 / length**2 + linear**2) * torch.eye(self.p, dtype=q.dtype)
        return prior - known @ known.transpose(-1, -2)

    def draws(self, n: int, seed: int = 0) -> tuple[RadialDraw, ...]:
        """Functions drawn from the posterior.

        Matheron's rule (Wilson et al. 2020): a draw from the prior, corrected where data are. The prior's radial part
        is drawn as random waves (Rahimi and Recht 2007): the spread of draws is right to a few per cent.

        Args:
            n: How many.
            seed: Same seed, same functions.

        Raises:
            InvalidConfig: Not a positive number.
        """
        _checks.whole("n", n, least=1)
        generator = torch.Generator().manual_seed(seed)
        height, length, linear, noise = self.settings
        columns = n * self.m

        def normal(*shape: int) -> Tensor:
            return torch.randn(*shape, generator=generator, dtype=torch.float64)

        frequencies = normal(self.p, _WAVES) / length
        phases = 2.0 * math.pi * torch.rand(_WAVES, generator=generator, dtype=torch.float64)
        heights = height * math.sqrt(2.0 / _WAVES) * normal(_WAVES, columns)
        slopes = linear * normal(self.p, columns)
        constants = _constant(self.settings) * normal(1, columns)
        prior = torch.cos(self.q @ frequencies + phases) @ heights + self.q @ slopes
        prior = prior + constants + noise * normal(len(self.q), columns)
        dual = torch.cholesky_solve(self.image.repeat(1, n) - prior, self._factor)
        drawn = []
        for one in range(n):
            of = slice(one * self.m, (one + 1) * self.m)
            known = RadialImage(
                self.q, self.centre, self.mean + constants[0, of], dual[:, of].contiguous(), self.settings
            )
            waves = (frequencies, phases, heights[:, of].contiguous(), slopes[:, of].contiguous())
            drawn.append(RadialDraw(known, *waves, unit=self.unit))
        return tuple(drawn)


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

    def fit(self, exp: xr.Dataset, seed: int = 0) -> BasisProcess | RadialProcess:
        """Learns from an experience; the seed changes nothing. See :meth:`Estimator.fit`."""
        data = samples(exp, type(self).__name__)
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
        alike = torch.ones(image.shape[1], dtype=q.dtype)
        return BasisProcess(basis, weights, unit * deviations[:, None] * inverse, alike, unit=data.unit)


def _check_settings(settings: Float[Tensor, "4"]) -> None:
    if not bool((settings > 0).all()):
        raise InvalidArray(f"settings of a radial process are {settings.tolist()}; give positive ones")


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
