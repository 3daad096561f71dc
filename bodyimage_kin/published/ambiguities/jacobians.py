"""Which Jacobian the paper's network stands for, and what a constant one that knows the face would be."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
import xarray as xr
from torch import Tensor

from bodyimage_kin._arrays import as_postures
from bodyimage_kin.body import Embodiment
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators import ConstantJacobian, Estimator, LearnedJacobian, PaperMLP

__all__ = ["AtZero", "FaceMean", "Secant", "Unbiased", "UnbiasedJacobian"]


@dataclass(frozen=True, eq=False)
class UnbiasedJacobian(LearnedJacobian):
    """``f(dq) - f(0)``: a hand at rest is felt to rest.

    Attributes:
        network: f.
        bias: (m,) f(0), in the unit of the hand image.
    """

    network: LearnedJacobian
    bias: Tensor

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return self.network.p

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return self.network.m

    def _displacement(self, q: Tensor, dq: Tensor) -> Tensor:
        return self.network.displacement(q, dq) - self.bias


@dataclass(frozen=True)
class Unbiased(Estimator):
    """The paper's network without what it predicts for joints at rest.

    Attributes:
        network: The network.
    """

    network: PaperMLP = field(default_factory=PaperMLP)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> UnbiasedJacobian:
        """Learns from an experience; the seed draws the network's first weights."""
        learned = self.network.fit(exp, seed)
        return UnbiasedJacobian(learned, learned.bias, unit=learned.unit)


@dataclass(frozen=True)
class AtZero(Estimator):
    """The constant Jacobian that is the derivative of the paper's network at zero displacement.

    Attributes:
        network: The network.
    """

    network: PaperMLP = field(default_factory=PaperMLP)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> ConstantJacobian:
        """Learns from an experience; the seed draws the network's first weights."""
        learned = self.network.fit(exp, seed)
        return ConstantJacobian(learned.jacobian(torch.zeros(learned.p, dtype=torch.float64)), unit=learned.unit)


@dataclass(frozen=True, eq=False)
class Secant(Estimator):
    """The constant Jacobian that the paper's network amounts to over a motion.

    Attributes:
        network: The network.
        motion: (steps, p) felt displacements of the joints over the motion it is used for [rad or m]: told.
    """

    network: PaperMLP = field(default_factory=PaperMLP)
    motion: Any = None

    def fit(self, exp: xr.Dataset, seed: int = 0) -> ConstantJacobian:
        """Learns from an experience; the seed draws the network's first weights.

        Raises:
            InvalidConfig: No motion was told.
        """
        if self.motion is None:
            raise InvalidConfig("Secant: motion=None; tell it the displacements of the joints in use")
        learned = self.network.fit(exp, seed)
        dq = as_postures(self.motion, learned.p, "motion")
        return ConstantJacobian(learned.secant(dq).contiguous(), unit=learned.unit)


@dataclass(frozen=True, eq=False)
class FaceMean(Estimator):
    """No estimator but a bound: the constant Jacobian that is the mean of the true ones over the taxels.

    Attributes:
        body: Whose truth.
    """

    body: Embodiment | None = None

    def fit(self, exp: xr.Dataset, seed: int = 0) -> ConstantJacobian:
        """Nothing is learned, and nothing drawn."""
        assert self.body is not None
        with torch.no_grad():
            touching = self.body.touch_postures(np.arange(self.body.require_skin().count))
            return ConstantJacobian(self.body.hand_image_jacobian(touching).mean(0), unit=self.body.camera.model.unit)
