"""The paper's network with each of its unclear settings as a field.

With the fields' defaults it is :class:`bodyimage_kin.estimators.PaperMLP`, to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.estimators import Estimator, LearnedJacobian, pairs

__all__ = ["Layers", "Network", "Perceptron"]

Layers = list[tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Perceptron(LearnedJacobian):
    """A trained network of any depth, of dq alone or of posture and dq.

    Attributes:
        layers: (weights, biases) of each layer, the last one linear; for scaled inputs and outputs.
        centre: Subtracted from the inputs.
        in_scale: Divides the inputs.
        out_scale: Multiplies the outputs [m].
        posture: Whether the posture comes before dq in the inputs.
        activation: ``"tanh"`` or ``"logistic"``.
    """

    layers: Layers
    centre: Float[Tensor, "inputs"]
    in_scale: Float[Tensor, "inputs"]
    out_scale: Float[Tensor, "m"]
    posture: bool
    activation: str

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return len(self.in_scale) // (2 if self.posture else 1)

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return len(self.out_scale)

    def _displacement(self, q: Tensor, dq: Tensor) -> Tensor:
        inputs = torch.cat([q, dq], dim=-1) if self.posture else dq
        x = (inputs - self.centre) / self.in_scale
        activate = torch.tanh if self.activation == "tanh" else torch.sigmoid
        *hidden, (weights, biases) = self.layers
        for W, b in hidden:
            x = activate(x @ torch.from_numpy(W).T + torch.from_numpy(b))
        return (x @ torch.from_numpy(weights).T + torch.from_numpy(biases)) * self.out_scale


@dataclass(frozen=True)
class Network(Estimator):
    """A network trained by back-propagation.

    Attributes:
        hidden: Units in each hidden layer.
        depth: Number of hidden layers.
        learning_rate: Of gradient descent.
        steps: Of descent: sweeps over all samples, or single ones for ``update="sample"``.
        posture: Whether the posture is an input beside dq.
        unit: ``"tanh"`` or ``"logistic"``.
        scaling: ``"spread"``: inputs and outputs divided by their standard deviation; ``"range"``: brought to
            [-1, 1]; ``"none"``: radians and metres.
        update: ``"mean"`` of all samples at once, their ``"sum"``, or ``"sample"``: one sample a step.
    """

    hidden: int = 10
    depth: int = 1
    learning_rate: float | int = 0.2
    steps: int = 200
    posture: bool = False
    unit: str = "tanh"
    scaling: str = "spread"
    update: str = "mean"

    def __post_init__(self) -> None:
        for name in ("hidden", "depth"):
            _checks.whole(name, getattr(self, name), least=1)
        _checks.number("learning_rate", self.learning_rate, above=0.0)
        _checks.whole("steps", self.steps, least=0)
        _checks.flag("posture", self.posture)
        _checks.choice("unit", self.unit, ("tanh", "logistic"))
        _checks.choice("scaling", self.scaling, ("spread", "range", "none"))
        _checks.choice("update", self.update, ("mean", "sum", "sample"))

    def fit(self, exp: xr.Dataset, seed: int = 0) -> Perceptron:
        """Learns from an experience; the seed draws first weights and single samples."""
        data = pairs(exp)
        inputs = torch.cat([data.q, data.dq], dim=1) if self.posture else data.dq
        centre = torch.zeros(inputs.shape[1], dtype=inputs.dtype)
        if self.posture:
            centre[: data.q.shape[1]] = data.q.mean(0)
        in_scale, out_scale = self._scale(inputs - centre), self._scale(data.dr)
        x, y = ((inputs - centre) / in_scale).numpy(), (data.dr / out_scale).numpy()
        sizes = [x.shape[1], *[self.hidden] * self.depth, y.shape[1]]
        layers = _first_layers(sizes, seed)
        rng = np.random.default_rng(seed)
        with np.errstate(over="ignore", invalid="ignore"):
            for _ in range(self.steps):
                batch = rng.integers(len(x), size=1) if self.update == "sample" else slice(None)
                size = len(x) if self.update == "mean" else 1
                layers = self._step(layers, x[batch], y[batch], self.learning_rate / size)
        return Perceptron(layers, centre, in_scale, out_scale, self.posture, self.unit)

    def _scale(self, values: Float[Tensor, "steps d"]) -> Float[Tensor, "d"]:
        if self.scaling == "none":
            return torch.ones(values.shape[1], dtype=values.dtype)
        scale = values.std(0, correction=0) if self.scaling == "spread" else values.abs().amax(0)
        return torch.where(scale > 0, scale, 1.0)

    def _step(self, layers: Layers, x: np.ndarray, y: np.ndarray, rate: float) -> Layers:
        tanh = self.unit == "tanh"
        values = [x]
        for W, b in layers[:-1]:
            total = values[-1] @ W.T + b
            values.append(np.tanh(total) if tanh else 1.0 / (1.0 + np.exp(-total)))
        error = values[-1] @ layers[-1][0].T + layers[-1][1] - y
        changed = []
        for index in reversed(range(len(layers))):
            (W, b), below = layers[index], values[index]
            changed.append((W - rate * error.T @ below, b - rate * error.sum(0)))
            error = (error @ W) * (1.0 - below**2 if tanh else below * (1.0 - below))
        return changed[::-1]


def _first_layers(sizes: list[int], seed: int) -> Layers:
    """Uniform in +-1/sqrt(fan in), drawn as the package's own network draws them."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int, fan_in: int) -> np.ndarray:
        return ((2 * torch.rand(shape, generator=generator, dtype=torch.float64) - 1) / fan_in**0.5).numpy()

    return [
        (uniform(outputs, inputs, fan_in=inputs), uniform(outputs, fan_in=inputs))
        for inputs, outputs in pairwise(sizes)
    ]
