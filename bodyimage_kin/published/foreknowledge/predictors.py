"""Predictors that know no body: from how far touching is from what was seen, and from what the experience leaves open.

Those that know the body's structure are in :mod:`bodyimage_kin.published.foreknowledge.arms`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from bodyimage_kin import _checks, metrics
from bodyimage_kin.estimators import Drawn, GaussianProcess
from bodyimage_kin.metrics.probes import spread_root
from bodyimage_kin.published.foreknowledge.known import Foresight, Known, PlausibleTruths, Predictor

__all__ = ["ExcitationDeficit", "GaussianProcessPosterior", "MeanPostureDistance"]


@dataclass(frozen=True)
class MeanPostureDistance(Predictor):
    """How far the mean posture of touching is from that of the seen motion; each posture, from the latter.

    Attributes:
        unit: ``"radian"``: Euclidean, joints in radians. ``"seen"``: Mahalanobis, in standard deviations of the seen
            postures (1e-6 of their mean variance added). ``"use"``: in root mean square steps of touching.
    """

    unit: Literal["radian", "seen", "use"] | str = "radian"

    assumes = "nothing of the body; its scale is learned from conditions in which the error was measured"
    absolute = False

    def __post_init__(self) -> None:
        units = ("radian", "seen", "use")
        _checks.choice("unit", self.unit, units)

    def foresee(self, known: Known) -> Foresight:
        """See the class; no Jacobian is looked at."""
        seen, touching = known.seen_postures, known.postures.numpy()
        away = np.vstack([touching.mean(0), touching]) - seen.mean(0)
        distance = np.linalg.norm(np.linalg.solve(self._scale(known), away.T), axis=0)
        return Foresight(float(distance[0]), distance[1:])

    def _scale(self, known: Known) -> Float[np.ndarray, "p p"]:
        """A root of the covariance that distances are counted in."""
        if self.unit == "radian":
            return np.eye(known.seen_postures.shape[1])
        if self.unit == "use":
            return np.linalg.cholesky(known.metric)
        return spread_root(known.seen_postures)


@dataclass(frozen=True)
class ExcitationDeficit(Predictor):
    """How little the seen motion excites what touching uses: mean of ``1 / (1 + mu)`` over the directions of motion.

    A control: excitation is what system identification would look at first, and it says nothing of the distance.
    """

    assumes = "nothing of the body; its scale is learned from conditions in which the error was measured"
    absolute = False

    def foresee(self, known: Known) -> Foresight:
        """See the class; it has nothing to say of single postures."""
        mu = metrics.excitation(known.seen_steps, known.steps).eigenvalues
        return Foresight(float(np.mean(1.0 / (1.0 + mu))), None)


@dataclass(frozen=True)
class GaussianProcessPosterior(PlausibleTruths):
    """Holds the learned Jacobian against those of functions drawn from a Gaussian process that saw the same.

    Attributes:
        kernel: Of :class:`bodyimage_kin.estimators.GaussianProcess`.
        draws: Number of functions.
        most: Most samples that the process sees.
    """

    kernel: Literal["trigonometric", "radial"] | str = "trigonometric"
    draws: int = 16
    most: int = 200

    assumes = "that the hand image is a function drawn from a Gaussian process, whose settings the experience chooses"

    def __post_init__(self) -> None:
        self._process()
        _checks.whole("draws", self.draws, least=1)

    def truths(
        self, known: Known
    ) -> tuple[Float[np.ndarray, "truths postures m p"], Float[np.ndarray, "truths postures m p"]]:
        """One a function; the same is learned in all, for all explain what was seen."""
        process = known.learn(self._process())
        assert isinstance(process, Drawn)
        functions = process.draws(self.draws, known.seed)
        drawn = np.stack([one.jacobian(known.postures).detach().numpy() for one in functions])
        return drawn, np.broadcast_to(known.estimated, drawn.shape)

    def _process(self) -> GaussianProcess:
        return GaussianProcess(kernel=self.kernel, most=self.most)
