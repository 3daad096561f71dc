"""What every metric takes: arrays, tensors and lists of floats, checked once and turned into float64 numpy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Float

from bodyimage_kin._checks import choice
from bodyimage_kin.errors import InvalidArray

ArrayInput: TypeAlias = Any
"""A numpy array, torch tensor or xarray DataArray of floats, or nested lists of numbers."""

Metric: TypeAlias = Literal["identity"] | ArrayInput
"""An inner product on joint space: ``"identity"``, or a symmetric matrix (p, p) such as a motion metric."""

Floats: TypeAlias = Float[np.ndarray, "..."]

Field: TypeAlias = Callable[..., Any]
"""A function of postures (k, p), as float64 arrays, whose value is an array or tensor with k rows."""


def as_floats(value: ArrayInput, name: str, *, ndim: int = 0) -> Floats:
    """A float64 array of at least ``ndim`` axes, none of its last ``ndim`` empty.

    Raises:
        InvalidArray: It is not an array of floats, or has too few or empty axes.
    """
    try:
        array = np.asarray(value.detach() if hasattr(value, "detach") else value)
    except (TypeError, ValueError, RuntimeError) as error:
        raise InvalidArray(f"{name} is no array of floats ({error})") from error
    # A list has no dtype of its own, so whole numbers in it mean no more than a missing decimal point.
    if array.dtype.kind != "f" and (array.dtype.kind not in "iu" or hasattr(value, "dtype")):
        raise InvalidArray(f"{name} holds {array.dtype}, not floats; convert it to float64")
    if array.ndim < ndim or 0 in array.shape[array.ndim - ndim :]:
        raise InvalidArray(f"{name} has shape {array.shape}; it needs at least {ndim} axes, the last {ndim} not empty")
    return array.astype(np.float64, copy=False)


def as_pair(first: ArrayInput, second: ArrayInput, names: tuple[str, str], *, ndim: int) -> tuple[Floats, Floats]:
    """Two float64 arrays of one shape.

    Raises:
        InvalidArray: One of them is no such array, or their shapes differ.
    """
    one, other = as_floats(first, names[0], ndim=ndim), as_floats(second, names[1], ndim=ndim)
    if one.shape != other.shape:
        raise InvalidArray(f"{names[0]} has shape {one.shape} but {names[1]} {other.shape}; they must be the same")
    return one, other


def as_weights(value: ArrayInput | None, shape: tuple[int, ...]) -> Floats:
    """Non-negative weights of the given shape: a mask, counts or floats; ones when None.

    Raises:
        InvalidArray: Another shape, or a weight that is negative or not finite.
    """
    if value is None:
        return np.ones(shape)
    try:
        weights = np.asarray(value.detach() if hasattr(value, "detach") else value).astype(np.float64)
    except (TypeError, ValueError, RuntimeError) as error:
        raise InvalidArray(f"weights are no array of numbers ({error})") from error
    if weights.shape != shape:
        raise InvalidArray(f"weights have shape {weights.shape}; give one number a taxel, {shape}")
    if not (np.isfinite(weights) & (weights >= 0)).all():
        raise InvalidArray("weights must be finite and not negative")
    return weights


def metric_root(metric: Metric, p: int) -> Float[np.ndarray, "p p"] | None:
    """The symmetric square root of a metric of joint space; None for the identity, which costs nothing.

    Raises:
        InvalidArray: Neither ``"identity"`` nor a finite, symmetric, positive semidefinite p x p matrix.
    """
    if metric is None or isinstance(metric, str):
        choice("metric", metric, ("identity",), error=InvalidArray)
        return None
    return square_root(metric, p)


def square_root(metric: ArrayInput, p: int) -> Float[np.ndarray, "p p"]:
    """The symmetric square root of a matrix.

    Raises:
        InvalidArray: The metric is not a finite, symmetric, positive semidefinite p x p matrix.
    """
    matrix = as_floats(metric, "metric", ndim=2)
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


def ratio(numerator: ArrayInput, denominator: ArrayInput) -> Floats:
    """Their quotient, NaN where the denominator is zero or either is NaN."""
    top, bottom = np.broadcast_arrays(
        np.asarray(numerator, dtype=np.float64), np.asarray(denominator, dtype=np.float64)
    )
    return np.asarray(np.divide(top, bottom, out=np.full(top.shape, np.nan), where=bottom != 0))


def answer(function: Field, what: str, shape: tuple[int, ...], *postures: Floats) -> Floats:
    """The value of a user's function of postures, known to have the right shape.

    Raises:
        InvalidArray: It is no array of floats of that shape; ``what`` names it.
    """
    values = as_floats(function(*postures), f"the value of {what}")
    if values.shape != shape:
        raise InvalidArray(f"the value of {what} has shape {values.shape}; it must be {shape}")
    return values
