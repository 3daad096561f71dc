"""Whitening joint space by an inner product, and arithmetic that neither overflows nor divides by zero."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float

from bodyimage_kin._arrays import ArrayLike, Floats, as_float_array
from bodyimage_kin._checks import choice
from bodyimage_kin.errors import InvalidArray

Metric: TypeAlias = Literal["identity"] | ArrayLike
"""An inner product on joint space: ``"identity"``, or a symmetric matrix (p, p) such as a motion metric."""


def metric_root(metric: Metric, p: int) -> Float[np.ndarray, "p p"] | None:
    """The symmetric square root of a metric of joint space; None for the identity, which costs nothing.

    Raises:
        InvalidArray: Neither ``"identity"`` nor a finite, symmetric, positive semidefinite p x p matrix.
    """
    if metric is None or isinstance(metric, str):
        choice("metric", metric, ("identity",), error=InvalidArray)
        return None
    return square_root(metric, p)


def square_root(metric: ArrayLike, p: int) -> Float[np.ndarray, "p p"]:
    """The symmetric square root of a matrix.

    Raises:
        InvalidArray: The metric is not a finite, symmetric, positive semidefinite p x p matrix.
    """
    matrix = as_float_array(metric, "metric", ndim=2)
    if matrix.shape != (p, p):
        raise InvalidArray(f"metric has shape {matrix.shape}; {p} joints need ({p}, {p})")
    scale = np.abs(matrix).max()
    if not np.isfinite(scale) or np.abs(matrix - matrix.T).max() > 1e-9 * scale:
        raise InvalidArray("metric must be finite and symmetric")
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    if values[0] < -1e-9 * scale:
        raise InvalidArray(f"metric must be positive semidefinite; its least eigenvalue is {values[0]:.3g}")
    return np.asarray((vectors * np.sqrt(values.clip(min=0))) @ vectors.T)


def power_of_two(array: Floats) -> tuple[Floats, int]:
    """The array over the power of two that makes its largest entry about one, and the exponent: no digit is lost."""
    _, power = np.frexp(np.abs(array).max(initial=0, where=np.isfinite(array)))
    return (array if power == 0 else np.ldexp(array, -int(power))), int(power)


def ratio(numerator: ArrayLike, denominator: ArrayLike) -> Floats:
    """Their quotient, NaN where the denominator is zero or either is NaN."""
    top, bottom = np.broadcast_arrays(
        np.asarray(numerator, dtype=np.float64), np.asarray(denominator, dtype=np.float64)
    )
    return np.asarray(np.divide(top, bottom, out=np.full(top.shape, np.nan), where=bottom != 0))
