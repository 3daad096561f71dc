"""What is held out together: arcs of a stream, blocks of a recording, clusters of postures.

Neighbours are nearly copies of each other, so samples held out one by one would flatter any learner.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from bodyimage_kin.errors import InvalidRecording

ARCS = 10
"""Folds of which a share is held out to stop early."""

T = TypeVar("T")


def arcs(count: int, folds: int) -> Int[Tensor, "count"]:
    """The arc of each sample of a stream: contiguous, of equal length."""
    return torch.arange(count) * min(folds, count) // count


def grouped(block: Int[Tensor, "*rows"], folds: int) -> Int[Tensor, "*rows"]:
    """The fold of each row, blocks grouped in the order of their numbers into folds of about equally many."""
    numbers, place = torch.unique(block, return_inverse=True)
    return place * min(folds, len(numbers)) // len(numbers)


def clusters(points: Float[np.ndarray, "count d"], regions: int) -> Int[np.ndarray, "count"]:
    """Divides points into regions of equal numbers: a k-d tree (Bentley 1975), cut where the numbers demand.

    Each cut is across the axis of the greatest variance.
    """
    region = np.zeros(len(points), dtype=np.int64)
    if regions > 1 and len(points):
        order = np.argsort(points[:, points.var(axis=0).argmax()], kind="stable")
        few = regions // 2
        first, second = np.split(order, [len(points) * few // regions])
        region[first] = clusters(points[first], few)
        region[second] = few + clusters(points[second], regions - few)
    return region


def count(fold: Int[Tensor, "*rows"]) -> int:
    """Number of folds.

    Raises:
        InvalidRecording: A single one, of which nothing can be held out.
    """
    found = int(fold.max()) + 1 if fold.numel() else 0
    if found < 2:
        raise InvalidRecording(
            "a single sample or block cannot be held out; record more, or give the estimator its penalty"
        )
    return found


def halves(fold: Int[Tensor, "rows"]) -> Iterator[tuple[Bool[Tensor, "rows"], Bool[Tensor, "rows"]]]:
    """What to learn from and what to predict, each fold being predicted once.

    Raises:
        InvalidRecording: A single fold.
    """
    for one in range(count(fold)):
        yield fold != one, fold == one


def chosen(fold: Int[Tensor, "*rows"], share: float) -> Bool[Tensor, "*rows"]:
    """Which rows are held out: folds spread evenly, about so large a share of them; none of fewer than ten rows."""
    folds = int(fold.max()) + 1 if len(fold) >= ARCS else 1
    wanted = round(share * folds) if folds > 1 else 0
    return torch.isin(fold, ((torch.arange(wanted) + 0.5) * folds / max(wanted, 1)).long())


def choose(errors: Callable[[T, T], Float[Tensor, "candidates"]], folds: Iterable[tuple[T, T]]) -> int:
    """Index of the candidate with the smallest squared error on folds that it has not learned from.

    Args:
        errors: Fits all candidates to the first half, and gives each one's squared error on the second, summed.
        folds: The halves.

    Raises:
        InvalidRecording: A single fold.
    """
    total = sum(torch.nan_to_num(errors(learn, predict), nan=torch.inf) for learn, predict in folds)
    return int(torch.as_tensor(total).argmin())
