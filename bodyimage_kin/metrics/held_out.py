"""Seen data that are hidden from a learner in whole regions of the image, to judge how far it reaches beyond.

A learned Jacobian is used where the eye does not see. Samples held out one by one would flatter any learner, for
neighbours in time are nearly copies; and so would stretches of time, for a motion that comes by the same place on its
next turn shows there what was hidden before. So a region of the image is hidden over all turns and trials.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int

from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.estimators import Pairs, pairs


@dataclass(frozen=True, eq=False)
class HeldOut:
    """An experience with one region hidden.

    Attributes:
        seen: The experience, its hand image NaN in that region.
        hidden: The steps within the region.
    """

    seen: xr.Dataset
    hidden: Pairs


def hold_out(exp: xr.Dataset, regions: int) -> list[HeldOut]:
    """One for each region of an experience.

    Args:
        exp: An experience.
        regions: How many, at least two.

    Raises:
        InvalidRecording: A region without a step, or outside which there is none, or in which the hand image rests.
    """
    image = exp["hand_image"].values
    seen = np.isfinite(exp["q"].values).all(-1) & np.isfinite(image).all(-1)
    region = np.full(seen.shape, -1)
    region[seen] = image_regions(image[seen].astype(np.float64), regions)
    found = []
    for hidden in range(regions):
        try:
            one = HeldOut(_only(exp, region != hidden), pairs(_only(exp, region == hidden)))
            pairs(one.seen)
        except InvalidRecording as problem:
            raise InvalidRecording(f"region {hidden} of {regions} cannot be held out: {problem}") from None
        if not one.hidden.dr.any():
            raise InvalidRecording(f"region {hidden} of {regions} cannot be held out: the hand image rests in it")
        found.append(one)
    return found


def image_regions(image: Float[np.ndarray, "count m"], regions: int) -> Int[np.ndarray, "count"]:
    """Divides hand images into regions of equal numbers: a k-d tree (Bentley 1975), cut where the numbers demand.

    Each cut is across the axis of the greatest variance. On a circle that is passed evenly, regions are arcs of equal
    length.

    Args:
        image: Hand images, in any unit and of any number of coordinates.
        regions: How many.

    Returns:
        The region of each, from 0; their numbers differ by one at most.
    """
    region = np.zeros(len(image), dtype=np.int64)
    if regions > 1 and len(image):
        order = np.argsort(image[:, image.var(axis=0).argmax()], kind="stable")
        few = regions // 2
        first, second = np.split(order, [len(image) * few // regions])
        region[first] = image_regions(image[first], few)
        region[second] = few + image_regions(image[second], regions - few)
    return region


def _only(exp: xr.Dataset, kept: Bool[np.ndarray, "trial time"]) -> xr.Dataset:
    """The experience, the hand seen at these instants alone."""
    return exp.assign(hand_image=exp["hand_image"].where(xr.DataArray(kept, dims=("trial", "time"))))
