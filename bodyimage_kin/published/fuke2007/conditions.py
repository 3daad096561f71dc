"""Results of the experiment by condition, as its claims and its page ask for them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float

from bodyimage_kin.published.fuke2007.grid import CONDITIONS, Condition

__all__ = ["Conditions"]


@dataclass(frozen=True, eq=False)
class Conditions:
    """Results of :func:`bodyimage_kin.published.fuke2007.grid`.

    Attributes:
        results: Of the study.
    """

    results: xr.Dataset

    def __iter__(self) -> Iterator[Condition]:
        return iter(CONDITIONS)

    @property
    def seeds(self) -> list[int]:
        """Of the recordings."""
        return [int(seed) for seed in self.results["seed"].values]

    def score(self, condition: str, estimator: str, name: str, **at: object) -> Float[np.ndarray, "seed ..."]:
        """A score of an estimator in a condition, one a recording.

        Args:
            condition: Name of the condition.
            estimator: Name of the estimator, whatever the condition makes of it.
            name: Of the score.
            at: Labels along its dimensions.
        """
        one = next(one for one in CONDITIONS if one.name == condition)
        return self.row(one.recording, one.row(estimator), name, **at)

    def row(self, recording: str, row: str, name: str, **at: object) -> Float[np.ndarray, "seed ..."]:
        """A score of a row of the study on one recording."""
        found = self.results[name].isel(embodiment=0).sel({"recording": recording, "estimator": row, **at})
        return found.transpose("seed", ...).values

    def fact(self, recording: str, name: str, **at: object) -> Float[np.ndarray, "seed ..."]:
        """A fact of a recording."""
        return self.results[name].isel(embodiment=0).sel({"recording": recording, **at}).transpose("seed", ...).values
