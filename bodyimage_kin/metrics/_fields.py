"""Functions of postures that a user gives: images, Jacobians, displacements; asked, and their answers checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from bodyimage_kin._arrays import ArrayLike, Floats, as_float_array

Field: TypeAlias = Callable[..., ArrayLike]
"""A function of postures (k, p), float64 arrays, whose value is an array or tensor with k rows."""


def answer(function: Field, what: str, shape: tuple[int, ...], *postures: Floats) -> Floats:
    """The value of a function of postures, known to have the right shape.

    Raises:
        InvalidArray: It is no array of numbers of that shape; ``what`` names it.
    """
    return as_float_array(function(*postures), f"the value of {what}", shapes=(shape,))
