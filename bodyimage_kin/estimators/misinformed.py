"""Who knows a body knows it as it was drawn: in simulation, that body must be made to be off."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
import xarray as xr

from bodyimage_kin import _checks
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators.base import Estimator, LearnedJacobian
from bodyimage_kin.estimators.parametric import Mount, ParametricBody, spread_of
from bodyimage_kin.recordings import experience

__all__ = ["Misinformed"]

_TRIES = 1000


@dataclass(frozen=True, eq=False)
class Misinformed(Estimator):
    """Tells an estimator that knows a body of one whose measures are off, drawn anew for each fit.

    A study gives whoever wants a body the one that is studied, which is the truth. That is right for
    :class:`~bodyimage_kin.estimators.Analytic`; a self-calibration would begin at what it is to find. Within
    this, an ``Analytic`` is the nominal body of which nothing is learned, and a ``SelfCalibration`` corrects it. The
    same seed misinforms both alike. A body that would not see the hand where it was seen is drawn again, for
    its owner would know.

    Attributes:
        spec: The estimator. It has a field ``body``.
        axis_spread: Standard deviation of an axis' tilt in each of two directions [rad].
        offset_spread: Standard deviation of a joint's origin in each direction [m].
        hand_spread: Standard deviation of the hand's place on its link, in each direction [m].
    """

    spec: Estimator
    axis_spread: float = 0.05
    offset_spread: float = 0.005
    hand_spread: float = 0.005

    def __post_init__(self) -> None:
        for name in ("axis_spread", "offset_spread", "hand_spread"):
            _checks.number(name, getattr(self, name), least=0.0)
        if not hasattr(self.spec, "body"):
            raise InvalidConfig(
                f"{type(self.spec).__name__} knows no body of which it could be misinformed; give one that does, "
                "such as Analytic or SelfCalibration"
            )

    def fit(self, exp: xr.Dataset, seed: int = 0) -> LearnedJacobian:
        """What is learned by one who was told of the wrong body. See :meth:`Estimator.fit`.

        Raises:
            InvalidConfig: Spreads of which hardly any body sees the hand where it was seen.
        """
        told = self.told(self.spec.body, exp, seed)  # type: ignore[attr-defined]
        return replace(self.spec, body=told).fit(exp, seed)  # type: ignore[type-var]

    def told(self, body: Embodiment, exp: xr.Dataset, seed: int = 0) -> Embodiment:
        """The wrong body.

        Args:
            body: The true one.
            exp: What was seen of the true one: an experience.
            seed: Of the drawing.

        Raises:
            InvalidConfig: As :meth:`fit`.
        """
        seen = experience(exp)
        felt, image = seen["q"].values.reshape(-1, body.p), seen["hand_image"].values.reshape(-1, body.m)
        q = felt[np.isfinite(image).all(1) & np.isfinite(felt).all(1)]
        hand = Mount("hand", "hand", body.hand.link, np.eye(4))
        camera = Mount("camera", "camera", body.camera.link, body.camera.link_T_camera.numpy())
        parametric = ParametricBody(body.felt_robot, body.joints, [camera, hand])
        spreads = self.axis_spread, self.offset_spread, self.hand_spread
        spread = np.array([spread_of(one, *spreads, held=0.0) for one in parametric.parameters])
        rng = np.random.default_rng(np.random.SeedSequence(seed))
        for _ in range(_TRIES):
            wrong = parametric.body_at(body, spread * rng.standard_normal(len(spread)))
            if bool(torch.isfinite(torch.as_tensor(wrong.hand_image(q, on_invisible="nan"))).all()):
                return wrong
        raise InvalidConfig(
            f"axis_spread={self.axis_spread!r}, offset_spread={self.offset_spread!r}, hand_spread="
            f"{self.hand_spread!r}: of {_TRIES} bodies drawn none sees the hand where it was seen; give smaller spreads"
        )
