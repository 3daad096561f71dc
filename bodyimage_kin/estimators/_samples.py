"""What estimators take from an experience, and how it is held out by arcs."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import torch
import xarray as xr
from jaxtyping import Bool, Float, Int
from torch import Tensor

from bodyimage_kin._arrays import as_float_array
from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.recordings.schema import check


@dataclasses.dataclass(frozen=True, eq=False)
class Pairs:
    """What an experience teaches of displacements: felt postures and how joints and hand image moved, one row a step.

    Attributes:
        q: (steps, p) posture before the step [rad or m].
        dq: (steps, p) displacement of the joints [rad or m].
        dr: (steps, m) displacement of the hand image.
        unit: Of the hand image; empty where it is not known.
    """

    q: Float[Tensor, "steps p"]
    dq: Float[Tensor, "steps p"]
    dr: Float[Tensor, "steps m"]
    unit: str = ""

    def only(self, kept: Bool[Tensor, "steps"]) -> Pairs:
        """Some of the steps."""
        return Pairs(self.q[kept], self.dq[kept], self.dr[kept], self.unit)


@dataclasses.dataclass(frozen=True, eq=False)
class Samples:
    """Felt postures and the hand images seen in them, in the order of the recording.

    Attributes:
        q: (count, p) [rad or m].
        image: (count, m).
        unit: Of the hand image; empty where it is not known.
    """

    q: Float[Tensor, "count p"]
    image: Float[Tensor, "count m"]
    unit: str = ""


def pairs(exp: xr.Dataset) -> Pairs:
    """All steps of an experience at whose both ends posture and hand image are felt.

    Raises:
        InvalidRecording: No such step, or none in which a joint moves.
    """
    q, image, felt = _felt(exp)
    step = felt[:, :-1] & felt[:, 1:]
    if not step.any():
        raise InvalidRecording(
            "the experience has no two successive samples in which the hand is seen; "
            "learn from a recording with the hand in view, such as simulate.circle"
        )
    dq = np.diff(q, axis=1)[step]
    if not dq.any():
        raise InvalidRecording("no joint moves in the experience, so it teaches no displacement; record a motion")
    dr = np.diff(image, axis=1)[step]
    return Pairs(torch.from_numpy(q[:, :-1][step]), torch.from_numpy(dq), torch.from_numpy(dr), _unit(exp))


def samples(exp: xr.Dataset) -> Samples:
    """All instants of an experience at which posture and hand image are felt.

    Raises:
        InvalidRecording: The hand is never seen, or the joints never move while it is.
    """
    q, image, felt = _felt(exp)
    if not felt.any():
        raise InvalidRecording(
            "the hand is never seen in the experience; learn from a recording with the hand in view, such as "
            "simulate.circle"
        )
    q, image = q[felt], image[felt]
    if not np.ptp(q, axis=0).any():
        raise InvalidRecording("no joint moves in the experience, so it teaches no Jacobian; record a motion")
    return Samples(torch.from_numpy(q), torch.from_numpy(image), _unit(exp))


def _felt(
    exp: xr.Dataset,
) -> tuple[Float[np.ndarray, "trial time p"], Float[np.ndarray, "trial time m"], Bool[np.ndarray, "trial time"]]:
    """Postures and hand images in float64, whatever they came in, and where both are there."""
    check(exp)
    q, image = (
        as_float_array(exp[name].values, f"variable '{name}'", error=InvalidRecording) for name in ("q", "hand_image")
    )
    return q, image, np.isfinite(q).all(-1) & np.isfinite(image).all(-1)


def _unit(exp: xr.Dataset) -> str:
    return str(exp["hand_image"].attrs.get("units", ""))


def arcs(count: int, folds: int) -> Int[Tensor, "count"]:
    """The arc of each sample: contiguous blocks of equal length.

    Neighbours in time are nearly copies of each other, so samples held out one by one would flatter any learner.
    """
    return torch.arange(count) * min(folds, count) // count


HeldOutErrors = Callable[[Tensor, Tensor], Tensor]
"""From masks of the samples to learn from and of those to predict: the sum of squared errors for each candidate."""


def choose(errors: HeldOutErrors, count: int, folds: int) -> int:
    """Index of the candidate with the smallest squared error on arcs it has not learned from.

    Args:
        errors: Fits all candidates to the first mask, and gives each one's squared error on the second, summed.
        count: Number of samples.
        folds: Number of arcs, each held out once.

    Raises:
        InvalidRecording: A single sample, of which nothing can be held out.
    """
    if count < 2:
        raise InvalidRecording("a single sample cannot be held out; record more, or give the estimator its penalty")
    fold = arcs(count, folds)
    total = sum(torch.nan_to_num(errors(fold != arc, fold == arc), nan=torch.inf) for arc in range(int(fold[-1]) + 1))
    return int(torch.as_tensor(total).argmin())
