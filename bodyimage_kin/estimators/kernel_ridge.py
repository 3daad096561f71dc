"""Kernel ridge regression of the hand image with products of a kernel over joints, and the doubt it leaves.

A product over joints suits a chain: each joint enters every coordinate of a point on it by a sine and a cosine of its
own. All three kernels are functions of the differences d of joints, 1 at none, and have waves as their spectrum:

    trigonometric   prod_i (w^2 + cos d_i) / (w^2 + 1)      sums of all products of 1, sin and cos over joints
    periodic        prod_i exp((cos d_i - 1) / w^2)         smooth, and the same after a full turn
    gaussian        prod_i exp(-d_i^2 / (2 w^2))            smooth

The wider w, the smoother the function. Ridge regression is the mean of a Gaussian process with that kernel, whose doubt
is given (Rasmussen and Williams 2006, chapter 2 and section 9.4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.special
import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.errors import InvalidArray, InvalidRecording
from bodyimage_kin.estimators._field import Doubt, ImageModel, in_parts, of_each_axis
from bodyimage_kin.estimators._hold_out import choose
from bodyimage_kin.estimators._samples import Mask, Samples, samples
from bodyimage_kin.estimators.base import Estimator

__all__ = ["KernelDraw", "KernelImage", "KernelProcess", "KernelRidge"]

KERNELS = ("trigonometric", "periodic", "gaussian")
_WIDTHS = (1.05, 1.5, 2.5, 4.0, 7.0)
"""Of the trigonometric kernel that are tried; of the others, times the spread of the postures' differences over two."""
_PENALTIES = 10.0 ** np.linspace(-10, 0, 21)
_WAVES = 1024
"""Random waves that a draw from the prior is made of, others for each draw: their mean spread is the kernel's."""
_HIGHEST = 64
"""Of a joint's waves under the periodic kernel; narrower kernels than a twentieth of a radian are cut short."""


@dataclass(frozen=True, eq=False)
class KernelImage(ImageModel):
    """A weighted sum of the kernel about postures of the data.

    Attributes:
        q: (count, p) postures of the data [rad].
        mean: (m,) what the sum is added to, in the unit of the hand image.
        dual: (count, m) weights, in the unit of the hand image.
        kernel: ``"trigonometric"``, ``"periodic"`` or ``"gaussian"``.
        width: w of the kernel: a number of the trigonometric one, [rad] of the others.
    """

    q: Float[Tensor, "count p"]
    mean: Float[Tensor, "m"]
    dual: Float[Tensor, "count m"]
    kernel: str
    width: float

    kind = "kernel_image"

    def __post_init__(self) -> None:
        _check_kernel(self.kernel, self.width)

    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        flat = q.reshape(-1, self.p).to(torch.float64)
        image = self.mean + self._values(flat) @ self.dual
        return image.to(q).reshape(*q.shape[:-1], self.m)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        flat = q.reshape(-1, self.p).to(torch.float64)

        def of(part: Tensor) -> Tensor:
            values = self._values(part)
            return torch.stack([(values * self._slope(part, joint)) @ self.dual for joint in range(self.p)], -1)

        return in_parts(of, flat, 4 * len(self.q)).to(q).reshape(*q.shape[:-1], self.m, self.p)

    def _values(self, q: Float[Tensor, "rows p"]) -> Float[Tensor, "rows count"]:
        return _product(self.kernel, self.width, q, self.q)

    def _slope(self, q: Float[Tensor, "rows p"], joint: int) -> Float[Tensor, "rows count"]:
        """Derivative of the kernel's logarithm in a joint of q."""
        d = q[:, None, joint] - self.q[:, joint]
        if self.kernel == "gaussian":
            return -d / self.width**2
        if self.kernel == "periodic":
            return -torch.sin(d) / self.width**2
        return -torch.sin(d) / (self.width**2 + torch.cos(d))


@dataclass(frozen=True, eq=False)
class KernelDraw(ImageModel):
    """A function drawn from a process with such a kernel: waves drawn from the prior, corrected by the data.

    Attributes:
        known: The correction.
        frequencies: (p, waves) [1/rad].
        phases: (waves,).
        heights: (waves, m), in the unit of the hand image.
    """

    known: KernelImage
    frequencies: Float[Tensor, "p waves"]
    phases: Float[Tensor, "waves"]
    heights: Float[Tensor, "waves m"]

    kind = "kernel_draw"

    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        flat = q.reshape(-1, self.p).to(torch.float64)
        drawn = torch.cos(flat @ self.frequencies + self.phases) @ self.heights
        return self.known._image(q) + drawn.to(q).reshape(*q.shape[:-1], self.m)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        flat = q.reshape(-1, self.p).to(torch.float64)
        waves = (self.heights.T[..., None] * self.frequencies.T).transpose(0, 1).flatten(1)
        falling = -torch.sin(flat @ self.frequencies + self.phases) @ waves
        return self.known._jacobian(q) + falling.to(q).reshape(*q.shape[:-1], self.m, self.p)


