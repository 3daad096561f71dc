"""Doubt carried on: from functions that are as plausible as what was learned, to hands and to maps.

A doubt about each step, taken as new at each, would average out along a path; but what a learner is wrong about it is
wrong about all along. So whole functions are drawn, each is integrated and each gives a body image of its own, and what
these differ in is the doubt about the map::

    draws = learned.draws(100)
    hands = bk.integrate_draws(touch, draws)
    maps = bk.BodyImageDraws.learn(touch, hands)
    maps.mean, maps.covariance          # of every taxel

It is the doubt of the learner alone: neither the noise of encoders nor where the sum begins is in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin._shown import Shown
from bodyimage_kin.body_image._checks import postures, whole
from bodyimage_kin.body_image._touches import image_bounds, images_known
from bodyimage_kin.body_image.integration import integrate
from bodyimage_kin.body_image.maps import BodyImage
from bodyimage_kin.body_image.posture_som import PostureSOM
from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.estimators import HasDisplacement
from bodyimage_kin.recordings import first_taxel

__all__ = ["BodyImageDraws", "integrate_draws"]


def integrate_draws(exp: xr.Dataset, draws: Sequence[HasDisplacement], **settings: Any) -> xr.DataArray:
    """The hand image by each of several learned Jacobians, along the same postures.

    Args:
        exp: Experience, as for :func:`bodyimage_kin.integrate`.
        draws: Functions that are as plausible as each other: ``learned.draws(n)``, or the Jacobians of bodies drawn
            from a calibration.
        **settings: Of :func:`bodyimage_kin.integrate`, the same for all.

    Returns:
        ``hand_estimate`` (draw, trial, time, axis), in the unit of the hand image.

    Raises:
        InvalidConfig: Fewer than two draws; and as :func:`bodyimage_kin.integrate`.
        InvalidRecording: As :func:`bodyimage_kin.integrate`.
        InvalidArray: Likewise.
    """
    if isinstance(draws, HasDisplacement):
        raise InvalidConfig(f"draws is {type(draws).__name__}, one function; give several: learned.draws(n)")
    if len(draws) < 2:
        raise InvalidConfig(f"{len(draws)} draws tell no spread; give two or more: learned.draws(n)")
    hands = [integrate(exp, one, **settings) for one in draws]
    found = xr.concat(hands, dim="draw", combine_attrs="override")
    return found.transpose("draw", "trial", "time", "axis").rename("hand_estimate")


@dataclass(frozen=True, eq=False)
class BodyImageDraws(Shown):
    """Body images that are as plausible as each other: every taxel, and every posture, with a mean and a covariance.

    Attributes:
        draws: One body image for each function that was drawn. Touches, silence, representative postures and the maps
            that learning began with are the same in all.
    """

    draws: tuple[BodyImage, ...]

    def __post_init__(self) -> None:
        if len(self.draws) < 2 or len({np.shape(one.tactile_map) for one in self.draws}) != 1:
            raise InvalidConfig("draws of a body image are two or more, with maps of one shape")

    @classmethod
    def learn(cls, exp: Any, hands: Any, *, trial: int = 0, seed: int = 0, **settings: Any) -> BodyImageDraws:
        """Learns a body image from each hand image.

        Args:
            exp: Experience, as for :meth:`BodyImage.learn`.
            hands: (draw, trial, time, axis), such as :func:`integrate_draws` gives.
            trial: Which trial.
            seed: As of :meth:`BodyImage.learn`, the same for all.
            **settings: Of :meth:`BodyImage.learn`, the same for all.

        Raises:
            InvalidArray: Hand images of another shape.
            InvalidConfig: As :meth:`BodyImage.learn`.
            InvalidRecording: Likewise.
        """
        if isinstance(hands, xr.DataArray):
            if set(hands.dims) != {"draw", "trial", "time", "axis"}:
                raise InvalidArray(
                    f"hands have dimensions {hands.dims}; they must be ('draw', 'trial', 'time', 'axis')"
                )
            hands = hands.transpose("draw", "trial", "time", "axis").to_numpy()
        values = as_float_array(hands, "hands", ndim=4)
        if values.ndim != 4 or len(values) < 2:
            raise InvalidArray(f"hands have shape {values.shape}; give two or more, (draw, trial, time, axis)")
        if settings.get("image_range") is None:
            # That of the one hand that was seen, or of all together: else each would begin elsewhere.
            known = images_known(exp, values[0])
            all_of_them = known if "hand_image" in exp and np.isfinite(known).any() else values
            settings["image_range"] = image_bounds(all_of_them, values.shape[-1])
        if settings.get("posture_som") is None:
            # It knows of no hand, so one serves all: the one that BodyImage.learn would train.
            stream = np.random.SeedSequence(whole("seed", seed, 0)).spawn(3)[2]
            felt = postures(exp)[whole("trial", trial, 0, exp.sizes["trial"])]
            touching = np.isfinite(felt).all(axis=1) & (first_taxel(exp)[trial] >= 0)
            grid = settings.get("posture_grid", (8, 8))
            settings["posture_som"] = PostureSOM.fit(felt[touching], grid, int(stream.generate_state(1)[0]))
        return cls(tuple(BodyImage.learn(exp, hand, trial=trial, seed=seed, **settings) for hand in values))

    @property
    def touch_counts(self) -> Int[np.ndarray, "taxels"]:
        """(taxels,) touches that taught something, by touched taxel, in every draw."""
        return np.min([one.touch_counts for one in self.draws], axis=0)

    @cached_property
    def tactile_maps(self) -> Float[np.ndarray, "draws *taxels m"]:
        """Of each draw, image of each taxel [unit of the hand image]."""
        return np.stack([one.tactile_map for one in self.draws])

    @cached_property
    def posture_maps(self) -> Float[np.ndarray, "draws *units m"]:
        """Of each draw, image of each representative posture [unit of the hand image]."""
        return np.stack([one.posture_map for one in self.draws])

    @property
    def mean(self) -> Float[np.ndarray, "*taxels m"]:
        """Mean over draws of the image of each taxel [unit of the hand image]."""
        return np.asarray(self.tactile_maps.mean(0))

    @property
    def covariance(self) -> Float[np.ndarray, "*taxels m m"]:
        """Covariance over draws of the image of each taxel [its unit, squared]."""
        return _covariance(self.tactile_maps)

    @property
    def posture_mean(self) -> Float[np.ndarray, "*units m"]:
        """Mean over draws of the image of each representative posture [unit of the hand image]."""
        return np.asarray(self.posture_maps.mean(0))

    @property
    def posture_covariance(self) -> Float[np.ndarray, "*units m m"]:
        """Covariance over draws of the image of each representative posture [its unit, squared]."""
        return _covariance(self.posture_maps)


def _covariance(values: ArrayLike) -> Float[np.ndarray, "*batch m m"]:
    """Over the first axis."""
    away = values - values.mean(0)
    return np.asarray(np.einsum("d...a,d...b->...ab", away, away) / (len(values) - 1))
