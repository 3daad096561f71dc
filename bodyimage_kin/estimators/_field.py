"""Learned Jacobians that depend on the posture and are linear in the displacement of the joints, and their doubt."""

from __future__ import annotations

import abc
from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike, as_postures
from bodyimage_kin.estimators.base import LearnedJacobian

_AT_ONCE = 1 << 24
"""Numbers that covariances hold in between at most."""


@dataclass(frozen=True, eq=False)
class JacobianField(LearnedJacobian):
    """A Jacobian at each posture; the displacement of the hand image is ``J(q) dq``."""

    def _displacement(self, q: Float[Tensor, "*batch p"], dq: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return (self._jacobian(q) @ dq.to(q)[..., None])[..., 0]

    @abc.abstractmethod
    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        """The Jacobian, for checked postures."""


@dataclass(frozen=True, eq=False)
class ImageModel(JacobianField):
    """A learned map r(q) from posture to hand image, and the Jacobian that is its derivative."""

    def hand_image(self, q: ArrayLike) -> Float[Tensor, "*batch m"]:
        """The hand image that is predicted, in its unit.

        Args:
            q: Postures ``(*batch, p)`` [rad or m].

        Raises:
            InvalidPosture: A last axis that is not of p joints.
        """
        return self._image(as_postures(q, self.p))

    @abc.abstractmethod
    def _image(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        """The hand image, for checked postures."""


class Doubt(LearnedJacobian):
    """Knows how sure it is of its Jacobian: a covariance at each posture."""

    def covariance(self, q: ArrayLike) -> Float[Tensor, "*batch entries entries"]:
        """Covariance of the Jacobian's entries, row by row: entry ``axis * p + joint``, ``(*batch, m p, m p)``.

        It is the doubt about the function at one posture: no noise of any observation is in it. In the unit of the hand
        image over rad or m, squared.

        Args:
            q: Postures ``(*batch, p)`` [rad or m].

        Raises:
            InvalidPosture: A last axis that is not of p joints.
        """
        q = as_postures(q, self.p)
        entries = self.m * self.p
        found = self._covariance(q.reshape(-1, self.p).to(torch.float64))
        return found.to(q).reshape(*q.shape[:-1], entries, entries)

    def displacement_covariance(self, q: ArrayLike, dq: ArrayLike) -> Float[Tensor, "*batch m m"]:
        """Covariance of the displacement of the hand image that ``J(q) dq`` foresees, ``(*batch, m, m)``.

        Args:
            q: Postures ``(*batch, p)`` [rad or m].
            dq: Displacements of the joints ``(*batch, p)`` [rad or m].

        Raises:
            InvalidPosture: A last axis that is not of p joints.
        """
        q, dq = as_postures(q, self.p), as_postures(dq, self.p, "displacement dq")
        of_entries = self.covariance(q).reshape(*q.shape[:-1], self.m, self.p, self.m, self.p)
        step = dq.to(of_entries)
        return torch.einsum("...k,...akbl,...l->...ab", step, of_entries, step)

    @abc.abstractmethod
    def _covariance(self, q: Float[Tensor, "count p"]) -> Float[Tensor, "count entries entries"]:
        """The covariance, for checked postures in float64."""


def of_each_axis(
    noise: Float[Tensor, "m"], one: Float[Tensor, "*batch p p"]
) -> Float[Tensor, "*batch entries entries"]:
    """Covariance of a Jacobian whose rows are independent, each with ``one`` times its squared noise."""
    m, p = len(noise), one.shape[-1]
    return torch.einsum("ab,a,...kl->...akbl", torch.eye(m, dtype=one.dtype), noise.to(one) ** 2, one).reshape(
        *one.shape[:-2], m * p, m * p
    )


def in_parts(of: Callable[[Tensor], Tensor], q: Float[Tensor, "count p"], numbers: int) -> Tensor:
    """What a function makes of postures, a few at once where each needs many numbers in between."""
    size = max(1, _AT_ONCE // max(1, numbers))
    return torch.cat([of(part) for part in torch.split(q, size)]) if len(q) > size else of(q)
