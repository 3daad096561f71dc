"""Networks that see the posture: a displacement f(q, dq), a matrix J(q), or an image r(q) that is differentiated.

Three ways to teach the same thing. :class:`PostureMLP` extends the paper's network by the posture.
:class:`JacobianNetwork` gives the matrix itself and is taught through ``J(q) dq``. :class:`ForwardNetwork` is a forward
model, and its derivative teaches at a distance (Jordan and Rumelhart 1992; for visual servoing Przystupa et al. 2021).

Postures are centred and divided by one spread, that of all joints together: dividing each joint by its own would blow
up the noise of those that hardly move.
"""

from __future__ import annotations

import abc
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.estimators._field import ImageModel, JacobianField
from bodyimage_kin.estimators._samples import Mask, pairs, samples
from bodyimage_kin.estimators._training import Layers, Training, evaluate, first_layers, slope, train
from bodyimage_kin.estimators.base import Estimator, LearnedJacobian, check_many

__all__ = ["ForwardNetwork", "JacobianNetwork", "NetworkImage", "NetworkJacobian", "PostureDisplacement", "PostureMLP"]


@dataclass(frozen=True, eq=False)
class _Network(LearnedJacobian):
    """Keeps weights and biases, in the units of postures and images.

    Attributes:
        layers: Weights and biases in turn, in the units of joints and hand image.
    """

    layers: tuple[Tensor, ...]

    def __post_init__(self) -> None:
        sizes = [tuple(layer.shape) for layer in self.layers]
        pairs_fit = all(len(W) == 2 and b == W[:1] for W, b in zip(sizes[::2], sizes[1::2], strict=False))
        if (
            not sizes
            or len(sizes) % 2
            or not pairs_fit
            or any(W[1] != b[0] for b, W in zip(sizes[1::2], sizes[2::2], strict=False))
        ):
            raise InvalidArray(f"layers have shapes {sizes}; give weights (out, in) and biases (out,) in turn")


