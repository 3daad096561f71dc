"""Bases of functions of the posture that are closed under differentiation: a derivative is exact, and costs a product.

Trigonometric products suit chains of revolute joints; polynomials assume nothing.
"""

from __future__ import annotations

import abc
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
class Basis(Kept, abc.ABC):
    """Functions of the posture about a centre; the constant function is the first.

    Attributes:
        centre: (p,) posture about which they are taken [rad or m].
        degree: Of the products that they are.
    """

    centre: Float[Tensor, "p"]
    degree: int

    def __post_init__(self) -> None:
        _checks.whole("degree", self.degree, least=1, most=_MOST)

    @property
    @abc.abstractmethod
    def orders(self) -> Float[Tensor, "functions"]:
        """Order of the first term of each function in the distance from the centre."""

    @abc.abstractmethod
    def __call__(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch functions"]:
        """The functions at postures."""

    @abc.abstractmethod
    def derivative(self, weights: Float[Tensor, "functions columns"]) -> Float[Tensor, "functions columns p"]:
        """Weights of the derivatives of sums of these functions.

        ``d (phi w) / d q_k = phi @ derivative(w)[:, :, k]``.
        """

    @abc.abstractmethod
    def slopes(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count p functions"]:
        """Derivatives of the functions at postures."""

    def check(self, weights: Float[Tensor, "rows columns"]) -> None:
        """Raises InvalidArray unless there is a row of weights for each function."""
        if len(weights) != len(self.orders):
            raise InvalidArray(f"{len(weights)} rows of weights for {len(self.orders)} functions; give one each")

    def _refuse_many(self, functions: int) -> None:
        if functions > _MOST:
            raise InvalidConfig(
                f"degree={self.degree} makes more than {_MOST} products of {len(self.centre)} joints; give a smaller "
                "degree"
            )


@dataclass(frozen=True, eq=False)
class TrigBasis(Basis):
    """All products of 1, sin d_i and 1 - cos d_i over joints, d = q - centre, at most ``degree`` joints in each.

    Every coordinate of a point on a chain of revolute joints is multilinear in (1, sin q_i, cos q_i). About a centre,
    1, sin d_i and 1 - cos d_i span the same space and are of order 0, 1 and 2 in d.
    """

    kind = "trigonometric_basis"

    @cached_property
    def factors(self) -> Int[Tensor, "functions p"]:
        """Which of 1, sin and 1 - cos (0, 1, 2) each function has of each joint."""
        chosen = torch.zeros(1, 0, dtype=torch.long)
        for kept in self._kept:
            longer = torch.cat([chosen.repeat_interleave(3, 0), torch.arange(3).repeat(len(chosen))[:, None]], 1)
            chosen = longer[kept]
        return chosen

    @cached_property
    def orders(self) -> Float[Tensor, "functions"]:
        """Order of the first term of each function in d."""
        return self.factors.sum(1).to(torch.float64)

    @cached_property
    def _kept(self) -> list[Tensor]:
        """For each joint, which of the products with it stay within the degree."""
        kept, joints = [], torch.zeros(1, dtype=torch.long)
        for _ in range(len(self.centre)):
            longer = (joints[:, None] + torch.tensor([0, 1, 1])).reshape(-1)
            kept.append(torch.nonzero(longer <= self.degree)[:, 0])
            joints = longer[kept[-1]]
            self._refuse_many(len(joints))
        return kept

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

    def derivative(self, weights: Float[Tensor, "functions columns"]) -> Float[Tensor, "functions columns p"]:
        """See :meth:`Basis.derivative`."""
        derived = torch.zeros(*weights.shape, len(self.centre), dtype=weights.dtype)
        for joint, (ones, sines, cosines) in enumerate(self._alike):
            derived[ones, :, joint] += weights[sines]
            derived[cosines, :, joint] -= weights[sines]
            derived[sines, :, joint] += weights[cosines]
        return derived

    def slopes(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count p functions"]:
        """See :meth:`Basis.slopes`."""
        functions = self(q)
        found = torch.zeros(len(q), len(self.centre), functions.shape[1], dtype=q.dtype)
        for joint, (ones, sines, cosines) in enumerate(self._alike):
            found[:, joint, sines] = functions[:, ones] - functions[:, cosines]
            found[:, joint, cosines] = functions[:, sines]
        return found

    @cached_property
    def _alike(self) -> list[tuple[Tensor, Tensor, Tensor]]:
        """Of each joint, functions that differ in it alone: with 1, with sin and with 1 - cos of it.

        sin' = 1 - (1 - cos) and (1 - cos)' = sin: a derivative stays among the three.
        """
        place = 3 ** torch.arange(len(self.centre) - 1, -1, -1)
        codes = self.factors @ place
        found = []
        for joint, step in enumerate(place):
            sines = torch.nonzero(self.factors[:, joint] == 1)[:, 0]
            ones, cosines = (torch.searchsorted(codes, codes[sines] + change) for change in (-step, step))
            found.append((ones, sines, cosines))
        return found


@dataclass(frozen=True, eq=False)
class PolynomialBasis(Basis):
    """All monomials of ``d = (q - centre) / scale`` up to a total degree.

    Attributes:
        scale: (p,) unit of each joint [rad or m].
    """

    scale: Float[Tensor, "p"]

    kind = "polynomial_basis"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not bool((self.scale > 0).all()):
            raise InvalidArray(f"scale of a polynomial basis is {self.scale.tolist()}; give positive numbers")

    @cached_property
    def exponents(self) -> Int[Tensor, "functions p"]:
        """Of each joint in each function, in the order of their degrees."""
        rows = [(0,) * len(self.centre)]
        for parent, joint in zip(*self._grown, strict=True):
            grown = list(rows[parent])
            grown[joint] += 1
            rows.append(tuple(grown))
        return torch.tensor(rows)

    @cached_property
    def orders(self) -> Float[Tensor, "functions"]:
        """Degree of each function."""
        return self.exponents.sum(1).to(torch.float64)

    @cached_property
    def _grown(self) -> tuple[list[int], list[int]]:
        """Each further function is an earlier one times a joint, no earlier than the joints that it has: both."""
        parents: list[int] = []
        joints: list[int] = []
        last, latest = [0], [0]
        for _ in range(self.degree):
            begin = len(parents) + 1
            now: list[int] = []
            for parent, first in zip(last, latest, strict=True):
                for joint in range(first, len(self.centre)):
                    parents.append(parent)
                    joints.append(joint)
                    now.append(joint)
                    self._refuse_many(len(parents) + 1)
            last, latest = list(range(begin, len(parents) + 1)), now
        return parents, joints

    def __call__(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch functions"]:
        """The functions at postures."""
        d = (q - self.centre.to(q)) / self.scale.to(q)
        parents, joints = (torch.tensor(one) for one in self._grown)
        found = torch.ones_like(d[..., :1])
        degree = self.exponents.sum(1)[1:]
        for one in range(1, int(degree.max()) + 1):
            chosen = degree == one
            found = torch.cat([found, found[..., parents[chosen]] * d[..., joints[chosen]]], -1)
        return found

    def derivative(self, weights: Float[Tensor, "functions columns"]) -> Float[Tensor, "functions columns p"]:
        """See :meth:`Basis.derivative`."""
        derived = torch.zeros(*weights.shape, len(self.centre), dtype=weights.dtype)
        for joint, (lower, higher, slope) in enumerate(self._steps):
            derived[lower, :, joint] = weights[higher] * slope[:, None].to(weights)
        return derived

    def slopes(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count p functions"]:
        """See :meth:`Basis.slopes`."""
        functions = self(q)
        found = torch.zeros(len(q), len(self.centre), functions.shape[1], dtype=q.dtype)
        for joint, (lower, higher, slope) in enumerate(self._steps):
            found[:, joint, higher] = functions[:, lower] * slope.to(q)
        return found

    @cached_property
    def _steps(self) -> list[tuple[Tensor, Tensor, Tensor]]:
        """Of each joint, functions that are one degree apart in it, lower and higher, and the slope between them."""
        place = (self.degree + 1) ** torch.arange(len(self.centre))
        codes, order = (self.exponents @ place).sort()
        found = []
        for joint, step in enumerate(place):
            higher = torch.nonzero(self.exponents[:, joint])[:, 0]
            lower = order[torch.searchsorted(codes, self.exponents[higher] @ place - step)]
            found.append((lower, higher, self.exponents[higher, joint] / self.scale[joint]))
        return found
