"""The paper's network: displacement of the joints in, displacement of the hand image out (equation 1).

Fuke, Ogino and Asada (2007), section 3.2 and Table 1: one hidden layer of ten units, back-propagation with learning
rate 0.2, 200 steps (500 with noise). The posture is no input.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin.estimators.base import Estimator, LearnedJacobian, is_count, pairs, require


@dataclass(frozen=True, eq=False)
class DisplacementNetwork(LearnedJacobian):
    """``f(dq) = b2 + W2 tanh(b1 + W1 dq)`` (equation 1), scaled to the units of displacements.

    f(0) is not zero: a hand at rest is felt to drift. :attr:`bias` says by how much; nothing subtracts it.

    Attributes:
        W1: (hidden, p) [1/rad].
        b1: (hidden,).
        W2: (m, hidden) [m].
        b2: (m,) [m].
    """

    W1: Float[Tensor, "hidden p"]
    b1: Float[Tensor, "hidden"]
    W2: Float[Tensor, "m hidden"]
    b2: Float[Tensor, "m"]

    kind = "displacement_network"

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return self.W1.shape[1]

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return self.W2.shape[0]

    @property
    def bias(self) -> Float[Tensor, "m"]:
        """f(0): displacement that is predicted for joints at rest [m per step]."""
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

    def arrays(self) -> Mapping[str, Tensor]:
        """Weights and biases."""
        return {"W1": self.W1, "b1": self.b1, "W2": self.W2, "b2": self.b2}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Tensor]) -> DisplacementNetwork:
        """The inverse of :meth:`arrays`."""
        return cls(arrays["W1"], arrays["b1"], arrays["W2"], arrays["b2"])


@dataclass(frozen=True)
class PaperMLP(Estimator):
    """The paper's network (equation 1), trained by full-batch gradient descent.

    Inputs and outputs are divided by their standard deviation over the experience; the loss is half the squared error,
    summed over outputs and averaged over steps; weights and biases start uniform in +-1/sqrt(fan in).

    Attributes:
        hidden: Number of tanh units.
        learning_rate: Of gradient descent, on scaled inputs and outputs.
        steps: Number of descent steps.
    """

    hidden: int = 10
    learning_rate: float = 0.2
    steps: int = 200

    def __post_init__(self) -> None:
        require(is_count(self.hidden, 1), "hidden", self.hidden, "a positive whole number")
        require(0 < self.learning_rate < math.inf, "learning_rate", self.learning_rate, "a positive number")
        require(is_count(self.steps, 0), "steps", self.steps, "a whole number of at least 0")

    def fit(self, exp: xr.Dataset, seed: int = 0) -> DisplacementNetwork:
        """Learns from an experience; the seed draws the first weights. See :meth:`Estimator.fit`."""
        data = pairs(exp)
        in_scale, out_scale = _spread(data.dq), _spread(data.dr)
        x, y = data.dq / in_scale, data.dr / out_scale
        W1, b1, W2, b2 = _first_weights(x.shape[1], self.hidden, y.shape[1], seed)
        for _ in range(self.steps):
            # Back-propagation written out: with ten units, autograd's bookkeeping costs more than the arithmetic.
            hidden = torch.tanh(x @ W1.T + b1)
            error = (hidden @ W2.T + b2 - y) / len(x)
            back = (error @ W2) * (1.0 - hidden**2)
            W2 = W2 - self.learning_rate * error.T @ hidden
            b2 = b2 - self.learning_rate * error.sum(0)
            W1 = W1 - self.learning_rate * back.T @ x
            b1 = b1 - self.learning_rate * back.sum(0)
        return DisplacementNetwork(W1 / in_scale, b1, W2 * out_scale[:, None], b2 * out_scale)


def _spread(values: Float[Tensor, "steps d"]) -> Float[Tensor, "d"]:
    """Standard deviation of each column; one for a column that is constant."""
    spread = values.std(0, correction=0)
    return torch.where(spread > 0, spread, 1.0)


def _first_weights(p: int, hidden: int, m: int, seed: int) -> list[Tensor]:
    generator = torch.Generator().manual_seed(seed)

    def uniform(shape: tuple[int, ...], fan_in: int) -> Tensor:
        return (2 * torch.rand(shape, generator=generator, dtype=torch.float64) - 1) / fan_in**0.5

    return [uniform((hidden, p), p), uniform((hidden,), p), uniform((m, hidden), hidden), uniform((m,), hidden)]
