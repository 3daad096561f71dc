"""Training of small networks: several at once, full batch, early stopping on what is held out, deterministic.

Networks are trained side by side along a leading axis ``models``. Nothing passes from one to another: each has its own
data, first weights and best weights. What one learns depends on the others in its last bits at most: how a matrix
product rounds depends on where its matrices begin in memory.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from bodyimage_kin import _checks

Layers = Sequence[Tensor]
"""Weights and biases in turn: (*models, out, in), (*models, out), ..."""
_FIRST, _SECOND, _TINY = 0.9, 0.999, 1e-8


@dataclass(frozen=True)
class Training:
    """How a network is trained: Adam with decoupled weight decay (Loshchilov and Hutter 2019), full batch.

    Attributes:
        hidden: Units of each hidden layer (tanh).
        learning_rate: Of Adam, on scaled inputs and outputs; it falls to zero along a half cosine.
        steps: Number of steps.
        weight_decay: Rate at which weights shrink, times the learning rate.
        held_out: Share of the experience that is held out, in arcs, blocks or clusters; the weights that do best on it
            are kept.
            0: nothing is held out, and the last weights are kept.
    """

    hidden: tuple[int, ...] = (32, 32)
    learning_rate: float = 0.01
    steps: int = 1000
    weight_decay: float = 0.1
    held_out: float = 0.2

    def __post_init__(self) -> None:
        if not isinstance(self.hidden, tuple) or not self.hidden:
            _checks.refuse("hidden", self.hidden, "a tuple of positive whole numbers")
        for index, units in enumerate(self.hidden):
            _checks.whole(f"hidden[{index}]", units, least=1)
        _checks.number("learning_rate", self.learning_rate, above=0.0, below=1.0)
        _checks.whole("steps", self.steps, least=1)
        _checks.number("weight_decay", self.weight_decay, least=0.0, below=1.0 / self.learning_rate)
        _checks.number("held_out", self.held_out, least=0.0, most=0.5)


def first_layers(sizes: Sequence[int], seeds: Sequence[int]) -> list[Tensor]:
    """Weights and biases of networks that begin uniform in +-1/sqrt(fan in), one network for each seed."""
    models = []
    for seed in seeds:
        generator = torch.Generator().manual_seed(seed)
        layers = []
        for inputs, outputs in itertools.pairwise(sizes):
            for shape in ((outputs, inputs), (outputs,)):
                uniform = torch.rand(shape, generator=generator, dtype=torch.float64)
                layers.append((2.0 * uniform - 1.0) / inputs**0.5)
        models.append(layers)
    return [torch.stack(alike) for alike in zip(*models, strict=True)]


def evaluate(layers: Layers, x: Float[Tensor, "*rows inputs"]) -> Float[Tensor, "*rows outputs"]:
    """Outputs of tanh networks with a linear last layer; rows: (models, count), or any batch for a single network."""
    for index in range(0, len(layers), 2):
        W, b = layers[index].to(x), layers[index + 1].to(x)
        x = x @ W.transpose(-1, -2) + (b[..., None, :] if b.ndim > 1 else b)
        x = torch.tanh(x) if index + 2 < len(layers) else x
    return x


def slope(layers: Layers, x: Float[Tensor, "*rows inputs"], first: int = 0) -> Float[Tensor, "*rows outputs columns"]:
    """Derivative of one network's outputs with respect to its inputs from ``first`` on, back through its layers."""
    slopes = []
    for index in range(0, len(layers) - 2, 2):
        x = torch.tanh(x @ layers[index].to(x).T + layers[index + 1].to(x))
        slopes.append(1.0 - x**2)
    derivative = layers[-2].to(x).expand(*x.shape[:-1], -1, -1)
    for index, hidden in zip(range(len(layers) - 4, -1, -2), reversed(slopes), strict=True):
        W = layers[index].to(x)
        derivative = (derivative * hidden[..., None, :]) @ (W if index else W[:, first:])
    return derivative


def train(
    layers: list[Tensor],
    error: Callable[[Layers], Float[Tensor, "models count"]],
    held: Bool[Tensor, "count"],
    settings: Training,
) -> list[Tensor]:
    """The weights of each network that did best on its held-out samples.

    Args:
        layers: First weights, with the axis of models.
        error: Squared errors of all samples, from weights.
        held: Which samples are held out.
        settings: Of the training.
    """
    learn = ~held
    layers = [layer.clone().requires_grad_() for layer in layers]
    first = [torch.zeros_like(layer) for layer in layers]
    second = [torch.zeros_like(layer) for layer in layers]
    best = [layer.detach().clone() for layer in layers]
    least = torch.full((len(layers[0]),), torch.inf, dtype=layers[0].dtype)
    for step in range(settings.steps + 1):
        squared = error(layers)
        if held.any():
            judged = squared[:, held].detach().mean(1)
            better = judged < least
            least = torch.where(better, judged, least)
            for kept, layer in zip(best, layers, strict=True):
                kept[better] = layer.detach()[better]
        if step == settings.steps:
            break
        # A sum over models: each network's gradient is that of its own error.
        gradients = torch.autograd.grad(squared[:, learn].mean(1).sum(), layers)
        rate = settings.learning_rate * 0.5 * (1.0 + math.cos(math.pi * step / settings.steps))
        with torch.no_grad():
            for index, (layer, gradient) in enumerate(zip(layers, gradients, strict=True)):
                first[index].lerp_(gradient, 1.0 - _FIRST)
                second[index].lerp_(gradient**2, 1.0 - _SECOND)
                mean = first[index] / (1.0 - _FIRST ** (step + 1))
                spread = (second[index] / (1.0 - _SECOND ** (step + 1))).sqrt() + _TINY
                if index % 2 == 0:
                    layer.mul_(1.0 - rate * settings.weight_decay)
                layer.sub_(rate * mean / spread)
    return best if held.any() else [layer.detach() for layer in layers]
