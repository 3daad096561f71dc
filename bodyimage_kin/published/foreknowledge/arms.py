"""Predictors that know the body's structure: which joints stand between eye and hand, and roughly where.

Neither is told the truth. Arms of an ensemble stand about a nominal arm that is itself as wrong as they are; a
calibrated arm is found from what was seen.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators import SelfCalibration
from bodyimage_kin.estimators.chain import Chain
from bodyimage_kin.estimators.self_calibration import CalibratedChain
from bodyimage_kin.published.foreknowledge.known import Known, PlausibleTruths

__all__ = ["CalibratedArm", "PerturbedArms", "check_body"]

_NEAREST = 0.5
"""Depth below which no hand can come, in screen distances: an arm on which it does is drawn again."""
_TRIES = 1000
"""Arms that are drawn at most for each one wanted."""


@dataclass(frozen=True, eq=False)
class PerturbedArms(PlausibleTruths):
    """An ensemble of arms like the nominal one: each plays the felt motion, teaches the estimator, and tells its error.

    Each arm's images of the seen motion teach the same estimator; what it learns is held against that arm's own
    Jacobian at the postures of touching. The error foretold is the root mean square of the arms' relative errors, all
    arms of one weight. It costs as many fits as there are arms.

    Attributes:
        body: Whose structure is known.
        arms: How many.
        axis_spread: Standard deviation of what is added to each component of a unit axis.
        offset_spread: Standard deviation of what is added to each component of an offset [m]; camera to first joint and
            last joint to hand are among them.
        nominal_error: How wrong the nominal arm is, in these spreads: it is drawn about the body once a seed, and the
            arms about it. 0: the nominal arm is the true one.
        encoder_noise: Declared standard deviation of the noise on felt joint values [rad].
        image_noise: Declared standard deviation of the noise on the felt hand image [m].
    """

    body: Embodiment
    arms: int = 8
    axis_spread: float = 0.05
    offset_spread: float = 0.005
    nominal_error: float = 1.0
    encoder_noise: float = 0.0
    image_noise: float = 0.0

    assumes = (
        "the arm's structure, a nominal arm drawn as far from the true one as the arms from it, the screen distance, "
        "the sensors' noise, and that no hand comes nearer than half the screen distance"
    )

    def __post_init__(self) -> None:
        _checks.whole("arms", self.arms, least=1)
        for name in ("axis_spread", "offset_spread", "nominal_error", "encoder_noise", "image_noise"):
            _checks.number(name, getattr(self, name), least=0.0)

    def truths(
        self, known: Known
    ) -> tuple[Float[np.ndarray, "truths postures m p"], Float[np.ndarray, "truths postures m p"]]:
        """One an arm; its Jacobians are of unit mean square, so that all arms weigh the same."""
        check_body(self.body, known)
        streams = np.random.SeedSequence(known.seed).spawn(self.arms + 1)
        drawn = self._draw(known, np.random.default_rng(streams[0]))
        arms = [next(drawn) for _ in range(self.arms)]
        rngs = [np.random.default_rng(stream) for stream in streams[1:]]
        experiences = [self._play(known, arm, rng) for arm, rng in zip(arms, rngs, strict=True)]
        all_learned = known.estimator.fit_many(experiences, [int(rng.integers(2**32)) for rng in rngs])
        true = np.stack([arm.jacobian(known.postures).numpy() for arm in arms])
        estimated = np.stack([learned.jacobian(known.postures).detach().numpy() for learned in all_learned])
        size = np.sqrt(np.einsum("anij,jk,anik->a", true, known.metric, true) / true.shape[1])[:, None, None, None]
        return true / size, estimated / size

    def _draw(self, known: Known, rng: np.random.Generator) -> Iterator[CalibratedChain]:
        """Arms about a nominal one, of which the hand stays before the eye.

        Raises:
            InvalidConfig: Spreads that hardly any such arm comes of.
        """
        body = Chain.of(self.body)
        axes = body.axes / body.axes.norm(dim=1, keepdim=True)
        geometry = replace(body, axes=axes).geometry
        spread = torch.full_like(geometry, self.offset_spread)
        spread[: axes.numel()] = self.axis_spread
        q = torch.cat([known.postures, torch.from_numpy(known.seen_postures)])

        def about(centre: Tensor, wide: Tensor) -> Tensor:
            for _ in range(_TRIES):
                drawn = centre + wide * torch.from_numpy(rng.standard_normal(len(centre)))
                if bool((body.with_geometry(drawn).point(q)[:, 2] >= _NEAREST * body.screen_distance).all()):
                    return drawn
            raise InvalidConfig(
                f"axis_spread={self.axis_spread!r}, offset_spread={self.offset_spread!r}: of {_TRIES} arms drawn, none "
                "keeps the hand before the eye; give smaller spreads"
            )

        nominal = about(geometry, self.nominal_error * spread)
        while True:
            yield CalibratedChain(body.with_geometry(about(nominal, spread)))

    def _play(self, known: Known, arm: CalibratedChain, rng: np.random.Generator) -> xr.Dataset:
        """The experience as this arm would have had it: the same joints felt, its own images where one was seen."""
        felt, image = known.experience["q"], known.experience["hand_image"]
        # What was felt is what was, and noise: the arm was where the noise is taken off again.
        q = np.nan_to_num(felt.values) - self.encoder_noise * rng.standard_normal(felt.shape)
        seen = arm.hand_image(q).numpy() + self.image_noise * rng.standard_normal(image.shape)
        return known.experience.assign(hand_image=image.copy(data=np.where(np.isfinite(image.values), seen, np.nan)))


@dataclass(frozen=True, eq=False)
class CalibratedArm(PlausibleTruths):
    """One arm, found from the experience by self-calibration, that the learned Jacobian is held against.

    Attributes:
        body: Whose structure is known.
        starts: Of :class:`bodyimage_kin.estimators.SelfCalibration`.
        axis_spread: Likewise.
        offset_spread: Likewise [m].
    """

    body: Embodiment
    starts: int = 3
    axis_spread: float = 0.05
    offset_spread: float = 0.005

    assumes = (
        "the arm's structure, its measures roughly (starts of the fit are drawn about them) and the screen distance"
    )

    def __post_init__(self) -> None:
        _ = self._calibration

    def truths(
        self, known: Known
    ) -> tuple[Float[np.ndarray, "truths postures m p"], Float[np.ndarray, "truths postures m p"]]:
        """A single one: the calibrated arm."""
        check_body(self.body, known)
        true: Tensor = known.learn(self._calibration).jacobian(known.postures)
        return true.detach().numpy()[None], known.estimated[None]

    @cached_property
    def _calibration(self) -> SelfCalibration:
        return SelfCalibration(
            self.body, starts=self.starts, axis_spread=self.axis_spread, offset_spread=self.offset_spread
        )


def check_body(body: Embodiment, known: Known) -> None:
    """Raises InvalidConfig unless the experience is of as many felt joints as the body has."""
    if known.postures.shape[1] != body.p:
        raise InvalidConfig(
            f"the experience is of {known.postures.shape[1]} felt joints, embodiment '{body.name}' has {body.p}; "
            "give the body it was recorded with"
        )
