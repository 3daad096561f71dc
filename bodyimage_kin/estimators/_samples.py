"""What learners take from an experience: postures and images, or displacements between postures near each other.

A *stream* is ordered in time: its displacements are those between successive samples. A *scattered* recording has no
order: each posture is joined with its nearest, and whatever order its rows came in, they are read in one canonical
order, so that nothing which is learned depends on it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
import scipy.spatial
import torch
import xarray as xr
from jaxtyping import Bool, Float, Int
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.estimators import _hold_out
from bodyimage_kin.estimators._carry import warn_unmoved
from bodyimage_kin.recordings import canonical_order, check, is_scattered

_NEIGHBOURS = 4

Mask: TypeAlias = Bool[Tensor, "rows"]


@dataclasses.dataclass(frozen=True, eq=False)
class Samples:
    """Felt postures and the hand images seen in them: in the order of a stream, or in canonical order.

    Attributes:
        q: (count, p) [rad or m].
        image: (count, m), in its unit.
        unit: Of the hand image; empty where it is not known.
        block: (count,) number of the block that each belongs to, from 0; None where the recording has no blocks.
        scattered: Whether they have no order in time.
        repeat: (count,) number of the posture that each repeats, -1 for none; None where the recording has no repeats.
        noise: Standard deviation of what is felt of a joint, where it is stated [rad or m].
    """

    q: Float[Tensor, "count p"]
    image: Float[Tensor, "count m"]
    unit: str = ""
    block: Int[Tensor, "count"] | None = None
    scattered: bool = False
    repeat: Int[Tensor, "count"] | None = None
    noise: float = 0.0

    def only(self, kept: Mask | Int[Tensor, "kept"]) -> Samples:
        """Some of them, or all in another order."""
        block, repeat = (None if numbers is None else numbers[kept] for numbers in (self.block, self.repeat))
        return dataclasses.replace(self, q=self.q[kept], image=self.image[kept], block=block, repeat=repeat)

    def fold(self, folds: int) -> Int[Tensor, "count"]:
        """To which fold each belongs: folds are groups of blocks, or else arcs of a stream or clusters of postures."""
        if self.block is not None:
            return _hold_out.grouped(self.block, folds)
        if self.scattered:
            return torch.from_numpy(_hold_out.clusters(_over_spread(self.q.numpy()), min(folds, len(self.q))))
        return _hold_out.arcs(len(self.q), folds)

    def folds(self, folds: int) -> Iterator[tuple[Mask, Mask]]:
        """What to learn from and what to predict, each fold being predicted once."""
        return _hold_out.halves(self.fold(folds))

    def held_out(self, share: float) -> Mask:
        """Which are held out where about so large a share of the folds is."""
        return _hold_out.chosen(self.fold(_hold_out.ARCS), share)


@dataclasses.dataclass(frozen=True, eq=False)
class Pairs:
    """What an experience teaches of displacements: how joints and hand image moved, one row a step or an edge.

    Attributes:
        q: (steps, p) posture before a step; of an edge, the posture half way [rad or m].
        dq: (steps, p) displacement of the joints [rad or m].
        dr: (steps, m) displacement of the hand image, in its unit.
        unit: Of the hand image; empty where it is not known.
        blocks: (steps, 2) blocks of both ends of a stream's steps; None where the recording has no blocks.
        postures: What edges are made of; None for a stream.
    """

    q: Float[Tensor, "steps p"]
    dq: Float[Tensor, "steps p"]
    dr: Float[Tensor, "steps m"]
    unit: str = ""
    blocks: Int[Tensor, "steps 2"] | None = None
    postures: Samples | None = None

    def only(self, kept: Mask) -> Pairs:
        """Some of the steps."""
        blocks = None if self.blocks is None else self.blocks[kept]
        return dataclasses.replace(self, q=self.q[kept], dq=self.dq[kept], dr=self.dr[kept], blocks=blocks)

    def folds(self, folds: int) -> Iterator[tuple[Pairs, Pairs]]:
        """What to learn from and what to predict, each fold being predicted once; no step joins the two.

        Edges are made anew on either side.
        """
        if self.postures is not None:
            for learn, predict in self.postures.folds(folds):
                yield edges_of(self.postures.only(learn)), edges_of(self.postures.only(predict))
        elif self.blocks is not None:
            fold = _hold_out.grouped(self.blocks, folds)
            for one in range(_hold_out.count(fold)):
                yield self.only((fold != one).all(1)), self.only((fold == one).all(1))
        else:
            for learn, predict in _hold_out.halves(_hold_out.arcs(len(self.dq), folds)):
                yield self.only(learn), self.only(predict)

    def held_out(self, share: float) -> tuple[Pairs, Mask]:
        """These pairs, and which of them are held out; edges and steps between the two are left out."""
        if self.postures is not None:
            held = self.postures.held_out(share)
            if not bool(held.any()):
                return self, torch.zeros(len(self.dq), dtype=torch.bool)
            learn, judge = edges_of(self.postures.only(~held)), edges_of(self.postures.only(held))
            q, dq, dr = (torch.cat([getattr(learn, name), getattr(judge, name)]) for name in ("q", "dq", "dr"))
            return dataclasses.replace(self, q=q, dq=dq, dr=dr), torch.arange(len(dq)) >= len(learn.dq)
        if self.blocks is not None:
            ends = _hold_out.chosen(_hold_out.grouped(self.blocks, _hold_out.ARCS), share)
            pure = ends[:, 0] == ends[:, 1]
            return self.only(pure), ends[pure, 0]
        return self, _hold_out.chosen(_hold_out.arcs(len(self.dq), _hold_out.ARCS), share)


def pairs(exp: xr.Dataset, learner: str = "") -> Pairs:
    """Displacements that an experience shows: its steps, or the edges of a scattered recording.

    Args:
        exp: An experience, with ``q`` and ``hand_image`` of any real dtype. Samples in which one of both is missing
            are left out.
        learner: Who learns from it: where given, joints that hardly move are told by a DataWarning.

    Returns:
        Of a stream, all steps between two successive samples. Of a scattered recording, each posture with its four
        nearest (joints over their spread), each pair once; repeats of a posture are dropped.

    Raises:
        InvalidRecording: No such step or edge, none in which a joint moves, or a hand whose observed point moves in it
            (``hand_offset``).
    """
    if is_scattered(exp):
        return edges_of(samples(exp, learner))
    q, image, felt, block = _felt(exp)
    step = felt[:, :-1] & felt[:, 1:]
    if not step.any():
        raise InvalidRecording(
            "the experience has no two successive samples in which the hand is seen; "
            "learn from a recording with the hand in view, such as a bk.motions.Circle"
        )
    dq = np.diff(q, axis=1)[step]
    if not dq.any():
        raise InvalidRecording("no joint moves in the experience, so it teaches no displacement; record a motion")
    if learner:
        warn_unmoved(learner, torch.from_numpy(dq), _joints(exp))
    dr = np.diff(image, axis=1)[step]
    blocks = None if block is None else torch.from_numpy(np.stack([block[:, :-1][step], block[:, 1:][step]], 1))
    return Pairs(torch.from_numpy(q[:, :-1][step]), torch.from_numpy(dq), torch.from_numpy(dr), _unit(exp), blocks)


def samples(exp: xr.Dataset, learner: str = "") -> Samples:
    """All instants of an experience at which posture and hand image are felt; ``learner`` as of :func:`pairs`.

    Raises:
        InvalidRecording: The hand is never seen, the joints never move while it is, or the observed point moves in the
            hand (``hand_offset``).
    """
    scattered = is_scattered(exp)
    if scattered:
        exp = exp.isel(time=canonical_order(exp))
    q, image, felt, block = _felt(exp)
    if not felt.any():
        raise InvalidRecording(
            "the hand is never seen in the experience; learn from a recording with the hand in view, such as "
            "a bk.motions.Circle"
        )
    if not np.ptp(q[felt], axis=0).any():
        raise InvalidRecording("no joint moves in the experience, so it teaches no Jacobian; record a motion")
    if learner:
        warn_unmoved(learner, torch.from_numpy(q[felt] - q[felt].mean(0)), _joints(exp))
    noise = _checks.number("encoder_noise", exp.attrs.get("encoder_noise", 0.0), least=0.0, error=InvalidRecording)
    repeat = check(exp)["repeat"].values if "repeat" in exp else None
    numbers = [None if one is None else torch.from_numpy(one[felt]) for one in (block, repeat)]
    return Samples(
        torch.from_numpy(q[felt]), torch.from_numpy(image[felt]), _unit(exp), numbers[0], scattered, numbers[1], noise
    )


def edges(
    q: ArrayLike, neighbours: int = _NEIGHBOURS, repeat: ArrayLike | None = None, noise: float = 0.0
) -> Int[np.ndarray, "edges 2"]:
    """Postures without an order, joined with their nearest.

    Args:
        q: Postures (count, p) [rad or m]. Distances are between joints over their spread.
        neighbours: How many each is joined with.
        repeat: (count,) number of the posture that each repeats, -1 for none: the first of each is kept.
        noise: Standard deviation of what is felt of a joint [rad or m]. Postures that differ by no more than twice this
            in any joint repeat each other.

    Returns:
        The two ends of each edge, by row, each edge once, sorted. Which end comes first is as good as tossed, but the
        same for the same rows: the displacements point every way.

    Raises:
        InvalidArray: No postures.
    """
    postures = as_float_array(q, "postures", ndim=2)
    _checks.whole("neighbours", neighbours, least=1)
    _checks.number("noise", noise, least=0.0)
    kept = _distinct(postures, repeat, noise)
    scaled = _over_spread(postures[kept])
    near = min(neighbours, len(kept) - 1)
    if near == 0:
        return np.empty((0, 2), dtype=np.int64)
    _, found = scipy.spatial.KDTree(scaled).query(scaled, k=near + 1)
    own = np.arange(len(kept))[:, None]
    # The nearest is the posture itself, but for ties: of those, too, the others are meant.
    others = np.argsort(found == own, axis=1, kind="stable")[:, :near]
    joined = np.stack([np.broadcast_to(own, others.shape), np.take_along_axis(found, others, 1)], -1).reshape(-1, 2)
    joined = np.unique(np.sort(joined, axis=1), axis=0)
    turned = joined.sum(1) % 2 == 1
    joined[turned] = joined[turned, ::-1]
    return kept[joined]


def edges_of(data: Samples) -> Pairs:
    """Displacements between scattered postures and their nearest.

    Raises:
        InvalidRecording: All postures are one.
    """
    ends = torch.from_numpy(edges(data.q, repeat=data.repeat, noise=data.noise))
    first, last = ends[:, 0], ends[:, 1]
    q, image = data.q, data.image
    return Pairs((q[first] + q[last]) / 2.0, q[last] - q[first], image[last] - image[first], data.unit, postures=data)


def refuse_scattered(exp: xr.Dataset, learner: str, remedy: str) -> None:
    """Raises InvalidRecording where a learner needs a stream and gets a scattered recording."""
    if is_scattered(exp):
        raise InvalidRecording(f"{learner} learns step by step along a stream, this recording is scattered; {remedy}")


def fold_of_each(exp: xr.Dataset, folds: int) -> Int[np.ndarray, "trial time"]:
    """The fold of each sample of an experience, as it stands there; -1 where nothing is seen.

    A shuffled recording has the same folds, shuffled.
    """
    order = canonical_order(exp) if is_scattered(exp) else np.arange(exp.sizes["time"])
    q, image, felt, block = _felt(exp.isel(time=order))
    numbers = None if block is None else torch.from_numpy(block[felt])
    data = Samples(torch.from_numpy(q[felt]), torch.from_numpy(image[felt]), "", numbers, is_scattered(exp))
    fold = np.full(felt.shape, -1)
    fold[felt] = data.fold(folds)
    found = np.empty_like(fold)
    found[:, order] = fold
    return found


# Inner ---------------------------------------------------------------------------------------------------------------


def _felt(
    exp: xr.Dataset,
) -> tuple[
    Float[np.ndarray, "trial time p"],
    Float[np.ndarray, "trial time m"],
    Bool[np.ndarray, "trial time"],
    Int[np.ndarray, "trial time"] | None,
]:
    """Postures and hand images in float64, whatever they came in, where both are there, and blocks from 0."""
    exp = check(exp)
    if "hand_image" not in exp:
        raise InvalidRecording("the recording has no variable 'hand_image': nothing is seen to learn from")
    q, image = exp["q"].values, exp["hand_image"].values
    felt = np.isfinite(q).all(-1) & np.isfinite(image).all(-1)
    if "hand_offset" in exp:
        offset = exp["hand_offset"].values[felt]
        if len(offset) and not np.allclose(offset, offset[0], rtol=0.0, atol=0.0, equal_nan=True):
            raise InvalidRecording(
                "the observed point moves in the hand (hand_offset varies); learn from rows of one offset, or fit the "
                "body, of which each offset is a part"
            )
    block = None
    if "block" in exp:
        block = np.unique(exp["block"].values, return_inverse=True)[1].reshape(felt.shape).astype(np.int64)
    return q, image, felt, block


def _joints(exp: xr.Dataset) -> list[str]:
    """Names of the joints; their numbers where they have none."""
    if "joint" in exp.coords:
        return [str(name) for name in exp["joint"].values]
    return [f"joint {index}" for index in range(exp.sizes["joint"])]


def _unit(exp: xr.Dataset) -> str:
    return str(exp["hand_image"].attrs.get("units", ""))


def _over_spread(q: Float[np.ndarray, "count p"]) -> Float[np.ndarray, "count p"]:
    """Joints over their standard deviation; as they are where they rest."""
    spread = q.std(axis=0)
    return np.asarray(q / np.where(spread > 0, spread, 1.0))


def _distinct(q: Float[np.ndarray, "count p"], repeat: ArrayLike | None, noise: float) -> Int[np.ndarray, "kept"]:
    """The first of each posture."""
    dropped = np.zeros(len(q), dtype=bool)
    if repeat is not None:
        numbers = np.asarray(repeat)
        first = np.unique(numbers, return_index=True)[1]
        dropped = (numbers >= 0) & ~np.isin(np.arange(len(q)), first)
    close = np.sort(scipy.spatial.KDTree(q).query_pairs(2.0 * noise, p=np.inf, output_type="ndarray"), axis=1)
    for first, second in close[np.lexsort(close.T[::-1])]:
        dropped[second] |= not dropped[first]
    return np.flatnonzero(~dropped)
