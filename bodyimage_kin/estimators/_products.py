"""Products of many small matrices with a wide one each: numpy's take a call for every pair."""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from jaxtyping import Float

from bodyimage_kin._compiled import compiled, compiles

__all__ = ["products"]


def products(
    left: Float[np.ndarray, "count m k"], right: Float[np.ndarray, "count k columns"]
) -> Float[np.ndarray, "count m columns"]:
    """``left @ right``."""
    if not compiles():
        return left @ right
    result = np.empty((*left.shape[:2], right.shape[2]))
    _multiply(np.ascontiguousarray(left), np.ascontiguousarray(right), result)
    return result


# no_type_check: a checker that wraps functions would hand numba the wrapper.


@compiled
@no_type_check
def _multiply(left, right, result):
    for row in range(left.shape[0]):
        for i in range(left.shape[1]):
            for column in range(right.shape[2]):
                result[row, i, column] = left[row, i, 0] * right[row, 0, column]
            for k in range(1, left.shape[2]):
                factor = left[row, i, k]
                for column in range(right.shape[2]):
                    result[row, i, column] += factor * right[row, k, column]
