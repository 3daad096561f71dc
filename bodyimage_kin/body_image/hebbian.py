"""The simplest tactile map: connections between taxels and visual cells that fire together (equations 8 to 11)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from bodyimage_kin._shown import Shown
from bodyimage_kin.body_image._checks import choice, number, whole
from bodyimage_kin.body_image._layout import Layout, Units
from bodyimage_kin.body_image._touches import image_bounds, silent, touches
from bodyimage_kin.body_image.kernel import KERNELS, kernel_matrix
from bodyimage_kin.errors import InvalidConfig, InvalidRecording

__all__ = ["HebbianMap", "hebbian_map"]


@dataclass(frozen=True, eq=False)
class HebbianMap(Shown):
    """Connections from taxels to visual cells.

    Attributes:
        weights: (number of taxels, cells) connection weights, by taxel; 0 where nothing was ever associated.
        cells: (cells, m) centre of each visual cell [m on the screen]; the last axis varies fastest.
        tactile_map: (rows, columns, m), or (taxels, m) of a skin that is no grid: mean of the cells' centres, weighted
            by the connections of each taxel [m]; NaN for a taxel that has none.
    """

    weights: Float[np.ndarray, "taxels cells"]
    cells: Float[np.ndarray, "cells m"]
    tactile_map: Float[np.ndarray, "... m"]


def hebbian_map(
    exp: Any,
    hand: Any,
    trial: int = 0,
    skin: Units = (21, 21),
    cells: Any = 20,
    *,
    kernel: str = "plain",
    gamma: float | int | None = 40.0,
    alpha: float | int = 0.1,
    silence: float | int = 0.0,
    seed: int = 0,
    image_range: Any = None,
) -> HebbianMap:
    """Add up ``alpha h(d_ic) A_k`` over one trial's touches, for every taxel i and visual cell k (8 to 11).

    Args:
        exp: Experience, as for `BodyImage.learn`.
        hand: Hand image to associate with [m on the screen], (trial, time, axis); the cell it falls in is the one that
            fires (equation 10). Outside the range, or NaN, none does.
        trial: Which trial.
        skin: (rows, columns) of a grid of taxels, a Skin, or distances (taxels, taxels); the first taxel felt wins.
        cells: Visual cells along each axis: one number, or one for each axis.
        kernel: h, as for `activation`; equation 11 has ``"plain"``.
        gamma: Width of the kernel in grid units; None: the touched taxel alone (equations 8 and 9).
        alpha: Learning rate.
        silence: Probability that a touch goes unnoticed.
        seed: Of the silence; the same touches are silent as in `BodyImage.learn` with this seed.
        image_range: (m, 2) lowest and highest of each axis that the cells cover [m]; by default that of ``hand`` over
            the touches that are noticed.

    Raises:
        InvalidRecording: A variable is missing, no samples, or no touch with a hand image.
        InvalidArray: ``hand`` or ``image_range`` has the wrong shape.
        InvalidConfig: A setting out of its range, or no such trial.
    """
    layout = Layout.of(skin)
    choice("kernel", kernel, KERNELS)
    alpha = number("alpha", alpha, 0.0, open_below=True)
    width = None if gamma is None else number("gamma", gamma, 0.0, open_below=True)
    silence = number("silence", silence, 0.0, 1.0)
    felt = touches(exp, hand, trial, layout)
    taxels, target = felt.first, felt.target
    steps, m = target.shape
    counts = (cells,) * m if np.ndim(cells) == 0 else tuple(cells)
    if len(counts) != m:
        raise InvalidConfig(f"cells={cells!r}; give one number, or {m}, one for each axis of the image")
    counts = tuple(whole("cells", count, 1) for count in counts)

    stream = np.random.SeedSequence(whole("seed", seed, 0)).spawn(3)[1]
    noticed = (taxels >= 0) & np.isfinite(target).all(axis=1) & ~silent(steps, silence, stream)
    if not noticed.any():
        raise InvalidRecording(f"trial {trial} has no touch with a hand image, so there is nothing to associate")
    bounds = image_bounds(target[noticed], m, image_range)
    lowest, highest = bounds.T
    inside = noticed & (target >= lowest).all(axis=1) & (target <= highest).all(axis=1)
    size = np.where(highest > lowest, (highest - lowest) / counts, 1.0)
    # The upper edge of the range belongs to the last cell.
    firing = np.minimum(((target[inside] - lowest) / size).astype(np.int64), np.array(counts) - 1)
    fired = np.zeros((layout.count, int(np.prod(counts))))
    np.add.at(fired, (taxels[inside], np.ravel_multi_index(tuple(firing.T), counts)), alpha)
    weights = fired if width is None else kernel_matrix(layout, width, kernel) @ fired

    centres = np.stack(np.meshgrid(*(np.arange(count) + 0.5 for count in counts), indexing="ij"), axis=-1)
    places = lowest + centres.reshape(-1, m) * size
    total = weights.sum(axis=1, keepdims=True)
    mean = np.divide(weights @ places, total, out=np.full((len(weights), m), np.nan), where=total > 0)
    return HebbianMap(weights=weights, cells=places, tactile_map=mean.reshape(*layout.shape, m))
