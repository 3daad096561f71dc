"""Seen data that are hidden from a learner, to judge how far it reaches beyond: what lies farthest, regions, folds.

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
from bodyimage_kin.estimators import Pairs, edges, fold_of_each, pairs

RUNS = 20
"""Stretches that are resampled at least: of five folds no interval could be told."""

__all__ = ["HeldOut", "all_hidden", "hold_out", "hold_out_far", "hold_out_folds", "image_regions"]


@dataclass(frozen=True, eq=False)
class HeldOut(Shown):
    """An experience with one region or fold hidden.

    Attributes:
        seen: The experience, its hand image NaN there.
        hidden: The steps within, or the edges of a scattered recording.
        q: (postures, p) felt postures within [rad or m].
        image: (postures, m) hand images seen in them [unit].
        run: (postures,) number of the stretch of the recording that each belongs to: its blocks, or parts of them,
            about twenty in all. Resample these, for neighbours are nearly copies of each other.
        run_of_pair: (pairs,) that of each pair's first end.
    """

    seen: xr.Dataset
    hidden: Pairs
    q: Float[np.ndarray, "postures p"]
    image: Float[np.ndarray, "postures m"]
    run: Int[np.ndarray, "postures"]
    run_of_pair: Int[np.ndarray, "pairs"]


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
        # 0 is hidden, 1 left out of both.
        part = np.full(seen.shape, 2)
        far, near = np.quantile(along, [1.0 - share, 1.0 - share - gap]) if len(along) else (np.nan, np.nan)
        part[seen] = np.where(along > far, 0, np.where(along > near, 1, 2))
        found.append(_parted(exp, part == 2, part == 0, _runs(exp, part), f"draw {draw} of {draws}"))
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


def all_hidden(exp: xr.Dataset) -> HeldOut:
    """All of an experience hidden, nothing seen: to judge what was learned from another.

    Args:
        exp: An experience.

    Raises:
        InvalidRecording: No pair of postures in it.
    """
    part = np.isfinite(exp["q"].values).all(-1)
    if "hand_image" in exp:
        part &= np.isfinite(exp["hand_image"].values).all(-1)
    return _hidden(exp, _only(exp, ~part), part, _runs(exp, np.where(part, 0, -1)))


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
    runs = _runs(exp, part)
    return [
        _parted(exp, part != hidden, part == hidden, runs, f"{what} {hidden} of {parts}") for hidden in range(parts)
    ]


def _parted(
    exp: xr.Dataset,
    kept: Bool[np.ndarray, "trial time"],
    hidden: Bool[np.ndarray, "trial time"],
    runs: Int[np.ndarray, "trial time"],
    what: str,
) -> HeldOut:
    try:
        seen = _only(exp, kept)
        one = _hidden(exp, seen, hidden, runs)
        pairs(seen)
    except InvalidRecording as problem:
        raise InvalidRecording(f"{what} cannot be held out: {problem}") from None
    if not one.hidden.dr.any():
        raise InvalidRecording(f"{what} cannot be held out: the hand image rests in it")
    return one


def _hidden(
    exp: xr.Dataset, seen: xr.Dataset, part: Bool[np.ndarray, "trial time"], runs: Int[np.ndarray, "trial time"]
) -> HeldOut:
    # Pairs know the blocks of their ends: for this once, blocks are the stretches.
    inside = pairs(_only(exp, part).assign(block=xr.DataArray(runs, dims=("trial", "time"))))
    block = None if inside.blocks is None else inside.blocks[:, 0]
    if (data := inside.postures) is not None and data.block is not None:
        block = data.block[edges(data.q, repeat=data.repeat, noise=data.noise)[:, 0]]
    assert block is not None
    image = exp["hand_image"].values[part].astype(np.float64)
    q = exp["q"].values[part].astype(np.float64)
    return HeldOut(seen, pairs(_only(exp, part)), q, image, runs[part], np.unique(runs)[block.numpy()])


def _runs(exp: xr.Dataset, part: Int[np.ndarray, "trial time"]) -> Int[np.ndarray, "trial time"]:
    """Stretches of the recording: its blocks, each cut into as many contiguous parts as make twenty of all."""
    block = np.asarray(exp["block"].values) if "block" in exp else part
    run = np.full(part.shape, -1)
    numbers = np.unique(block[part >= 0])
    pieces = -(-RUNS // max(len(numbers), 1))
    for index, own in enumerate(numbers):
        here = (block == own) & (part >= 0)
        count = int(here.sum())
        run[here] = index * pieces + np.arange(count) * min(pieces, count) // max(count, 1)
    return run


def _only(exp: xr.Dataset, kept: Bool[np.ndarray, "trial time"]) -> xr.Dataset:
    """The experience, the hand seen at these instants alone."""
    return exp.assign(hand_image=exp["hand_image"].where(xr.DataArray(kept, dims=("trial", "time"))))
