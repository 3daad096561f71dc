"""The one coercer: tensors, arrays and lists of numbers in, checked float tensors or arrays out.

Whole numbers are numbers: lists and arrays of them become float64. Booleans, text, complex and sparse values are no
numbers, and are refused with an error that names the thing.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import torch
from jaxtyping import Float, Shaped

from bodyimage_kin.errors import BodyImageKinError, InvalidArray, InvalidPosture

ArrayLike: TypeAlias = Any
"""A tensor, a numpy array, an xarray DataArray or (nested) lists of numbers; checked at run time by our own errors."""

Floats: TypeAlias = Float[np.ndarray, "..."]
"""A float64 numpy array of any shape."""

_REMEDY = "give numbers: a tensor, an array or a list"


def as_float_tensor(
    values: ArrayLike, what: str = "array", error: type[BodyImageKinError] = InvalidArray
) -> torch.Tensor:
    """The values as a float32 or float64 tensor, its gradient kept.

    float32 and float64 keep their dtype; float16, whole numbers and lists become float64.

    Args:
        values: Tensor, array or nested lists of numbers, of any shape.
        what: Its name in an error.
        error: Class of the error.

    Raises:
        error: Booleans, text, complex or sparse values, or something that is no array at all.
    """
    if isinstance(values, torch.Tensor):
        if values.layout != torch.strided:
            raise error(f"{what} is a sparse tensor ({values.layout}); give a dense one: .to_dense()")
        if values.dtype in (torch.float32, torch.float64):
            return values
        if values.dtype == torch.bool or values.is_complex() or values.is_quantized:
            raise error(f"{what} holds {str(values.dtype).removeprefix('torch.')}, not numbers; {_REMEDY}")
        return values.to(torch.float64)
    array = _numbers(values, what, error)
    if array.dtype not in (np.float32, np.float64):
        array = array.astype(np.float64)
    if not array.flags.writeable or any(stride < 0 for stride in array.strides) or not array.dtype.isnative:
        array = array.astype(array.dtype.newbyteorder("="))
    return torch.from_numpy(array)


def as_float_array(
    values: ArrayLike,
    what: str = "array",
    *,
    ndim: int = 0,
    shapes: tuple[tuple[int, ...], ...] = (),
    error: type[BodyImageKinError] = InvalidArray,
) -> Float[np.ndarray, "..."]:
    """The values as a float64 numpy array without a gradient (a copy only where needed).

    Args:
        values: Tensor, array, DataArray or nested lists of numbers.
        what: Its name in an error.
        ndim: Least number of axes; none of the last ``ndim`` may be empty.
        shapes: Shapes that are accepted; none: every shape.
        error: Class of the error.

    Raises:
        error: No numbers, or of another shape.
    """
    if isinstance(values, torch.Tensor):
        values = as_float_tensor(values, what, error).detach().cpu().numpy()
    array = _numbers(values, what, error).astype(np.float64, copy=False)
    if array.ndim < ndim or 0 in array.shape[array.ndim - ndim :]:
        raise error(f"{what} has shape {array.shape}; it needs at least {ndim} axes, the last {ndim} not empty")
    if shapes and array.shape not in shapes:
        raise error(f"{what} has shape {array.shape}; give {' or '.join(map(str, shapes))}")
    return array


def as_pair(
    first: ArrayLike, second: ArrayLike, names: tuple[str, str], *, ndim: int = 0
) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
    """Two float64 numpy arrays of one shape.

    Args:
        first: As of :func:`as_float_array`.
        second: Likewise.
        names: Theirs, in an error.
        ndim: Least number of axes; none of the last ``ndim`` may be empty.

    Raises:
        InvalidArray: One of them is no such array, or their shapes differ.
    """
    one, other = as_float_array(first, names[0], ndim=ndim), as_float_array(second, names[1], ndim=ndim)
    if one.shape != other.shape:
        raise InvalidArray(f"{names[0]} has shape {one.shape} but {names[1]} {other.shape}; they must be the same")
    return one, other


def as_postures(q: ArrayLike, n: int, what: str = "posture q") -> torch.Tensor:
    """Postures as a tensor ``(*batch, n)``; finiteness is checked where they are used.

    Raises:
        InvalidPosture: No numbers, or a last axis that is not of length n (it is never broadcast).
    """
    tensor = as_float_tensor(q, what, InvalidPosture)
    if tensor.ndim == 0 or tensor.shape[-1] != n:
        raise InvalidPosture(f"{what} has shape {tuple(tensor.shape)}; its last axis must have {n} joint values")
    return tensor


def refuse_not_finite(
    q: torch.Tensor, what: str = "posture q", error: type[BodyImageKinError] = InvalidPosture
) -> None:
    """Raises the error when a value is NaN or infinite."""
    # One reduction: a sum of zeros is zero, a NaN or an infinity times zero is not.
    if not bool((q * 0.0).sum() == 0.0):
        bad = int((~torch.isfinite(q)).reshape(-1, q.shape[-1]).any(-1).sum())
        raise error(f"{what} has NaN or infinite values in {bad} of {q[..., 0].numel()} postures")


def to_numpy(values: ArrayLike) -> np.ndarray[Any, np.dtype[np.float64]]:
    """The values as a float64 numpy array without a gradient (a copy only where needed)."""
    return as_float_array(values)


def _numbers(values: ArrayLike, what: str, error: type[BodyImageKinError]) -> Shaped[np.ndarray, "..."]:
    """As a numpy array of real numbers."""
    try:
        array = np.asarray(values)
        if array.dtype == object:
            if not isinstance(values, list | tuple):
                raise TypeError(f"it is {type(values).__name__}")
            # A list of tensors: numpy only wraps them.
            array = np.asarray([as_float_array(item, what, error=error) for item in values])
    except (TypeError, ValueError, RuntimeError) as problem:
        said = str(problem).splitlines()[0] if str(problem) else type(problem).__name__
        raise error(f"{what} is no array of numbers ({said}); {_REMEDY}") from None
    if array.dtype.kind not in "fiu":
        raise error(f"{what} holds {array.dtype}, not numbers; {_REMEDY}")
    # Among numbers numpy takes a boolean for 1 or 0.
    if isinstance(values, list | tuple) and _has_flag(values):
        raise error(f"{what} holds a bool, not numbers; {_REMEDY}")
    return array


def _has_flag(values: list[Any] | tuple[Any, ...]) -> bool:
    return any(
        _has_flag(value) if isinstance(value, list | tuple) else isinstance(value, bool | np.bool_) for value in values
    )
