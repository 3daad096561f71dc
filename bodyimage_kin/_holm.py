"""P-values of comparisons made together: for scores of maps and statistics of studies alike, hence in no room."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from bodyimage_kin.errors import InvalidArray

__all__ = ["holm"]


def holm(p: Any) -> Float[np.ndarray, "comparisons"]:
    """P-values adjusted over comparisons made together, so that the chance of any false one stays below the level.

    Holm's step-down: the k-th smallest of n times n - k + 1, never less than a smaller one's, at most 1. A NaN is no
    comparison and stays NaN.

    Raises:
        InvalidArray: Not a row of numbers between 0 and 1.
    """
    try:
        values = np.asarray(p, dtype=np.float64)
    except (TypeError, ValueError) as problem:
        raise InvalidArray(f"p-values are no array of numbers ({problem})") from None
    made = np.isfinite(values)
    if values.ndim != 1 or ((values[made] < 0) | (values[made] > 1)).any():
        raise InvalidArray("p-values must be a row of numbers between 0 and 1")
    adjusted = np.full(values.shape, np.nan)
    order = np.flatnonzero(made)[np.argsort(values[made], kind="stable")]
    factors = np.arange(len(order), 0, -1)
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(values[order] * factors)) if len(order) else []
    return adjusted
