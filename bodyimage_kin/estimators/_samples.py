"""What learners of a map from postures to images take from an experience, and how it is held out by arcs."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float, Int
from torch import Tensor

from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.recordings.schema import check


@dataclasses.dataclass(frozen=True, eq=False)
class Samples:
    """Felt postures and the hand images seen in them, in the order of the recording.

    Attributes:
        q: (count, p) [rad].
        image: (count, m) [m].
    """

    q: Float[Tensor, "count p"]
    image: Float[Tensor, "count m"]


def samples(exp: xr.Dataset) -> Samples:
    """All instants of an experience at which posture and hand image are felt.

    Raises:
        InvalidRecording: The hand is never seen, or the joints never move while it is.
    """
    check(exp)
    q, image = exp["q"].values, exp["hand_image"].values
    felt = np.isfinite(q).all(-1) & np.isfinite(image).all(-1)
    if not felt.any():
        raise InvalidRecording(
            "the hand is never seen in the experience; learn from a recording with the hand in view, such as "
            "a bk.motions.Circle"
        )
    q, image = q[felt].astype(np.float64), image[felt].astype(np.float64)
    if not np.ptp(q, axis=0).any():
        raise InvalidRecording("no joint moves in the experience, so it teaches no Jacobian; record a motion")
    return Samples(torch.from_numpy(q), torch.from_numpy(image))


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
