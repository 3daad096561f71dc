"""Functions of postures that a user gives: images, Jacobians, displacements; asked, and their answers checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from bodyimage_kin._arrays import ArrayLike, Floats, as_float_array

_CHUNK = 1 << 16  # postures asked for at once

Field: TypeAlias = Callable[..., ArrayLike]
"""A function of postures (k, p), float64 arrays, whose value is an array or tensor with k rows."""


def answer(function: Field, what: str, shape: tuple[int, ...], *postures: Floats) -> Floats:
    """The value of a function of postures, known to have the right shape.

    Raises:
        InvalidArray: It is no array of numbers of that shape; ``what`` names it.
    """
    return as_float_array(function(*postures), f"the value of {what}", shapes=(shape,))


def line_integrals(
    jacobian: Field, what: str, start: Floats, end: Floats, nodes: int, m: int
) -> Float[np.ndarray, "k m"]:
    """The integral of the Jacobian along each straight line in joint space, by Gauss-Legendre quadrature."""
    places, weights = np.polynomial.legendre.leggauss(nodes)
    places, weights = (places[:, None, None] + 1) / 2, weights / 2
    found = np.empty((len(start), m))
    at_once = max(1, _CHUNK // nodes)
    for begin in range(0, len(start), at_once):
        some = slice(begin, begin + at_once)
        line = end[some] - start[some]
        postures = (start[some] + places * line).reshape(-1, line.shape[-1])
        J = answer(jacobian, what, (len(postures), m, line.shape[-1]), postures)
        found[some] = np.einsum("n,nkmp,kp->km", weights, J.reshape(nodes, len(line), m, -1), line, optimize=True)
    return found
