"""What may be known before touching, and what a predictor makes of it.

The image of the touching hand is not among it, and cannot be: a predictor is given the experience of the seen motion
and the joints felt while touching, nothing else of that recording.
"""

from __future__ import annotations

import abc
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float, Int
from torch import Tensor

from bodyimage_kin import _checks, metrics
from bodyimage_kin._arrays import ArrayLike, as_postures
from bodyimage_kin.errors import InvalidConfig, InvalidPosture
from bodyimage_kin.estimators import Estimator, LearnedJacobian
from bodyimage_kin.recordings import experience

__all__ = ["Foresight", "Known", "PlausibleTruths", "Predictor"]


@dataclass(frozen=True, eq=False)
class Known:
    """All that a predictor may see. Make one with :meth:`of`.

    Attributes:
        experience: Of the seen motion.
        postures: (postures, p) felt in touching, spread evenly over it [rad].
        samples: (postures,) which samples of touching they are, all trials in a row.
        steps: (steps, p) felt displacements of the joints in one sampling step of touching [rad].
        estimator: Whose error is to be foretold.
        seed: Of what estimator and predictor draw at random.
    """

    experience: xr.Dataset
    postures: Float[Tensor, "postures p"]
    samples: Int[np.ndarray, "postures"]
    steps: Float[np.ndarray, "steps p"]
    estimator: Estimator
    seed: int
    _learned: dict[Estimator, LearnedJacobian] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls,
        seen: xr.Dataset,
        touch_q: ArrayLike,
        estimator: Estimator,
        seed: int = 0,
        most: int = 200,
        learned: LearnedJacobian | None = None,
    ) -> Known:
        """What is known once the arm has felt itself touch.

        Args:
            seen: Recording or experience of the seen motion; its truth, if any, is dropped here.
            touch_q: Felt postures of the touch motion in order of time, (*trials, time, p) [rad]; NaN where padded.
            estimator: Whose error is to be foretold.
            seed: Of whatever is drawn at random.
            most: Most postures of touching at which Jacobians are compared.
            learned: What the estimator learned from the experience, where that is known already.

        Raises:
            InvalidRecording: Not a recording.
            InvalidPosture: Touch postures of another number of joints, fewer than two in a row, or none that moves.
            InvalidConfig: Not an estimator, or not a positive number of postures.
        """
        exp = experience(seen)
        if not isinstance(estimator, Estimator):
            _checks.refuse("estimator", estimator, "an estimator such as LeastSquares()")
        _checks.whole("most", most, least=1)
        _checks.whole("seed", seed, least=0)
        q = as_postures(touch_q, exp.sizes["joint"], "touch_q").detach().to(torch.float64)
        if q.ndim < 2:
            raise InvalidPosture(f"touch_q has shape {tuple(q.shape)}; give (*trials, time, p), postures in order")
        steps = q.diff(dim=-2).reshape(-1, q.shape[-1])
        steps = steps[steps.isfinite().all(-1)]
        if not bool(steps.any()):
            raise InvalidPosture("touch_q has no two successive postures between which a joint moves; record a motion")
        rows = q.reshape(-1, q.shape[-1])
        there = np.flatnonzero(rows.isfinite().all(-1).numpy())
        kept = there[np.linspace(0, len(there) - 1, min(most, len(there))).round().astype(int)]
        known = cls(exp, rows[torch.from_numpy(kept)], kept, steps.numpy(), estimator, seed)
        if learned is not None:
            known._learned[estimator] = learned
        return known

    @cached_property
    def metric(self) -> Float[np.ndarray, "p p"]:
        """The metric of the touch motion as it is felt [rad^2]."""
        return metrics.motion_metric(self.steps)

    @cached_property
    def seen_postures(self) -> Float[np.ndarray, "samples p"]:
        """Felt postures of the seen motion [rad]."""
        q = np.asarray(self.experience["q"].values, dtype=np.float64)
        q = q.reshape(-1, q.shape[-1])
        return q[np.isfinite(q).all(1)]

    @cached_property
    def seen_steps(self) -> Float[np.ndarray, "steps p"]:
        """Felt displacements of the joints in one sampling step of the seen motion [rad]."""
        steps = np.diff(np.asarray(self.experience["q"].values, dtype=np.float64), axis=1)
        steps = steps.reshape(-1, steps.shape[-1])
        return steps[np.isfinite(steps).all(1)]

    def learn(self, spec: Estimator) -> LearnedJacobian:
        """What a spec learns from the experience; learned once."""
        if spec not in self._learned:
            self._learned[spec] = spec.fit(self.experience, self.seed)
        return self._learned[spec]

    @property
    def learned(self) -> LearnedJacobian:
        """What the estimator learns from the experience: the Jacobian whose error is to be foretold."""
        return self.learn(self.estimator)

    @cached_property
    def estimated(self) -> Float[np.ndarray, "postures m p"]:
        """Its Jacobian at :attr:`postures` [m/rad]."""
        return self.learned.jacobian(self.postures).detach().numpy()


@dataclass(frozen=True, eq=False)
class Foresight:
    """What a predictor says of one recording.

    Attributes:
        error: The relative error in the touch motion's metric over all postures
            (:func:`bodyimage_kin.metrics.pooled_relative_error`); for a predictor that is not absolute, a positive
            number that grows with it.
        by_posture: (postures,) the same of each posture; None where the predictor cannot tell them apart.
    """

    error: float
    by_posture: Float[np.ndarray, "postures"] | None


class Predictor(abc.ABC):
    """A frozen spec that foretells the error of a learned Jacobian on the face, from what is known before touching.

    Attributes:
        assumes: What it is told beside the experience and the felt touch motion.
        absolute: Whether it foretells the relative error itself, and not only something that grows with it.
    """

    assumes: ClassVar[str]
    absolute: ClassVar[bool]

    @abc.abstractmethod
    def foresee(self, known: Known) -> Foresight:
        """What it says; pure: the same knowledge, the same bits."""

    def predict(self, known: Known) -> float:
        """The foretold error over all postures (:attr:`Foresight.error`)."""
        return self.foresee(known).error

    def predict_by_posture(self, known: Known) -> Float[np.ndarray, "postures"]:
        """The foretold error of each posture of touching.

        Raises:
            InvalidConfig: A predictor that cannot tell postures apart.
        """
        found = self.foresee(known).by_posture
        if found is None:
            raise InvalidConfig(f"{type(self).__name__} foretells no error of single postures; use predict")
        return found


class PlausibleTruths(Predictor):
    """Foretells by standing plausible truths in for the unknown one."""

    absolute = True

    @abc.abstractmethod
    def truths(
        self, known: Known
    ) -> tuple[Float[np.ndarray, "truths postures m p"], Float[np.ndarray, "truths postures m p"]]:
        """Jacobians at the postures of touching: each plausible truth, and what is learned where it holds [m/rad]."""

    def foresee(self, known: Known) -> Foresight:
        """Root of the expected squared error over the root of the expected squared size of the truth."""
        true, estimated = self.truths(known)
        by_truth = [metrics.relative_error(J, Jh, known.metric) for J, Jh in zip(true, estimated, strict=True)]
        sizes = [np.einsum("nij,jk,nik->n", J, known.metric, J) for J in true]
        squared = np.mean([size * one**2 for size, one in zip(sizes, by_truth, strict=True)], axis=0)
        by_posture = np.sqrt(squared / np.mean(sizes, axis=0))
        return Foresight(metrics.pooled_relative_error(true, estimated, known.metric), by_posture)
