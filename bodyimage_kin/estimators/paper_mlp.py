"""The paper's network: displacement of the joints in, displacement of the hand image out (equation 1).

Fuke, Ogino and Asada (2007), section 3.2 and Table 1: one hidden layer of ten units, back-propagation with learning
rate 0.2, 200 steps (500 with noise). The posture is no input.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin._compiled import in_threads
from bodyimage_kin.estimators._carry import warn_few
from bodyimage_kin.estimators._samples import pairs, refuse_scattered
from bodyimage_kin.estimators.base import Estimator, LearnedJacobian, check_many

__all__ = ["DisplacementNetwork", "PaperMLP"]


@dataclass(frozen=True, eq=False)
class DisplacementNetwork(LearnedJacobian):
    """``f(dq) = b2 + W2 tanh(b1 + W1 dq)`` (equation 1), scaled to the units of displacements.

    f(0) is not zero: a hand at rest is felt to drift. :attr:`bias` says by how much; nothing subtracts it.

    Attributes:
        W1: (hidden, p) [1/rad].
        b1: (hidden,).
        W2: (m, hidden), in the unit of the hand image.
        b2: (m,) likewise.
    """

    W1: Float[Tensor, "hidden p"]
    b1: Float[Tensor, "hidden"]
    W2: Float[Tensor, "m hidden"]
    b2: Float[Tensor, "m"]

    kind = "displacement_network"

    @property
    def bias(self) -> Float[Tensor, "m"]:
        """f(0): displacement that is predicted for joints at rest, each step."""
        return self.W2 @ torch.tanh(self.b1) + self.b2

    def _displacement(self, q: Float[Tensor, "*batch p"], dq: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        hidden = torch.tanh(dq @ self.W1.to(dq).T + self.b1.to(dq))
        return hidden @ self.W2.to(dq).T + self.b2.to(dq)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        slope = 1.0 - torch.tanh(self.b1) ** 2
        jacobian = (self.W2 * slope) @ self.W1
        return jacobian.to(q).expand(*q.shape[:-1], self.m, self.p).clone()

    def secant(self, dq: Float[Tensor, "steps p"]) -> Float[Tensor, "m p"]:
        """The constant Jacobian that f amounts to over a motion, ``E[(f - f(0)) dq'] E[dq dq']^-1`` [m/rad]."""
        response = self._displacement(dq, dq) - self.bias
        return torch.linalg.lstsq(dq, response, driver="gelsd").solution.T


@dataclass(frozen=True)
class PaperMLP(Estimator):
    """The paper's network (equation 1), trained by gradient descent: all steps of the experience at once, or online.

    Inputs and outputs are divided by their standard deviation over the experience; the loss is half the squared error,
    summed over outputs and averaged over samples; weights and biases start uniform in +-1/sqrt(fan in).

    Attributes:
        hidden: Number of tanh units.
        learning_rate: Of gradient descent, on scaled inputs and outputs.
        steps: Number of descent steps; with online updates, of passes through the experience.
        online: Back-propagate after each sample, in their order in time, rather than over all of them at once. The
            paper does not say which it did.
    """

    hidden: int = 10
    learning_rate: float = 0.2
    steps: int = 200
    online: bool = False

    def __post_init__(self) -> None:
        _checks.whole("hidden", self.hidden, least=1)
        _checks.number("learning_rate", self.learning_rate, above=0.0)
        _checks.whole("steps", self.steps, least=0)
        _checks.flag("online", self.online)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> DisplacementNetwork:
        """Learns from an experience; the seed draws the first weights. See :meth:`Estimator.fit`."""
        return self._train([self._data(exp)], [seed])[0]

    def fit_many(self, experiences: Sequence[xr.Dataset], seeds: Sequence[int]) -> list[LearnedJacobian]:
        """Learns from several experiences side by side. See :meth:`Estimator.fit_many`."""
        check_many(experiences, seeds)
        data = [self._data(exp) for exp in experiences]
        # Of one length: filling up the shorter ones would change how their sums are rounded.
        alike: dict[tuple[int, ...], list[int]] = {}
        for index, one in enumerate(data):
            alike.setdefault((*one.x.shape, len(one.y)), []).append(index)
        learned: dict[int, LearnedJacobian] = {}
        for chosen in alike.values():
            networks = self._train([data[index] for index in chosen], [seeds[index] for index in chosen])
            learned |= zip(chosen, networks, strict=True)
        return [learned[index] for index in range(len(data))]

    def _data(self, exp: xr.Dataset) -> _Scaled:
        if self.online:
            refuse_scattered(exp, "PaperMLP(online=True)", "give online=False")
        scaled = _Scaled.of(exp)
        p, m = len(scaled.x), len(scaled.y)
        warn_few("PaperMLP", scaled.y.numel(), self.hidden * (p + m + 1) + m)
        return scaled

    def _train(self, data: Sequence[_Scaled], seeds: Sequence[int]) -> list[DisplacementNetwork]:
        """Networks of one size, each from its own data."""
        first = [
            _first_weights(len(one.x), self.hidden, len(one.y), seed) for one, seed in zip(data, seeds, strict=True)
        ]
        descend = _descend_online if self.online else _descend
        trained = descend(data, first, self.learning_rate, self.steps)
        return [one.in_units(*weights) for one, weights in zip(data, trained, strict=True)]


_Weights: TypeAlias = tuple[Tensor, Tensor, Tensor, Tensor]
"""W1 (hidden, p), b1 (hidden,), W2 (m, hidden), b2 (m,)."""


@dataclass(frozen=True, eq=False)
class _Scaled:
    """Displacements over their spread; samples last, so that arithmetic runs along them."""

    x: Float[Tensor, "p samples"]
    y: Float[Tensor, "m samples"]
    in_scale: Float[Tensor, "p"]
    out_scale: Float[Tensor, "m"]
    unit: str

    @classmethod
    def of(cls, exp: xr.Dataset) -> _Scaled:
        data = pairs(exp, "PaperMLP")
        in_scale, out_scale = _spread(data.dq), _spread(data.dr)
        return cls((data.dq / in_scale).T, (data.dr / out_scale).T, in_scale, out_scale, data.unit)

    def in_units(self, W1: Tensor, b1: Tensor, W2: Tensor, b2: Tensor) -> DisplacementNetwork:
        """The network, in the units of displacements."""
        weights = (W1 / self.in_scale, b1, W2 * self.out_scale[:, None], b2 * self.out_scale)
        return DisplacementNetwork(*weights, unit=self.unit)


def _descend(data: Sequence[_Scaled], first: Sequence[_Weights], rate: float, steps: int) -> Iterator[_Weights]:
    """Full-batch gradient descent of several networks at once, on as many samples each."""
    W1, b1, W2, b2 = (torch.stack(alike) for alike in zip(*first, strict=True))
    b1, b2 = b1[..., None], b2[..., None]
    x, y = (torch.stack([getattr(one, part) for one in data]) for part in "xy")
    samples = x.mT.contiguous()
    for _ in range(steps):
        # Back-propagation written out: with ten units, autograd's bookkeeping costs more than the arithmetic.
        hidden = torch.baddbmm(b1, W1, x).tanh_()
        error = torch.baddbmm(b2, W2, hidden).sub_(y).div_(x.shape[-1])
        back = torch.bmm(W2.mT, error)
        back.addcmul_(back * hidden, hidden, value=-1.0)
        W2 = W2 - rate * torch.bmm(error, hidden.mT)
        b2 = b2 - rate * error.sum(-1, keepdim=True)
        W1 = W1 - rate * torch.bmm(back, samples)
        b1 = b1 - rate * back.sum(-1, keepdim=True)
    yield from zip(W1, b1[..., 0], W2, b2[..., 0], strict=True)


def _descend_online(data: Sequence[_Scaled], first: Sequence[_Weights], rate: float, steps: int) -> Iterator[_Weights]:
    """Gradient descent after each sample, of several networks at once."""
    from bodyimage_kin.estimators._online_descent import descend

    def one(given: tuple[_Scaled, _Weights]) -> _Weights:
        scaled, weights = given
        arrays = [weight.numpy().copy() for weight in weights]
        descend(scaled.x.T.contiguous().numpy(), scaled.y.T.contiguous().numpy(), *arrays, rate, steps)
        W1, b1, W2, b2 = map(torch.from_numpy, arrays)
        return W1, b1, W2, b2

    return in_threads(one, list(zip(data, first, strict=True)))


def _spread(values: Float[Tensor, "steps d"]) -> Float[Tensor, "d"]:
    """Standard deviation of each column; one for a column that is constant."""
    spread = values.std(0, correction=0)
    return torch.where(spread > 0, spread, 1.0)


def _first_weights(p: int, hidden: int, m: int, seed: int) -> _Weights:
    generator = torch.Generator().manual_seed(seed)

    def uniform(shape: tuple[int, ...], fan_in: int) -> Tensor:
        return (2 * torch.rand(shape, generator=generator, dtype=torch.float64) - 1) / fan_in**0.5

    return uniform((hidden, p), p), uniform((hidden,), p), uniform((m, hidden), hidden), uniform((m,), hidden)