@dataclass(frozen=True, eq=False)
class KernelProcess(Doubt, KernelImage):
    """The same, and how sure it is.

    Attributes:
        image: (count, m) images of the data, less the mean.
        stiffness: Penalty times the number of data: the noise's variance over the process's.
        noise: (m,) standard deviation of what the fit leaves of each axis, in the unit of the hand image.
    """

    image: Float[Tensor, "count m"]
    stiffness: float
    noise: Float[Tensor, "m"]

    kind = "kernel_process"

    def __post_init__(self) -> None:
        super().__post_init__()
        _checks.number("stiffness", self.stiffness, above=0.0)

    @cached_property
    def _factor(self) -> Float[Tensor, "count count"]:
        stiff = self._values(self.q) + self.stiffness * torch.eye(len(self.q), dtype=torch.float64)
        factor, failed = torch.linalg.cholesky_ex(stiff)
        if int(failed):
            raise InvalidArray("the stiffness of a kernel process is too small for its postures; give a larger one")
        return factor

    def _covariance(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count entries entries"]:
        spread = self.noise / math.sqrt(self.stiffness)
        bend = 1 / (self.width**2 + 1.0) if self.kernel == "trigonometric" else self.width**-2

        def of(part: Tensor) -> Tensor:
            values = self._values(part)
            cross = torch.stack([values * self._slope(part, joint) for joint in range(self.p)], 1)
            known = torch.linalg.solve_triangular(self._factor, cross.flatten(0, 1).T, upper=False)
            known = known.T.reshape(len(part), self.p, len(self.q))
            return of_each_axis(spread, bend * torch.eye(self.p, dtype=part.dtype) - known @ known.transpose(-1, -2))

        return in_parts(of, q, 4 * self.p * len(self.q))

    def draws(self, n: int, seed: int = 0) -> tuple[KernelDraw, ...]:
        """Functions drawn from the posterior.

        Matheron's rule (Wilson et al. 2020): a draw from the prior, made of random waves, corrected where data are.

        Args:
            n: How many.
            seed: Same seed, same functions.

        Raises:
            InvalidConfig: Not a positive number.
        """
        _checks.whole("n", n, least=1)
        spread = self.noise / math.sqrt(self.stiffness)
        drawn = []
        for stream in np.random.SeedSequence(seed).spawn(n):
            rng = np.random.default_rng(stream)
            frequencies = torch.from_numpy(_frequencies(self.kernel, self.width, (self.p, _WAVES), rng))
            phases = torch.from_numpy(rng.uniform(0.0, 2.0 * math.pi, _WAVES))
            heights = torch.from_numpy(rng.standard_normal((_WAVES, self.m))) * spread * math.sqrt(2.0 / _WAVES)
            prior = torch.cos(self.q @ frequencies + phases) @ heights
            prior = prior + torch.from_numpy(rng.standard_normal(prior.shape)) * self.noise
            dual = torch.cholesky_solve(self.image - prior, self._factor).contiguous()
            known = KernelImage(self.q, self.mean, dual, self.kernel, self.width)
            drawn.append(KernelDraw(known, frequencies, phases, heights, unit=self.unit))
        return tuple(drawn)


@dataclass(frozen=True)
class KernelRidge(Estimator):
    """Kernel ridge regression of r(q) with a product kernel, differentiated exactly.

    Attributes:
        kernel: ``"trigonometric"``, ``"periodic"`` or ``"gaussian"``, as this module says.
        width: w of the kernel: a number of the trigonometric one (at least 1), [rad] of the others; None: the best of
            five on what is held out.
        penalty: Of the function's squared norm against the mean squared error, both of images over their spread; None:
            the best of 21 on what is held out.
        folds: Number of parts of the experience, each held out once to choose these.
        most: Most samples that are used, spread evenly over the experience (the cost grows with their cube).
    """

    kernel: Literal["trigonometric", "periodic", "gaussian"] | str = "trigonometric"
    width: float | None = None
    penalty: float | None = None
    folds: int = 5
    most: int = 500

    def __post_init__(self) -> None:
        _checks.choice("kernel", self.kernel, KERNELS)
        if self.width is not None:
            _check_kernel(self.kernel, self.width)
        if self.penalty is not None:
            _checks.number("penalty", self.penalty, above=0.0)
        _checks.whole("folds", self.folds, least=2)
        _checks.whole("most", self.most, least=2)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> KernelProcess:
        """Learns from an experience; the seed changes nothing. See :meth:`Estimator.fit`."""
        data = samples(exp, type(self).__name__)
        data = data.only(torch.linspace(0, len(data.q) - 1, min(self.most, len(data.q))).round().long())
        mean = data.image.mean(0)
        image = data.image - mean
        if not bool(image.any()):
            raise InvalidRecording("the hand image never moves in the experience, so it has no scale; record a motion")
        # Axes of any unit have one say in what is chosen for all of them.
        spread = image.std(0, correction=0)
        width, penalty = self._chosen(data, image / torch.where(spread > 0, spread, 1.0))
        values = _product(self.kernel, width, data.q, data.q)
        stiffness = penalty * len(image)
        strengths, vectors = torch.linalg.eigh(values)
        shrunk = 1.0 / (strengths.clamp(min=0.0) + stiffness)
        dual = (vectors @ (shrunk[:, None] * (vectors.T @ image))).contiguous()
        # What the fit leaves, stiffness times the dual, over the degrees of freedom that it has not spent.
        free = max(stiffness * float(shrunk.sum()), 1.0)
        noise = ((stiffness * dual) ** 2).sum(0).div(free).sqrt()
        return KernelProcess(data.q, mean, dual, self.kernel, width, image, stiffness, noise, unit=data.unit)

    def _chosen(self, data: Samples, image: Float[Tensor, "count m"]) -> tuple[float, float]:
        """Width and penalty: as given, or the best on folds held out."""
        if self.width is not None and self.penalty is not None:
            return self.width, self.penalty
        spread = 1.0 if self.kernel == "trigonometric" else 0.5 * float(2 * data.q.var(0).sum()) ** 0.5
        widths = [spread * one for one in _WIDTHS] if self.width is None else [self.width]
        penalties = torch.from_numpy(_PENALTIES) if self.penalty is None else torch.tensor([self.penalty])
        kernels = [_product(self.kernel, width, data.q, data.q) for width in widths]

        def errors(learn: Mask, predict: Mask) -> Tensor:
            found = []
            target = image[learn].mean(0)
            for values in kernels:
                strengths, vectors = torch.linalg.eigh(values[learn][:, learn])
                told = vectors.T @ (image[learn] - target)
                shrunk = 1.0 / (strengths.clamp(min=0.0) + penalties[:, None].to(told) * len(told))
                foreseen = (values[predict][:, learn] @ vectors) @ (shrunk[..., None] * told) + target
                found.append(((foreseen - image[predict]) ** 2).sum((-1, -2)))
            return torch.cat(found)

        best = choose(errors, data.folds(self.folds))
        return widths[best // len(penalties)], float(penalties[best % len(penalties)])


# Inner ---------------------------------------------------------------------------------------------------------------


def _check_kernel(kernel: str, width: float) -> None:
    _checks.choice("kernel", kernel, KERNELS)
    _checks.number("width", width, above=1.0 if kernel == "trigonometric" else 0.0)


def _product(
    kernel: str, width: float, q: Float[Tensor, "rows p"], seen: Float[Tensor, "count p"]
) -> Float[Tensor, "rows count"]:
    """The kernel between postures."""
    if kernel == "gaussian":
        squared = (q**2).sum(1)[:, None] + (seen**2).sum(1) - 2.0 * q @ seen.T
        return torch.exp(-0.5 * squared.clamp(min=0.0) / width**2)
    if kernel == "periodic":
        cosines = torch.cos(q) @ torch.cos(seen).T + torch.sin(q) @ torch.sin(seen).T
        return torch.exp((cosines - q.shape[1]) / width**2)
    found = torch.ones(len(q), len(seen), dtype=q.dtype)
    for joint in range(q.shape[1]):
        found = found * ((width**2 + torch.cos(q[:, None, joint] - seen[:, joint])) / (width**2 + 1.0))
    return found


def _frequencies(
    kernel: str, width: float, shape: tuple[int, int], rng: np.random.Generator
) -> Float[np.ndarray, "p waves"]:
    """Waves drawn from the kernel's spectrum (Bochner's theorem; Rahimi and Recht 2007)."""
    if kernel == "gaussian":
        return rng.standard_normal(shape) / width
    if kernel == "trigonometric":
        one = 0.5 / (width**2 + 1.0)
        return rng.choice([-1.0, 0.0, 1.0], p=[one, 1.0 - 2.0 * one, one], size=shape)
    # exp(c cos d - c) = sum over k of exp(-c) I_k(c) cos(k d).
    orders = np.arange(-_HIGHEST, _HIGHEST + 1)
    shares = scipy.special.ive(orders, width**-2)
    return rng.choice(orders.astype(np.float64), p=shares / shares.sum(), size=shape)
