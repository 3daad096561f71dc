"""The true Jacobian, corrupted by known doses: what a measure must see, if it is to see anything."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.body import Embodiment
from bodyimage_kin.estimators import Analytic, Estimator, LearnedJacobian

__all__ = ["DOSES", "Corrupted", "CorruptedJacobian"]

DOSES: Mapping[str, tuple[float, ...]] = {
    "scale": (0.9, 0.75, 0.5, 0.25),
    "rotation": (5.0, 15.0, 30.0, 60.0),
    "rank": (0.25, 0.5, 0.75, 1.0),
    "noise": (0.1, 0.3, 0.6, 1.0),
}
"""Factor of all entries; turn in the image [degrees]; share of the smaller singular value that is taken away; norm of a
constant random matrix over that of the Jacobian."""


@dataclass(frozen=True, eq=False)
class CorruptedJacobian(LearnedJacobian):
    """The true Jacobian, corrupted at every posture alike.

    Attributes:
        true: The analytic one.
        corruption: How.
        noise: (m, p) the constant random matrix that ``"noise"`` adds.
    """

    true: LearnedJacobian
    corruption: Corrupted
    noise: Float[Tensor, "m p"]

    def _displacement(self, q: Float[Tensor, "*batch p"], dq: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return (self._jacobian(q) @ dq[..., None])[..., 0]

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        J, kind, dose = self.true.jacobian(q), self.corruption.kind, self.corruption.dose
        if kind == "scale":
            return dose * J
        if kind == "rotation":
            c, s = np.cos(np.radians(dose)), np.sin(np.radians(dose))
            return torch.tensor([[c, -s], [s, c]], dtype=J.dtype) @ J
        if kind == "rank":
            U, S, Vt = torch.linalg.svd(J, full_matrices=False)
            kept = torch.ones_like(S)
            kept[..., -1] = 1.0 - dose
            return (U * (S * kept)[..., None, :]) @ Vt
        size = torch.linalg.matrix_norm(J).mean() / torch.linalg.matrix_norm(self.noise)
        return J + dose * size * self.noise.to(J)


@dataclass(frozen=True, eq=False)
class Corrupted(Estimator):
    """An estimator that knows the truth and spoils it.

    Attributes:
        body: Whose truth.
        kind: One of :data:`DOSES`.
        dose: How much.
    """

    body: Embodiment | None
    kind: str
    dose: float

    def __post_init__(self) -> None:
        _checks.choice("kind", self.kind, DOSES)
        _checks.number("dose", self.dose, least=0.0)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> CorruptedJacobian:
        """Nothing is learned; the seed draws the noise."""
        assert self.body is not None
        noise = torch.from_numpy(np.random.default_rng(seed).standard_normal((64, 64)))
        return CorruptedJacobian(Analytic(self.body).fit(exp), self, noise[: self.body.m, : self.body.p])
