"""Several learners of one kind, their mean, and their disagreement (Lakshminarayanan, Pritzel and Blundell 2017)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.estimators._field import Doubt
from bodyimage_kin.estimators._samples import fold_of_each
from bodyimage_kin.estimators.base import Estimator, LearnedJacobian
from bodyimage_kin.recordings import is_scattered

__all__ = ["Ensemble", "EnsembleJacobian"]

_ARCS = 10
_MOST = 10**4
"""Members."""


@dataclass(frozen=True, eq=False)
class EnsembleJacobian(Doubt):
    """The mean of its members; what they disagree on is what the experience leaves open.

    Attributes:
        members: Learned Jacobians.
    """

    members: tuple[LearnedJacobian, ...]

    kind = "ensemble"

    def __post_init__(self) -> None:
        sizes = {(member.m, member.p) for member in self.members}
        if len(sizes) != 1:
            raise InvalidArray(f"an ensemble has members of (m, p) {sorted(sizes)}; give members of one size")

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return self.members[0].p

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return self.members[0].m

    def _displacement(self, q: Float[Tensor, "*batch p"], dq: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return torch.stack([member.displacement(q, dq) for member in self.members]).mean(0)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return torch.stack([member.jacobian(q) for member in self.members]).mean(0)

    def _covariance(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count entries entries"]:
        return _spread(torch.stack([member.jacobian(q).flatten(-2) for member in self.members]))

    def displacement_covariance(self, q: ArrayLike, dq: ArrayLike) -> Float[Tensor, "*batch m m"]:
        """Covariance of the displacements that the members foresee. See :meth:`Uncertain.displacement_covariance`."""
        return _spread(torch.stack([member.displacement(q, dq) for member in self.members]))

    def draws(self, n: int, seed: int = 0) -> tuple[LearnedJacobian, ...]:
        """Members drawn at random, with replacement.

        Args:
            n: How many.
            seed: Same seed, same members.

        Raises:
            InvalidConfig: Not a positive number.
        """
        _checks.whole("n", n, least=1)
        drawn = np.random.default_rng(seed).integers(len(self.members), size=n)
        return tuple(self.members[index] for index in drawn)


def _spread(values: Float[Tensor, "members *batch d"]) -> Float[Tensor, "*batch d d"]:
    """Covariance over the members; of a single one, zero."""
    away = values - values.mean(0)
    return torch.einsum("i...a,i...b->...ab", away, away) / max(1, len(values) - 1)


@dataclass(frozen=True)
class Ensemble(Estimator):
    """Learns several times, with seeds of its own for each member, and averages.

    An estimator that draws nothing at random gives members that are all alike, unless each misses some arcs.

    Attributes:
        spec: The estimator that each member is learned by.
        members: How many, at least 2.
        missing: Share of the experience that each member does not see, others for each (a jackknife): arcs of each
            trial, or blocks, or clusters of scattered postures.
    """

    spec: Estimator
    members: int = 5
    missing: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.spec, Estimator):
            _checks.refuse("spec", self.spec, "an estimator")
        _checks.whole("members", self.members, least=2, most=_MOST)
        _checks.number("missing", self.missing, least=0.0, below=1.0)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> EnsembleJacobian:
        """Learns from an experience; the seed spawns one for each member. See :meth:`Estimator.fit`."""
        streams = np.random.SeedSequence(seed).spawn(self.members)
        experiences = [self._partly(exp, np.random.default_rng(stream)) for stream in streams]
        seeds = [int(stream.generate_state(1)[0]) for stream in streams]
        members = tuple(self.spec.fit_many(experiences, seeds))
        return EnsembleJacobian(members, unit=members[0].unit)

    def _partly(self, exp: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
        """The experience, the hand unseen in some arcs of each trial."""
        hidden = round(self.missing * _ARCS)
        if hidden == 0:
            return exp
        image = exp["hand_image"].copy()
        if is_scattered(exp) or "block" in exp:
            fold = fold_of_each(exp, _ARCS)
            folds = int(fold.max()) + 1
            gone = rng.choice(folds, min(round(self.missing * folds), folds - 1), replace=False)
            return exp.assign(hand_image=image.where(xr.DataArray(~np.isin(fold, gone), dims=("trial", "time"))))
        arc = np.arange(image.sizes["time"]) * _ARCS // image.sizes["time"]
        for trial in range(image.sizes["trial"]):
            image.values[trial, np.isin(arc, rng.choice(_ARCS, hidden, replace=False))] = np.nan
        return exp.assign(hand_image=image)
