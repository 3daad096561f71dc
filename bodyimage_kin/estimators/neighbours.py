"""Jacobians fitted where they are asked for: to the steps nearest in posture, or to all, weighted by nearness."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.spatial
import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.errors import InvalidPosture
from bodyimage_kin.estimators._field import JacobianField
from bodyimage_kin.estimators._hold_out import choose
from bodyimage_kin.estimators._samples import Pairs, pairs
from bodyimage_kin.estimators.base import Estimator
from bodyimage_kin.estimators.ridge import ridge

__all__ = ["LocallyWeighted", "NearestNeighbours", "NeighbourJacobian", "WeightedJacobian"]

_PENALTY = 1e-3
"""Share of the mean squared motion that a local motion needs to overrule the Jacobian of the whole experience."""


@dataclass(frozen=True, eq=False)
class _Local(JacobianField):
    """Remembers every step; each local fit is shrunk towards the constant Jacobian of all of them.

    Attributes:
        q: (steps, p) postures of the steps [rad].
        dq: (steps, p) displacements of the joints [rad].
        residual: (steps, m) displacements of the hand image that the constant Jacobian leaves unexplained [m].
        constant: (m, p) [m/rad].
        penalty: [rad^2 per step].
    """

    q: Float[Tensor, "steps p"]
    dq: Float[Tensor, "steps p"]
    residual: Float[Tensor, "steps m"]
    constant: Float[Tensor, "m p"]
    penalty: float

    def __post_init__(self) -> None:
        _checks.number("penalty", self.penalty, above=0.0)

    @cached_property
    def _products(self) -> Float[Tensor, "steps columns"]:
        """Of each step, dq dq' and dq residual', flat: local fits are weighted means of them."""
        step = torch.cat([self.dq, self.residual], 1)
        return (self.dq[:, :, None] * step[:, None, :]).flatten(1)

    def _solve(self, mean: Float[Tensor, "count columns"]) -> Float[Tensor, "count m p"]:
        mean = mean.reshape(-1, self.p, self.p + self.m)
        gram = mean[..., : self.p] + self.penalty * torch.eye(self.p, dtype=mean.dtype)
        return self.constant.to(mean) + torch.linalg.solve(gram, mean[..., self.p :]).transpose(-1, -2)


@dataclass(frozen=True, eq=False)
class NeighbourJacobian(_Local):
    """The Jacobian of the nearest steps. It jumps where the set of neighbours changes; it has no derivative in q.

    Attributes:
        neighbours: How many.
    """

    neighbours: int

    kind = "neighbours"

    def __post_init__(self) -> None:
        super().__post_init__()
        _checks.whole("neighbours", self.neighbours, least=1, most=len(self.q))

    @cached_property
    def _tree(self) -> scipy.spatial.KDTree:
        return scipy.spatial.KDTree(self.q.numpy())

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        flat = q.detach().reshape(-1, self.p).to(torch.float64).numpy()
        if not np.isfinite(flat).all():
            raise InvalidPosture("posture q has NaN or infinite values; these have no neighbours")
        _, nearest = self._tree.query(flat, k=np.arange(1, self.neighbours + 1))
        mean = torch.nn.functional.embedding_bag(torch.from_numpy(nearest), self._products, mode="mean")
        return self._solve(mean).to(q).reshape(*q.shape[:-1], self.m, self.p)


@dataclass(frozen=True, eq=False)
class WeightedJacobian(_Local):
    """The Jacobian of all steps, each weighted by ``exp(-|q - q_i|^2 / (2 bandwidth^2))``.

    Attributes:
        bandwidth: [rad].
    """

    bandwidth: float

    kind = "locally_weighted"

    def __post_init__(self) -> None:
        super().__post_init__()
        _checks.number("bandwidth", self.bandwidth, above=0.0)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        flat = q.reshape(-1, self.p).to(torch.float64)
        # |q - q_i|^2 less |q|^2, which all weights of a posture share. A softmax: far away the nearest steps decide.
        centred, seen = flat - self.q.mean(0), self.q - self.q.mean(0)
        nearness = (centred @ seen.T - 0.5 * (seen**2).sum(1)) / self.bandwidth**2
        mean = torch.softmax(nearness, -1) @ self._products
        return self._solve(mean).to(q).reshape(*q.shape[:-1], self.m, self.p)


def _remember(data: Pairs, penalty: float) -> tuple[Tensor, Tensor, Tensor, Tensor, float]:
    """What :class:`_Local` keeps of an experience."""
    scale = penalty * float((data.dq**2).sum(1).mean()) / data.dq.shape[1]
    constant = ridge(data.dq, data.dr, torch.tensor([scale], dtype=data.dq.dtype))[0].T.contiguous()
    return data.q, data.dq, data.dr - data.dq @ constant.T, constant, scale


def _check_penalty(penalty: float) -> None:
    _checks.number("penalty", penalty, above=0.0)


@dataclass(frozen=True)
class NearestNeighbours(Estimator):
    """Ridge regression on the k steps nearest in posture, shrunk towards the Jacobian of all steps.

    Attributes:
        neighbours: k; all steps when there are fewer.
        penalty: Share of the mean squared motion of a joint that a local motion needs to overrule the Jacobian of all.
    """

    neighbours: int = 30
    penalty: float = _PENALTY

    def __post_init__(self) -> None:
        _checks.whole("neighbours", self.neighbours, least=1)
        _check_penalty(self.penalty)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> NeighbourJacobian:
        """Learns from an experience; the seed changes nothing. See :meth:`Estimator.fit`."""
        data = pairs(exp, type(self).__name__)
        return NeighbourJacobian(*_remember(data, self.penalty), min(self.neighbours, len(data.q)), unit=data.unit)


@dataclass(frozen=True)
class LocallyWeighted(Estimator):
    """Locally weighted regression (Atkeson, Moore and Schaal 1997), the weights Gaussian in posture.

    Attributes:
        bandwidth: Standard deviation of the weights [rad]; None: the best of twelve on what is held out.
        penalty: As in :class:`NearestNeighbours`.
        folds: Number of parts of the experience, each held out once to choose the bandwidth.
    """

    bandwidth: float | None = None
    penalty: float = _PENALTY
    folds: int = 5

    def __post_init__(self) -> None:
        if self.bandwidth is not None:
            _checks.number("bandwidth", self.bandwidth, above=0.0)
        _check_penalty(self.penalty)
        _checks.whole("folds", self.folds, least=2)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> WeightedJacobian:
        """Learns from an experience; the seed changes nothing. See :meth:`Estimator.fit`."""
        data = pairs(exp, type(self).__name__)
        bandwidth = self.bandwidth
        if bandwidth is None:
            spread = float((data.q - data.q.mean(0)).pow(2).sum(1).mean().sqrt())
            candidates = [spread * 2.0**power for power in np.arange(-4.0, 2.0, 0.5)]

            def errors(learn: Pairs, predict: Pairs) -> Tensor:
                fitted = [WeightedJacobian(*_remember(learn, self.penalty), width) for width in candidates]
                wrong = [one._displacement(predict.q, predict.dq) - predict.dr for one in fitted]
                return torch.stack([(one**2).sum() for one in wrong])

            bandwidth = candidates[choose(errors, data.folds(self.folds))]
        return WeightedJacobian(*_remember(data, self.penalty), bandwidth, unit=data.unit)