@dataclass(frozen=True, eq=False)
class PostureDisplacement(_Network):
    """``f(q, dq)``, one tanh network of both. ``f(q, 0)`` is not zero, as with the paper's network."""

    kind = "posture_displacement"

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return self.layers[0].shape[1] // 2

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return len(self.layers[-1])

    def _displacement(self, q: Float[Tensor, "*batch p"], dq: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return evaluate(self.layers, torch.cat([q, dq.to(q)], -1))

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return slope(self.layers, torch.cat([q, torch.zeros_like(q)], -1), first=self.p)


@dataclass(frozen=True, eq=False)
class NetworkJacobian(_Network, JacobianField):
    """A tanh network whose outputs are the entries of J(q)."""

    kind = "network_jacobian"

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return self.layers[0].shape[1]

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return len(self.layers[-1]) // self.p

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return evaluate(self.layers, q).reshape(*q.shape[:-1], self.m, self.p)


@dataclass(frozen=True, eq=False)
class NetworkImage(_Network, ImageModel):
    """A forward model: a tanh network r(q), and the Jacobian that is its derivative."""

    kind = "network_image"

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return self.layers[0].shape[1]

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return len(self.layers[-1])

    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return evaluate(self.layers, q)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return slope(self.layers, q)


@dataclass(frozen=True, eq=False)
class _Lesson:
    """What networks of one kind are trained on.

    Attributes:
        x: (*models, count, inputs).
        y: (*models, count, m).
        held: (count,) which are held out.
        unit: Of the hand image.
    """

    x: Tensor
    y: Tensor
    held: Mask
    unit: str = ""

    @classmethod
    def of_displacements(cls, exp: xr.Dataset, share: float, learner: str) -> _Lesson:
        """Postures and displacements of the joints in, displacements of the hand image out."""
        data, held = pairs(exp, learner).held_out(share)
        return cls(torch.cat([data.q, data.dq], 1), data.dr, held, data.unit)


class _NetworkEstimator(Training, Estimator):
    """Learns from experiences of one length side by side."""

    def fit(self, exp: xr.Dataset, seed: int = 0) -> LearnedJacobian:
        """Learns from an experience; the seed draws the first weights. See :meth:`Estimator.fit`."""
        return self.fit_many([exp], [seed])[0]

    def fit_many(self, experiences: Sequence[xr.Dataset], seeds: Sequence[int]) -> list[LearnedJacobian]:
        """Learns from several experiences at once: as one by one, to rounding. See :meth:`Estimator.fit_many`."""
        check_many(experiences, seeds)
        data = [self._data(exp) for exp in experiences]
        learned: dict[int, LearnedJacobian] = {}
        shapes = [(one.x.shape, one.y.shape, tuple(one.held.tolist())) for one in data]
        for shape in dict.fromkeys(shapes):
            alike = [index for index, other in enumerate(shapes) if other == shape]
            together = _Lesson(
                torch.stack([data[index].x for index in alike]),
                torch.stack([data[index].y for index in alike]),
                data[alike[0]].held,
            )
            learned |= zip(alike, self._learn(together, [seeds[index] for index in alike]), strict=True)
        return [replace(learned[index], unit=one.unit) for index, one in enumerate(data)]

    @abc.abstractmethod
    def _data(self, exp: xr.Dataset) -> _Lesson:
        """What one experience teaches."""

    @abc.abstractmethod
    def _learn(self, lesson: _Lesson, seeds: Sequence[int]) -> Sequence[LearnedJacobian]:
        """Learned Jacobians from inputs and outputs with a leading axis of models."""

    def _train(
        self,
        outputs: int,
        x: Float[Tensor, "models count inputs"],
        target: Float[Tensor, "models count m"],
        held: Mask,
        seeds: Sequence[int],
        read: Callable[[Tensor], Tensor] = lambda prediction: prediction,
    ) -> list[Tensor]:
        def error(layers: Layers) -> Float[Tensor, "models count"]:
            return ((read(evaluate(layers, x)) - target) ** 2).sum(-1)

        return train(first_layers([x.shape[-1], *self.hidden, outputs], seeds), error, held, self)


@dataclass(frozen=True)
class PostureMLP(_NetworkEstimator):
    """The paper's network with the posture as further input, f(q, dq). Its settings are those of :class:`Training`."""

    def _data(self, exp: xr.Dataset) -> _Lesson:
        return _Lesson.of_displacements(exp, self.held_out, type(self).__name__)

    def _learn(self, lesson: _Lesson, seeds: Sequence[int]) -> Sequence[PostureDisplacement]:
        x, y = lesson.x, lesson.y
        p = x.shape[-1] // 2
        centre, q_spread = _centre_and_spread(x[..., :p])
        dq_spread, dr_spread = _root_mean_square(x[..., p:]), _each_root_mean_square(y)
        shift = torch.cat([centre, torch.zeros_like(centre)], -1)
        scale = torch.cat([q_spread.expand_as(centre), dq_spread.expand_as(centre)], -1)
        layers = self._train(y.shape[-1], (x - shift) / scale, y / dr_spread, lesson.held, seeds)
        _in_units(layers, shift, scale, dr_spread)
        return [PostureDisplacement(_one(layers, index)) for index in range(len(seeds))]


@dataclass(frozen=True)
class JacobianNetwork(_NetworkEstimator):
    """A network that gives the matrix J(q), taught through J(q) dq. Its settings are those of :class:`Training`."""

    def _data(self, exp: xr.Dataset) -> _Lesson:
        return _Lesson.of_displacements(exp, self.held_out, type(self).__name__)

    def _learn(self, lesson: _Lesson, seeds: Sequence[int]) -> Sequence[NetworkJacobian]:
        x, y = lesson.x, lesson.y
        p, m = x.shape[-1] // 2, y.shape[-1]
        q, dq = x[..., :p], x[..., p:]
        centre, q_spread = _centre_and_spread(q)
        dq_spread, dr_spread = _root_mean_square(dq), _each_root_mean_square(y)
        moved = (dq / dq_spread)[..., None, :]

        def through(prediction: Tensor) -> Tensor:
            return (prediction.reshape(*prediction.shape[:-1], m, p) * moved).sum(-1)

        layers = self._train(m * p, (q - centre) / q_spread, y / dr_spread, lesson.held, seeds, through)
        entries = (dr_spread / dq_spread).repeat_interleave(p, -1)
        _in_units(layers, centre, q_spread.expand_as(centre), entries)
        return [NetworkJacobian(_one(layers, index)) for index in range(len(seeds))]


@dataclass(frozen=True)
class ForwardNetwork(_NetworkEstimator):
    """A forward model r(q), differentiated. Its settings are those of :class:`Training`."""

    hidden: tuple[int, ...] = (32,)

    def _data(self, exp: xr.Dataset) -> _Lesson:
        data = samples(exp, type(self).__name__)
        return _Lesson(data.q, data.image, data.held_out(self.held_out), data.unit)

    def _learn(self, lesson: _Lesson, seeds: Sequence[int]) -> Sequence[NetworkImage]:
        x, y = lesson.x, lesson.y
        centre, spread = _centre_and_spread(x)
        mean = y.mean(1, keepdim=True)
        image_spread = _each_root_mean_square(y - mean)
        layers = self._train(y.shape[-1], (x - centre) / spread, (y - mean) / image_spread, lesson.held, seeds)
        _in_units(layers, centre, spread.expand_as(centre), image_spread)
        layers[-1] = layers[-1] + mean[:, 0]
        return [NetworkImage(_one(layers, index)) for index in range(len(seeds))]


def _root_mean_square(x: Float[Tensor, "models count d"]) -> Float[Tensor, "models 1 1"]:
    return (x**2).mean((1, 2), keepdim=True).sqrt()


def _each_root_mean_square(x: Float[Tensor, "models count d"]) -> Float[Tensor, "models 1 d"]:
    """Of each column; one for a column of zeros."""
    size = (x**2).mean(1, keepdim=True).sqrt()
    return torch.where(size > 0, size, 1.0)


def _centre_and_spread(
    q: Float[Tensor, "models count p"],
) -> tuple[Float[Tensor, "models 1 p"], Float[Tensor, "models 1 1"]]:
    centre = q.mean(1, keepdim=True)
    return centre, _root_mean_square(q - centre)


def _in_units(
    layers: list[Tensor],
    shift: Float[Tensor, "models 1 inputs"],
    scale: Float[Tensor, "models 1 inputs"],
    unit: Float[Tensor, "models 1 outputs"],
) -> None:
    """Takes up the scaling of inputs and outputs into the first and last layers."""
    layers[0] = layers[0] / scale
    layers[1] = layers[1] - (layers[0] @ shift.transpose(1, 2))[..., 0]
    layers[-2] = layers[-2] * unit.transpose(1, 2)
    layers[-1] = layers[-1] * unit[:, 0]


def _one(layers: Sequence[Tensor], index: int) -> tuple[Tensor, ...]:
    return tuple(layer[index].contiguous() for layer in layers)
