"""The truth in an estimator's clothes: what the pipeline makes of a Jacobian without any error."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators.base import Estimator, LearnedJacobian
from bodyimage_kin.recordings import require_aligned

__all__ = ["Analytic", "AnalyticJacobian", "Nominal"]


@dataclass(frozen=True, eq=False)
class AnalyticJacobian(LearnedJacobian):
    """The embodiment's own image Jacobian."""

    body: Embodiment

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return self.body.p

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return self.body.m

    def _displacement(self, q: Float[Tensor, "*batch p"], dq: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return (self.body.hand_image_jacobian(q) @ dq[..., None])[..., 0]

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return torch.as_tensor(self.body.hand_image_jacobian(q))


@dataclass(frozen=True, eq=False)
class Analytic(Estimator):
    """Knows the body: robot, hand and camera. Learns nothing.

    Attributes:
        body: The embodiment whose truth it knows.
    """

    body: Embodiment

    def fit(self, exp: xr.Dataset, seed: int = 0) -> AnalyticJacobian:
        """The analytic Jacobian, whatever the experience shows. See :meth:`Estimator.fit`.

        Raises:
            InvalidRecording: An experience of other joints than the body feels, or in another order.
            UnknownName: A joint that the body does not feel.
        """
        require_aligned(exp, self.body)
        return AnalyticJacobian(self.body, unit=self.body.camera.model.unit)


@dataclass(frozen=True, eq=False)
class Nominal(Estimator):
    """Knows a body as it was drawn, not as it was built, and learns nothing: what calibration begins with.

    Attributes:
        embodiment: That body: the name or the TOML of an embodiment, or the embodiment itself.
    """

    embodiment: str | Embodiment

    def __post_init__(self) -> None:
        if not isinstance(self.embodiment, Embodiment):
            _checks.text("embodiment", self.embodiment)

    def fit(self, exp: xr.Dataset, seed: int = 0) -> AnalyticJacobian:
        """The nominal body's analytic Jacobian, whatever was seen. See :meth:`Estimator.fit`.

        Raises:
            InvalidConfig: There is no such embodiment, or it feels other joints than the experience is of.
        """
        body = load_embodiment(self.embodiment) if isinstance(self.embodiment, str) else self.embodiment
        felt = [str(joint) for joint in exp["joint"].values] if "joint" in exp.coords else list(body.joints)
        if felt != list(body.joints):
            raise InvalidConfig(
                f"embodiment '{body.name}' feels {', '.join(body.joints)}, the experience is of {', '.join(felt)}; "
                "give a body with these joints in this order"
            )
        return AnalyticJacobian(body, unit=body.camera.model.unit)
