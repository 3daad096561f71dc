"""A doubt that is right as often as it says, around any estimator: split conformal prediction.

Part of the experience, whole blocks of it, is kept from the estimator. What it foretells of these displacements is held
against what was seen there, and the doubt is scaled until so many of them lie within it (Vovk, Gammerman and Shafer
2005; Lei et al. 2018). It promises as much for displacements like those kept back, and for no others: on motions out of
sight it may fail, as every promise made in sight may.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.stats
import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.estimators._field import Doubt, of_each_axis
from bodyimage_kin.estimators._hold_out import ARCS
from bodyimage_kin.estimators._samples import Pairs, fold_of_each, pairs
from bodyimage_kin.estimators.base import Estimator, LearnedJacobian, Uncertain

__all__ = ["Conformal", "ConformalJacobian"]

_LEAST = 1e-12
"""Share of the displacements' variance that is doubted at least."""


@dataclass(frozen=True, eq=False)
class ConformalJacobian(Doubt):
    """A learned Jacobian whose doubt is scaled to what it got wrong on displacements it had not learned from.

    The region ``(dr - displacement)' displacement_covariance^-1 (dr - displacement) <= chi2`` holds a displacement
    like those with a probability of at least ``level``, chi2 being that quantile with m degrees of freedom.

    Attributes:
        learned: What was learned.
        level: Of the region.
        factor: By which covariances are multiplied.
        axes: (m,) standard deviation of each axis for a step of unit size, in the unit of the hand image; taken where
            ``learned`` has no covariance of its own.
        joints: (p,) size of a step of each joint [rad or m].
    """

    learned: LearnedJacobian
    level: float
    factor: float
    axes: Float[Tensor, "m"]
    joints: Float[Tensor, "p"]

    kind = "conformal"

    def __post_init__(self) -> None:
        _checks.number("level", self.level, above=0.0, below=1.0)
        _checks.number("factor", self.factor, least=0.0)

    def _displacement(self, q: Float[Tensor, "*batch p"], dq: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return self.learned.displacement(q, dq)

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return self.learned.jacobian(q)

    def _covariance(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count entries entries"]:
        return self.factor * _own_covariance(self.learned, q, self.axes, self.joints)

    def displacement_covariance(self, q: ArrayLike, dq: ArrayLike) -> Float[Tensor, "*batch m m"]:
        """Covariance of the displacement that is foreseen. See :meth:`Uncertain.displacement_covariance`."""
        if isinstance(self.learned, Uncertain):
            return self.factor * self.learned.displacement_covariance(q, dq)
        return super().displacement_covariance(q, dq)


@dataclass(frozen=True)
class Conformal(Estimator):
    """Learns by another estimator from part of the experience, and scales its doubt on the rest.

    Where that estimator knows no doubt, it is taken to grow with the size of a step, joints over their spread.

    Attributes:
        spec: The estimator.
        level: Probability with which a displacement is to lie within the doubt.
        share: Of the experience that is kept for this: arcs of a stream, blocks, or clusters of scattered postures.
    """

    spec: Estimator
    level: float = 0.9
    share: float = 0.3

    def __post_init__(self) -> None:
        if not isinstance(self.spec, Estimator):
            _checks.refuse("spec", self.spec, "an estimator")
        _checks.number("level", self.level, above=0.0, below=1.0)
        _checks.number("share", self.share, above=0.0, most=0.5)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> ConformalJacobian:
        """Learns from an experience; the seed is the estimator's. See :meth:`Estimator.fit`.

        Raises:
            InvalidRecording: Nothing to learn from, or too few displacements kept back to tell the level.
        """
        pairs(exp)  # what the experience lacks as a whole is said of the whole
        seen, kept = self._split(exp)
        learned = self.spec.fit(seen, seed)
        data, judged = pairs(seen), pairs(kept)
        joints = (data.dq**2).mean(0).sqrt()
        joints = torch.where(joints > 0, joints, 1.0)
        wrong = (data.dr - learned.displacement(data.q, data.dq).detach()) ** 2
        size = ((data.dq / joints) ** 2).sum(1, keepdim=True).clamp(min=1e-300)
        axes = ((wrong / size).mean(0) + _LEAST * (data.dr**2).mean(0)).clamp(min=1e-300).sqrt()
        factor = self._factor(learned, judged, axes, joints)
        return ConformalJacobian(learned, self.level, factor, axes, joints, unit=learned.unit)

    def _split(self, exp: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
        """The experience with the hand seen in what is learned from alone, and in the rest alone."""
        fold = fold_of_each(exp, ARCS)
        folds = int(fold.max()) + 1
        if folds < 2:
            raise InvalidRecording("a single block cannot be divided; record more, or name smaller blocks")
        wanted = min(max(1, round(self.share * folds)), folds - 1)
        back = np.isin(fold, ((np.arange(wanted) + 0.5) * folds / wanted).astype(int))
        image = exp["hand_image"]
        seen, kept = (
            exp.assign(hand_image=image.where(xr.DataArray(there, dims=("trial", "time")))) for there in (~back, back)
        )
        return seen, kept

    def _factor(
        self, learned: LearnedJacobian, judged: Pairs, axes: Float[Tensor, "m"], joints: Float[Tensor, "p"]
    ) -> float:
        """What brings so many of the displacements kept back within the doubt."""
        count, m = len(judged.dq), judged.dr.shape[1]
        rank = math.ceil((count + 1) * self.level)
        if rank > count:
            raise InvalidRecording(
                f"{count} displacements kept back cannot tell a level of {self.level:g}; record more, or give a lower "
                "level"
            )
        bare = ConformalJacobian(learned, self.level, 1.0, axes, joints)
        with torch.no_grad():
            away = judged.dr - learned.displacement(judged.q, judged.dq)
            doubt = bare.displacement_covariance(judged.q, judged.dq)
            doubt = doubt + torch.diag(_LEAST * (judged.dr**2).mean(0).clamp(min=1e-300))
            squared = (away * torch.linalg.solve(doubt, away[..., None])[..., 0]).sum(-1)
        return float(squared.sort().values[rank - 1]) / float(scipy.stats.chi2.ppf(self.level, m))


def _own_covariance(
    learned: LearnedJacobian, q: Float[Tensor, "count p"], axes: Float[Tensor, "m"], joints: Float[Tensor, "p"]
) -> Float[Tensor, "count entries entries"]:
    """That of what was learned, or one that grows with the size of a step."""
    if isinstance(learned, Uncertain):
        found: Tensor = learned.covariance(q)
        return found
    one = of_each_axis(axes, torch.diag(joints**-2))
    return one.expand(len(q), *one.shape)
