"""The proprioceptive space: a self-organizing map of the postures felt while touching (equation 4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from bodyimage_kin._shown import Shown
from bodyimage_kin.body_image._checks import float_array, grid_shape, whole
from bodyimage_kin.errors import InvalidArray, InvalidRecording

__all__ = ["PostureSOM"]

_UPDATES_PER_UNIT = 100


@dataclass(frozen=True, eq=False)
class PostureSOM(Shown):
    """A grid of representative postures (equation 4).

    Attributes:
        postures: (rows, columns, p) [rad or m], the units' representative vectors.
        scale: (p,) standard deviation of each joint over the training postures [rad or m]; distances are taken in
            these units, so that a joint that hardly moves counts as much as one that moves widely.
    """

    postures: Float[np.ndarray, "rows columns p"]
    scale: Float[np.ndarray, " p"]

    @classmethod
    def fit(cls, q: Any, grid: Any = (8, 8), seed: int = 0, updates: int | None = None) -> PostureSOM:
        """Train the map with MiniSom on standardised postures.

        MiniSom's settings: units start at postures drawn from the data; Gaussian neighbourhood on a rectangular grid,
        its width falling from half the longer side of the grid to 1 and the learning rate from 0.5 to 0.005, both by
        ``asymptotic_decay``; samples in random order.

        Args:
            q: (samples, p) postures [rad or m].
            grid: (rows, columns) of units.
            seed: Of the initial units and the order of the samples.
            updates: Samples presented; by default 100 for each unit.

        Returns:
            The trained map.

        Raises:
            InvalidArray: Not floats of shape (samples, p), or not finite.
            InvalidRecording: No posture to train on.
            InvalidConfig: A bad grid or number of updates.
        """
        from minisom import MiniSom

        rows, columns = grid_shape("posture_grid", grid)
        updates = _UPDATES_PER_UNIT * rows * columns if updates is None else whole("updates", updates, 1)
        data = _checked(q)
        if len(data) == 0:
            raise InvalidRecording("no posture to train the posture map on; the recording needs samples that touch")
        mean, scale = data.mean(axis=0), data.std(axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        standardised = (data - mean) / scale
        width = max(1.0, max(rows, columns) / 2)
        som = MiniSom(rows, columns, data.shape[1], sigma=width, learning_rate=0.5, random_seed=seed)
        som.random_weights_init(standardised)
        som.train(standardised, updates, random_order=True)
        return cls(postures=som.get_weights() * scale + mean, scale=scale)

    def winners(self, q: Any) -> Int[np.ndarray, " samples"]:
        """Unit nearest to each posture, row * columns + column; the first one on ties.

        Args:
            q: (samples, p) postures [rad or m].

        Raises:
            InvalidArray: Not finite floats of shape (samples, p).
        """
        units = self.postures.reshape(-1, self.postures.shape[-1]) / self.scale
        felt = _checked(q)
        if felt.shape[1] != units.shape[1]:
            raise InvalidArray(f"postures have {felt.shape[1]} joints, the posture map {units.shape[1]}")
        # |q - u|^2 without |q|^2, which is the same for every unit.
        distances: Float[np.ndarray, "samples units"] = (units**2).sum(axis=1) - 2.0 * (felt / self.scale) @ units.T
        return np.asarray(distances.argmin(axis=1), dtype=np.int64)


def _checked(q: Any) -> Float[np.ndarray, "samples p"]:
    if np.ndim(q) != 2:
        raise InvalidArray(f"q has shape {np.shape(q)}; give postures of shape (samples, p)")
    checked = float_array("q", q, np.shape(q))
    if not np.isfinite(checked).all():
        raise InvalidArray("q holds NaN or infinite postures; leave padded samples out")
    return checked
