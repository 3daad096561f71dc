"""Constant Jacobians learned step by step along a recording, as uncalibrated visual servoing does.

What is returned is the Jacobian held at the end of the recording: it knows the last postures best. Trials follow one
another; the estimate is carried over from one to the next.
"""

from __future__ import annotations

import abc
from dataclasses import dataclass

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float

from bodyimage_kin import _checks
from bodyimage_kin.estimators._carry import warn_few
from bodyimage_kin.estimators._samples import pairs, refuse_scattered
from bodyimage_kin.estimators.base import Estimator
from bodyimage_kin.estimators.least_squares import ConstantJacobian

__all__ = ["Broyden", "Kalman", "RecursiveLeastSquares"]

_FORGOTTEN = 1e6
"""Most by which forgetting lets a covariance grow beyond the first: without a bound it grows without end."""


class _Online(Estimator):
    def fit(self, exp: xr.Dataset, seed: int = 0) -> ConstantJacobian:
        """Learns along an experience, keeps the last Jacobian; the seed changes nothing. See :meth:`Estimator.fit`."""
        refuse_scattered(exp, type(self).__name__, "learn by LeastSquares or Ridge, which take every pair at once")
        data = pairs(exp, type(self).__name__)
        warn_few(type(self).__name__, data.dr.numel(), data.dq.shape[1] * data.dr.shape[1])
        return ConstantJacobian(torch.from_numpy(self._follow(data.dq.numpy(), data.dr.numpy())), unit=data.unit)

    @abc.abstractmethod
    def _follow(self, dq: Float[np.ndarray, "steps p"], dr: Float[np.ndarray, "steps m"]) -> Float[np.ndarray, "m p"]:
        """The Jacobian after the last step, begun at zero."""


@dataclass(frozen=True)
class Broyden(_Online):
    """Broyden's rank-one update (Jagersand, Fuentes and Nelson 1997): ``J += gain (dr - J dq) dq' / (dq' dq)``.

    Attributes:
        gain: Share of what a step contradicts that is taken over, up to 1.
        smallest: Steps in which the joints move less are left out [rad].
    """

    gain: float = 0.5
    smallest: float = 1e-6

    def __post_init__(self) -> None:
        _checks.number("gain", self.gain, above=0.0, most=1.0)
        _checks.number("smallest", self.smallest, above=0.0)

    def _follow(self, dq: Float[np.ndarray, "steps p"], dr: Float[np.ndarray, "steps m"]) -> Float[np.ndarray, "m p"]:
        J = np.zeros((dr.shape[1], dq.shape[1]))
        for joints, image in zip(dq, dr, strict=True):
            squared = joints @ joints
            if squared > self.smallest**2:
                J += np.outer(self.gain * (image - J @ joints), joints / squared)
        return J


@dataclass(frozen=True)
class RecursiveLeastSquares(_Online):
    """Least squares whose memory fades (Ljung and Soderstrom 1983).

    Minimises ``sum_t forgetting^(T - t) |dr_t - J dq_t|^2 + forgetting^T |J|^2 / confidence`` step by step. A direction
    in which the joints rest is forgotten at most a million times over: its covariance grows no further.

    Attributes:
        forgetting: Weight of a step after one more, up to 1: 0.98 remembers about fifty steps.
        confidence: First covariance, in units of the image noise's variance [1/rad^2]; large: the zero at which it
            begins counts for little.
    """

    forgetting: float = 0.98
    confidence: float = 1e6

    def __post_init__(self) -> None:
        _checks.number("forgetting", self.forgetting, above=0.0, most=1.0)
        _checks.number("confidence", self.confidence, above=0.0)

    def _follow(self, dq: Float[np.ndarray, "steps p"], dr: Float[np.ndarray, "steps m"]) -> Float[np.ndarray, "m p"]:
        p = dq.shape[1]
        J, P = np.zeros((dr.shape[1], p)), self.confidence * np.eye(p)
        for joints, image in zip(dq, dr, strict=True):
            spread = P @ joints
            gain = spread / (self.forgetting + joints @ spread)
            J += np.outer(image - J @ joints, gain)
            P = (P - np.outer(gain, spread)) / self.forgetting
            P = _bounded((P + P.T) / 2.0, _FORGOTTEN * self.confidence)
        return J


@dataclass(frozen=True)
class Kalman(_Online):
    """A Kalman filter whose state is the Jacobian, a random walk that each step measures (Qian and Su 2002).

    Attributes:
        drift: Standard deviation by which an entry changes from step to step [m/rad].
        image_noise: Standard deviation of a measured displacement of the hand image [m].
        spread: Standard deviation of an entry before the first step [m/rad].
    """

    drift: float = 1e-3
    image_noise: float = 3e-4
    spread: float = 0.1

    def __post_init__(self) -> None:
        _checks.number("drift", self.drift, least=0.0)
        _checks.number("image_noise", self.image_noise, above=0.0)
        _checks.number("spread", self.spread, above=0.0)

    def _follow(self, dq: Float[np.ndarray, "steps p"], dr: Float[np.ndarray, "steps m"]) -> Float[np.ndarray, "m p"]:
        p = dq.shape[1]
        # The rows of J are measured by the same dq with the same noise: one covariance (p, p) serves them all.
        J, P = np.zeros((dr.shape[1], p)), self.spread**2 * np.eye(p)
        for joints, image in zip(dq, dr, strict=True):
            P += self.drift**2 * np.eye(p)
            spread = P @ joints
            gain = spread / (self.image_noise**2 + joints @ spread)
            J += np.outer(image - J @ joints, gain)
            P -= np.outer(gain, spread)
            P = (P + P.T) / 2.0
        return J


def _bounded(P: Float[np.ndarray, "p p"], most: float) -> Float[np.ndarray, "p p"]:
    """The matrix with no eigenvalue above ``most``."""
    values, vectors = np.linalg.eigh(P)
    return (vectors * values.clip(0.0, most)) @ vectors.T if values[-1] > most else P
