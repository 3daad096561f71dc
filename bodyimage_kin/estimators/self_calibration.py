"""Self-calibration: the body's structure is known, its measures are not and are found from what is seen.

The strongest competitor of a learned Jacobian: who knows that the arm is a chain of joints and the eye a pinhole has
only a few dozen numbers to learn, and what explains the images in sight holds out of sight as well (Hollerbach
and Wampler 1996).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy.optimize
import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.body import VirtualScreen
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.estimators._field import Doubt, ImageModel
from bodyimage_kin.estimators._samples import Samples, samples
from bodyimage_kin.estimators.base import Estimator
from bodyimage_kin.estimators.chain import Chain
from bodyimage_kin.estimators.evidence import Images
from bodyimage_kin.estimators.intrinsics import Intrinsics
from bodyimage_kin.estimators.map_fit import Fit, maximum_a_posteriori
from bodyimage_kin.estimators.parametric import Mount, ParametricBody, spread_of
from bodyimage_kin.recordings import require_aligned

__all__ = ["BodyProcess", "CalibratedBody", "CalibratedChain", "ChainProcess", "SelfCalibration"]

_STEP = 1e-5
"""Of differences, in joints and in measures [rad or m]."""

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
class CalibratedBody(ImageModel):
    """A body whose measures were found from images of any camera, the others being as they were thought to be.

    Attributes:
        body: As it was found.
    """

    body: Embodiment

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return self.body.p

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return self.body.m

    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return torch.as_tensor(self.body.hand_image(q, on_invisible="nan"))

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return torch.as_tensor(self.body.hand_image_jacobian(q))


@dataclass(frozen=True, eq=False)
class ChainProcess(CalibratedChain, Doubt):
    """A chain whose geometry is known as well as images and prior tell it: normal about the most probable one.

    Attributes:
        spread: Covariance of :attr:`Chain.geometry`.
    """

    spread: Float[Tensor, "parameters parameters"]

    kind = "chain_process"

    def draws(self, n: int, seed: int = 0) -> tuple[CalibratedChain, ...]:
        """Chains that are as plausible. See :class:`bodyimage_kin.estimators.Drawn`."""
        found = _normal(self.chain.geometry.numpy(), self.spread.numpy(), n, seed)
        return tuple(CalibratedChain(self.chain.with_geometry(torch.from_numpy(one)), unit=self.unit) for one in found)

    def _covariance(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count entries entries"]:
        # How the image moves with the geometry, and how that does with each joint.
        moved = []
        for step in _STEP * torch.eye(self.p, dtype=q.dtype):
            ends = [self.chain.fit_terms(q + sign * step)[1] for sign in (1.0, -1.0)]
            moved.append((ends[0] - ends[1]) / (2 * _STEP))
        slope = torch.stack(moved, dim=2).flatten(1, 2)
        return slope @ self.spread.to(q) @ slope.mT


@dataclass(frozen=True, eq=False)
class BodyProcess(CalibratedBody, Doubt):
    """A body whose measures are known as well as what was observed and a prior tell them: normal about the mode.

    Attributes:
        at: The body with other measures.
        measures: The most probable ones, those of ``body``.
        spread: Their covariance; zero of what was held.
    """

    at: Callable[[Float[np.ndarray, "measures"]], Embodiment]
    measures: Float[np.ndarray, "measures"]
    spread: Float[np.ndarray, "measures measures"]

    def draws(self, n: int, seed: int = 0) -> tuple[CalibratedBody, ...]:
        """Bodies that are as plausible. See :class:`bodyimage_kin.estimators.Drawn`."""
        found = _normal(self.measures, self.spread, n, seed)
        return tuple(CalibratedBody(self.at(one), unit=self.unit) for one in found)

    def _covariance(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count entries entries"]:
        free = np.flatnonzero(np.diagonal(self.spread))
        moved = []
        for step in _STEP * np.eye(len(self.measures))[free]:
            ends = [self.at(self.measures + sign * step).hand_image_jacobian(q) for sign in (1.0, -1.0)]
            moved.append((ends[0] - ends[1]) / (2 * _STEP))
        slope = torch.stack(moved, dim=-1).flatten(1, 2)
        return slope @ torch.from_numpy(self.spread[np.ix_(free, free)]) @ slope.mT


@dataclass(frozen=True, eq=False)
class SelfCalibration(Estimator):
    """Finds the axes and offsets of the chain from camera to hand that explain the hand images seen.

    Prior knowledge: the body as it is thought to be, and how far its measures may be off. What images do not tell stays
    as it was thought to be, so that an arm that was seen in few postures is never known worse than before
    (:func:`bodyimage_kin.calibrate` says how sure it is, and takes other evidence as well). In a simulation the body at
    hand is the one that is to be found: there, wrap it in :class:`~bodyimage_kin.estimators.Misinformed`.

    With ``starts``, the geometry is forgotten: only the structure is known (which joints stand between camera and hand,
    in which order, whether they turn or slide, and the screen's distance), and free descents begin at the body's own
    geometry, disturbed at random. Each start descends on what was seen (Levenberg-Marquardt, each parameter scaled by
    its spread); the one that explains it best is kept, and one that explains it to rounding ends the search. That is
    right in sight and worse than no calibration out of it, unless the images tell everything.

    Attributes:
        body: As it is thought to be.
        axis_spread: Standard deviation of an axis' tilt in each of two directions [rad]; at a start, of what is added
            to each component of a unit axis.
        offset_spread: Standard deviation of a joint's origin in each direction [m]; at a start, of each offset.
        hand_spread: Standard deviation of the hand's place on its link, in each direction [m].
        starts: Number of disturbed starts without a prior; 0: with it.
        steps: Most steps of descent from each start, or for each guess of the noise.
        robust: With the prior: Cauchy's cost, under which images beyond three standard deviations lose weight.
    """

    body: Embodiment
    axis_spread: float = 0.05
    offset_spread: float = 0.005
    hand_spread: float = 0.02
    starts: int = 0
    steps: int = 100
    robust: bool = True

    def __post_init__(self) -> None:
        _checks.whole("starts", self.starts, least=0)
        for name in ("axis_spread", "offset_spread", "hand_spread"):
            _checks.number(name, getattr(self, name), least=0.0)
            if self.starts == 0:
                _checks.number(name, getattr(self, name), above=0.0)
        _checks.whole("steps", self.steps, least=1)
        _checks.flag("robust", self.robust)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> CalibratedChain | CalibratedBody:
        """Learns from an experience; the seed draws the starts, if any. See :meth:`Estimator.fit`.

        With the prior what is learned knows its doubt; free starts know none.

        Raises:
            InvalidRecording: An experience of other joints than the body feels, fewer images than there are measures to
                find, or nothing to learn from.
            UnknownName: A joint that the body does not feel.
        """
        data = samples(require_aligned(exp, self.body))
        if self.starts:
            return self._freely(data, seed)
        parametric, fit = self._most_probable(data)
        body = parametric.body_at(self.body, fit.theta)
        spread = fit.covariance * max(fit.chi2, 1.0)
        if not isinstance(body.camera.model, VirtualScreen):
            at = partial(parametric.body_at, self.body)
            return BodyProcess(body, at, fit.theta, spread, unit=data.unit)
        chain = Chain.of(body)
        free = np.flatnonzero(fit.free)
        steps = _STEP * np.eye(len(fit.theta))[free]
        ends = [Chain.of(parametric.body_at(self.body, fit.theta + step)).geometry for step in steps]
        slope = (torch.stack(ends, dim=1) - chain.geometry[:, None]) / _STEP
        return ChainProcess(chain, slope @ torch.from_numpy(spread[np.ix_(free, free)]) @ slope.T, unit=data.unit)

    def _most_probable(self, data: Samples) -> tuple[ParametricBody, Fit]:
        """The mode of the posterior of the body's measures."""
        body = self.body
        camera = Mount("camera", "camera", body.camera.link, body.camera.link_T_camera.numpy())
        hand = Mount("hand", "hand", body.hand.link, np.eye(4))
        parametric = ParametricBody(body.felt_robot, body.joints, [camera, hand])
        spreads = self.axis_spread, self.offset_spread, self.hand_spread
        sd = np.array([spread_of(one, *spreads, held=math.inf) for one in parametric.parameters])
        free = np.isfinite(sd)
        if data.image.numel() <= int(free.sum()):
            raise InvalidRecording(
                f"{data.image.numel()} coordinates of hand images cannot tell {int(free.sum())} measures of the body "
                "and their own noise; record more"
            )
        q = data.q.numpy()
        offset = np.broadcast_to(body.hand.offset.numpy(), (len(q), 3))
        known = Intrinsics.held(body.camera.model)
        term = Images("images", parametric, q, offset, None, "hand", "camera", known, 0, data.image.numpy())
        return parametric, maximum_a_posteriori([term], free=free, sd=sd, robust=self.robust, steps=self.steps)

    def _freely(self, data: Samples, seed: int) -> CalibratedChain:
        """The geometry that explains the images best, whatever it was thought to be."""
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


def _normal(
    mean: Float[np.ndarray, "numbers"], covariance: Float[np.ndarray, "numbers numbers"], n: int, seed: int
) -> Float[np.ndarray, "n numbers"]:
    """Draws of a normal distribution, also of one that is flat in some directions."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(values.clip(min=0.0))
    normal = np.random.default_rng(seed).standard_normal((_checks.whole("n", n, least=1), len(mean)))
    return np.asarray(mean + normal @ root.T)
