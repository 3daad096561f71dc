"""Products of sines and cosines of joints: a basis that is closed under differentiation.

Every coordinate of a point on a chain of revolute joints is multilinear in (1, sin q_i, cos q_i). About a centre c,
with d = q - c, the functions 1, sin d_i and 1 - cos d_i span the same space and are of order 0, 1 and 2 in d.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.estimators._kept import Kept

_MOST = 6000
"""More functions than this take gigabytes."""


@dataclass(frozen=True, eq=False)
class TrigBasis(Kept):
    """All products of 1, sin d_i and 1 - cos d_i over joints, at most ``degree`` joints in each.

    Attributes:
        centre: (p,) posture about which it is taken [rad].
        degree: Most joints in a product.
    """

    centre: Float[Tensor, "p"]
    degree: int

    kind = "trigonometric_basis"

    def __post_init__(self) -> None:
        _checks.whole("degree", self.degree, least=1)

    @cached_property
    def factors(self) -> Int[Tensor, "functions p"]:
        """Which of 1, sin and 1 - cos (0, 1, 2) each function has of each joint; the constant function is first."""
        chosen = torch.zeros(1, 0, dtype=torch.long)
        for kept in self._kept:
            longer = torch.cat([chosen.repeat_interleave(3, 0), torch.arange(3).repeat(len(chosen))[:, None]], 1)
            chosen = longer[kept]
        return chosen

    @cached_property
    def orders(self) -> Float[Tensor, "functions"]:
        """Order in d of the first term of each function."""
        return self.factors.sum(1).to(torch.float64)

    @cached_property
    def _kept(self) -> list[Tensor]:
        """For each joint, which of the products with it stay within the degree."""
        kept, joints = [], torch.zeros(1, dtype=torch.long)
        for _ in range(len(self.centre)):
            longer = (joints[:, None] + torch.tensor([0, 1, 1])).reshape(-1)
            kept.append(torch.nonzero(longer <= self.degree)[:, 0])
            joints = longer[kept[-1]]
            if len(joints) > _MOST:
                raise InvalidConfig(
                    f"degree={self.degree} makes more than {_MOST} products of {len(self.centre)} joints; give a "
                    "smaller degree"
                )
        return kept

    def check(self, weights: Float[Tensor, "rows columns"]) -> None:
        """Raises InvalidArray unless there is a row of weights for each function."""
        if len(weights) != len(self.factors):
            raise InvalidArray(f"{len(weights)} rows of weights for {len(self.factors)} functions; give one each")

    def __call__(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch functions"]:
        """The functions at postures."""
        d = q - self.centre.to(q)
        each = torch.stack([torch.ones_like(d), torch.sin(d), 1.0 - torch.cos(d)], -1)
        product = torch.ones_like(d[..., :1])
        for joint, kept in enumerate(self._kept):
            product = (product[..., :, None] * each[..., joint, None, :]).flatten(-2)
            if len(kept) < product.shape[-1]:
                product = product[..., kept]
        return product

    def derivative(self, weights: Float[Tensor, "functions m"]) -> Float[Tensor, "functions m p"]:
        """Weights of the derivatives of a sum of these functions.

        ``d (phi w) / d q_k = phi @ derivative(w)[:, :, k]``, since sin' = 1 - (1 - cos) and (1 - cos)' = sin.
        """
        p = len(self.centre)
        place = 3 ** torch.arange(p - 1, -1, -1)
        codes = self.factors @ place
        derived = torch.zeros(*weights.shape, p, dtype=weights.dtype)
        for joint in range(p):
            sines = torch.nonzero(self.factors[:, joint] == 1)[:, 0]
            cosines = torch.searchsorted(codes, codes[sines] + place[joint])
            derived[torch.searchsorted(codes, codes[sines] - place[joint]), :, joint] += weights[sines]
            derived[cosines, :, joint] -= weights[sines]
            derived[sines, :, joint] += weights[cosines]
        return derived
