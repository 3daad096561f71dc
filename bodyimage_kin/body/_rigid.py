"""Rigid transforms that users give: checked once, where they enter."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin._checks import refuse
from bodyimage_kin.errors import InvalidConfig

_ROUNDING, _TYPED = 1e-14, 1e-6
"""How far from orthogonal a rotation is by rounding, and when it was typed with six digits."""


def rigid(field: str, value: ArrayLike) -> Float[np.ndarray, "4 4"]:
    """A 4x4 transform of a rotation and a translation [m], copied.

    A rotation that is orthogonal to six digits only, as one copied from a table is, becomes the nearest exact one.

    Args:
        field: Its name in an error.
        value: What was given.

    Raises:
        InvalidConfig: Not 4x4, not finite, a last row other than 0 0 0 1, or a rotation that is none.
    """
    matrix = as_float_array(value, field, shapes=((4, 4),), error=InvalidConfig).copy()
    if not np.isfinite(matrix).all():
        raise InvalidConfig(f"{field} has values that are not finite; give a 4x4 transform of rotation and translation")
    if not np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0]):
        refuse(f"{field}[3]", matrix[3].tolist(), "0, 0, 0, 1: the last row of a 4x4 transform")
    rotation = matrix[:3, :3]
    off = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if off > _TYPED:
        raise InvalidConfig(
            f"{field}: the columns of its rotation are not orthogonal unit vectors (off by {off:.1g}); give a rotation"
        )
    if np.linalg.det(rotation) < 0.0:
        raise InvalidConfig(f"{field}: its rotation mirrors (determinant -1); turn one axis round")
    if off > _ROUNDING:
        left, _, right = np.linalg.svd(rotation)
        matrix[:3, :3] = left @ right
    return matrix
