"""Self-calibration: the body's structure is known, its measures are not and are found from what is seen.

The strongest competitor of a learned Jacobian: who knows that the arm is a chain of joints and the eye a pinhole has
only a few dozen numbers to learn, and what explains the images in sight holds out of sight as well (Hollerbach
and Wampler 1996).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize
import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.estimators._field import ImageModel
from bodyimage_kin.estimators._samples import Samples, samples
from bodyimage_kin.estimators.base import Estimator
from bodyimage_kin.estimators.chain import Chain
from bodyimage_kin.recordings import require_aligned

__all__ = ["CalibratedChain", "SelfCalibration"]

_ROUNDING = 1e-20
"""Mean squared residual, in units of the images' variance, below which nothing is left to explain."""


@dataclass(frozen=True, eq=False)
class CalibratedChain(ImageModel):
    """A chain of joints from camera to hand, its geometry found from images.

    Attributes:
        chain: The geometry; the common scale of its offsets is arbitrary, for no image shows it.
    """

    chain: Chain

    kind = "calibrated_chain"

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return 2

    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        image = self.chain.image(self.chain.point(q.reshape(-1, self.p)))
        return image.reshape(*q.shape[:-1], self.m)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        point, moved = self.chain.point_jacobian(q.reshape(-1, self.p))
        return (self.chain.image_slope(point) @ moved).reshape(*q.shape[:-1], self.m, self.p)


@dataclass(frozen=True, eq=False)
class SelfCalibration(Estimator):
    """Finds the axes and offsets of the chain from camera to hand that explain the hand images seen.

    Prior knowledge, all of it: which joints stand between camera and hand, in which order, and whether they turn or
    slide; the camera's screen distance; and roughly the geometry, as a start: the body's own, every axis and offset
    disturbed at random. Each start descends on what was seen (Levenberg-Marquardt, each parameter scaled by its
    spread); the one that explains it best is kept, and one that explains it to rounding ends the search.

    Attributes:
        body: Whose structure is known.
        starts: Number of disturbed starts.
        axis_spread: Standard deviation of what is added to each component of a unit axis, at each start.
        offset_spread: Standard deviation of what is added to each component of an offset, at each start [m].
        steps: Most steps of descent from each start.
    """

    body: Embodiment
    starts: int = 6
    axis_spread: float = 0.2
    offset_spread: float = 0.02
    steps: int = 100

    def __post_init__(self) -> None:
        _checks.whole("starts", self.starts, least=1)
        _checks.number("axis_spread", self.axis_spread, least=0.0)
        _checks.number("offset_spread", self.offset_spread, least=0.0)
        _checks.whole("steps", self.steps, least=1)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> CalibratedChain:
        """Learns from an experience; the seed draws the starts. See :meth:`Estimator.fit`.

        Raises:
            InvalidRecording: An experience of other joints than the body feels, fewer images than there are measures to
                find, or nothing to learn from.
            UnknownName: A joint that the body does not feel.
        """
        data = samples(require_aligned(exp, self.body))
        chain = Chain.of(self.body)
        spread = torch.cat(
            [
                torch.full_like(chain.axes.flatten(), self.axis_spread),
                torch.full_like(chain.offsets.flatten(), self.offset_spread),
            ]
        )
        if data.image.numel() < len(spread):
            raise InvalidRecording(
                f"{data.image.numel()} coordinates of hand images cannot tell {len(spread)} measures of the body; "
                "record more"
            )
        best, least = chain.geometry, math.inf
        for stream in np.random.SeedSequence(seed).spawn(self.starts):
            normal = torch.from_numpy(np.random.default_rng(stream).standard_normal(len(spread)))
            cost, geometry = self._descend(chain, chain.geometry + spread * normal, spread, data)
            if cost < least:
                best, least = geometry, cost
            if least < _ROUNDING:
                break
        return CalibratedChain(chain.with_geometry(best), unit=data.unit)

    def _descend(
        self, chain: Chain, start: Float[Tensor, "parameters"], spread: Float[Tensor, "parameters"], data: Samples
    ) -> tuple[float, Tensor]:
        """Mean squared residual, in units of the images' variance, and geometry at the end."""
        scale = torch.where(spread > 0, spread, 0.1).numpy()
        unit = float(data.image.std(correction=0).clamp(min=1e-12))

        begin = chain.with_geometry(start)
        begin = replace(begin, axes=begin.axes / begin.axes.norm(dim=1, keepdim=True))

        def here(parameters: Float[np.ndarray, "parameters"]) -> Chain:
            # Copied: how a product rounds depends on where an array begins in memory, and fits must repeat to the bit.
            return chain.with_geometry(torch.from_numpy(parameters).clone())

        def residual(parameters: Float[np.ndarray, "parameters"]) -> Float[np.ndarray, "residuals"]:
            now = here(parameters)
            image, _ = now.fit_terms(data.q)
            return torch.cat([((image - data.image) / unit).flatten(), now.convention(begin)[0]]).numpy()

        def slope(parameters: Float[np.ndarray, "parameters"]) -> Float[np.ndarray, "residuals parameters"]:
            now = here(parameters)
            _, moved = now.fit_terms(data.q)
            return torch.cat([(moved / unit).flatten(0, 1), now.convention(begin)[1]]).numpy()

        end = scipy.optimize.least_squares(
            residual,
            begin.geometry.numpy(),
            slope,
            method="lm",
            x_scale=scale,
            max_nfev=self.steps,
            xtol=1e-15,
            ftol=1e-15,
        )
        return float(np.mean(end.fun**2)), torch.from_numpy(end.x)
