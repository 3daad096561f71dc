"""Learned Jacobians that depend on the posture and are linear in the displacement of the joints."""

from __future__ import annotations

import abc

from jaxtyping import Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike, as_postures
from bodyimage_kin.estimators.base import LearnedJacobian


class JacobianField(LearnedJacobian):
    """A Jacobian at each posture; the displacement of the hand image is ``J(q) dq``."""

    def _displacement(self, q: Float[Tensor, "*batch p"], dq: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return (self._jacobian(q) @ dq.to(q)[..., None])[..., 0]

    @abc.abstractmethod
    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        """The Jacobian, for checked postures."""


class ImageModel(JacobianField):
    """A learned map r(q) from posture to hand image, and the Jacobian that is its derivative."""

    def hand_image(self, q: ArrayLike) -> Float[Tensor, "*batch m"]:
        """The hand image that is predicted [m on the screen].

        Args:
            q: Postures ``(*batch, p)`` [rad].

        Raises:
            InvalidPosture: A last axis that is not of p joints.
        """
        return self._image(as_postures(q, self.p))

    @abc.abstractmethod
    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        """The hand image, for checked postures."""
