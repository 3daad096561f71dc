"""Seen data that are hidden from a learner, to judge how far it reaches beyond: what lies farthest, regions, or folds.

A learned Jacobian is used where the eye does not see. Samples held out one by one would flatter any learner, for
neighbours in time are nearly copies; and so would stretches of time, for a motion that comes by the same place on its
next turn shows there what was hidden before. So a region of the image is hidden over all turns and trials. A recording
of the world has blocks of its own: they are hidden whole, with no pair of postures across the border.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int

from bodyimage_kin._checks import number, whole
from bodyimage_kin._shown import Shown
from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.estimators import Pairs, fold_of_each, pairs

__all__ = ["HeldOut", "hold_out", "hold_out_far", "hold_out_folds", "image_regions"]


@dataclass(frozen=True, eq=False)
class HeldOut(Shown):
    """An experience with one region or fold hidden.

    Attributes:
        seen: The experience, its hand image NaN there.
        hidden: The steps within, or the edges of a scattered recording.
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
    return _hidden_in_turn(exp, region, regions, "region")


def hold_out_far(
    exp: xr.Dataset, draws: int = 4, *, share: float = 0.25, gap: float = 0.1, seed: int = 0
) -> list[HeldOut]:
    """What lies farthest from the rest of what was seen is hidden: whoever foretells it extrapolates.

    Postures are laid along a direction of joint space, drawn at random; the farthest are hidden, and those between them
    and the rest are left out of both. A circle whose postures lie along its depth loses its nearest or farthest part;
    of several circles, one goes.

    Args:
        exp: An experience.
        draws: How many directions; what differs between them says how much the direction matters.
        share: Of the samples that is hidden, the farthest.
        gap: Of the samples that is left out beside.
        seed: Of the directions; the first ones are those of fewer.

    Raises:
        InvalidRecording: As :func:`hold_out`.
        InvalidConfig: No draws, or shares that leave nothing.
    """
    whole("draws", draws, least=1)
    number("share", share, above=0.0, below=1.0)
    number("gap", gap, least=0.0, below=1.0 - share)
    q, image = exp["q"].values.astype(np.float64), exp["hand_image"].values
    seen = np.isfinite(q).all(-1) & np.isfinite(image).all(-1)
    rng = np.random.default_rng(whole("seed", seed, least=0))
    found = []
    for draw in range(draws):
        along = q[seen] @ rng.standard_normal(q.shape[-1])
        hidden, left = np.zeros((2, *seen.shape), dtype=bool)
        far, near = np.quantile(along, [1.0 - share, 1.0 - share - gap]) if len(along) else (np.nan, np.nan)
        hidden[seen], left[seen] = along > far, along > near
        found.append(_parted(exp, ~left, hidden, f"draw {draw} of {draws}"))
    return found


def hold_out_folds(exp: xr.Dataset, folds: int = 5) -> list[HeldOut]:
    """One for each fold of an experience: its blocks, or else arcs of a stream or clusters of scattered postures.

    Args:
        exp: An experience; ``block`` (trial, time), where it has one, says what belongs together.
        folds: How many; fewer blocks make fewer folds.

    Raises:
        InvalidRecording: A single block, a fold without a pair of postures, or outside which there is none, or in which
            the hand image rests.
        InvalidConfig: Less than two folds.
    """
    fold = fold_of_each(exp, whole("folds", folds, least=2))
    if fold.max() < 1:
        raise InvalidRecording("the recording has a single block, so nothing can be held out; give it more blocks")
    return _hidden_in_turn(exp, fold, int(fold.max()) + 1, "fold")


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


def _hidden_in_turn(exp: xr.Dataset, part: Int[np.ndarray, "trial time"], parts: int, what: str) -> list[HeldOut]:
    return [_parted(exp, part != hidden, part == hidden, f"{what} {hidden} of {parts}") for hidden in range(parts)]


def _parted(
    exp: xr.Dataset, kept: Bool[np.ndarray, "trial time"], hidden: Bool[np.ndarray, "trial time"], what: str
) -> HeldOut:
    try:
        one = HeldOut(_only(exp, kept), pairs(_only(exp, hidden)))
        pairs(one.seen)
    except InvalidRecording as problem:
        raise InvalidRecording(f"{what} cannot be held out: {problem}") from None
    if not one.hidden.dr.any():
        raise InvalidRecording(f"{what} cannot be held out: the hand image rests in it")
    return one


def _only(exp: xr.Dataset, kept: Bool[np.ndarray, "trial time"]) -> xr.Dataset:
    """The experience, the hand seen at these instants alone."""
    return exp.assign(hand_image=exp["hand_image"].where(xr.DataArray(kept, dims=("trial", "time"))))
