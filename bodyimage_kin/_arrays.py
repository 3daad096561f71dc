"""How the public functions take arrays: tensors, numpy arrays and lists of floats in, checked tensors out."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import torch

from bodyimage_kin.errors import BodyImageKinError, InvalidArray, InvalidPosture

ArrayLike: TypeAlias = Any
"""A tensor, a numpy array or (nested) lists of floats; what is taken is checked at run time by our own typed errors."""


def as_float_tensor(
    values: ArrayLike, what: str = "array", error: type[BodyImageKinError] = InvalidArray
) -> torch.Tensor:
    """The values as a float32 or float64 tensor, its gradient kept.

    Tensors and arrays keep their dtype, which must be float32 or float64 (integers are refused: they are mostly a
    mistake, and would not carry a gradient). Lists become float64.

    Args:
        values: Tensor, array or nested lists of numbers, of any shape.
        what: Its name in an error.
        error: Class of the error.

    Raises:
        error: For another dtype, or something that is no array at all.
    """
    if isinstance(values, torch.Tensor):
        tensor = values
    elif isinstance(values, np.ndarray):
        if values.dtype not in (np.float32, np.float64):
            raise error(f"{what} has dtype {values.dtype}; give float64 (or float32)")
        if not values.flags.writeable or any(stride < 0 for stride in values.strides):
            values = values.copy()
        tensor = torch.from_numpy(values)
    else:
        try:
            tensor = torch.from_numpy(np.asarray(values, dtype=np.float64))
        except (TypeError, ValueError) as problem:
            raise error(f"{what} is no array of floats ({problem}); give a tensor, an array or a list") from None
    if tensor.dtype not in (torch.float32, torch.float64):
        raise error(f"{what} has dtype {str(tensor.dtype).removeprefix('torch.')}; give float64 (or float32)")
    return tensor


def as_postures(q: ArrayLike, n: int, what: str = "posture q") -> torch.Tensor:
    """Postures as a tensor ``(*batch, n)``; finiteness is checked where they are used.

    Raises:
        InvalidPosture: Not a float array, or a last axis that is not of length n (it is never broadcast).
    """
    tensor = as_float_tensor(q, what, InvalidPosture)
    if tensor.ndim == 0 or tensor.shape[-1] != n:
        raise InvalidPosture(f"{what} has shape {tuple(tensor.shape)}; its last axis must have {n} joint values")
    return tensor


def refuse_not_finite(q: torch.Tensor, what: str = "posture q") -> None:
    """Raises InvalidPosture when a value is NaN or infinite."""
    # One reduction: a sum of zeros is zero, a NaN or an infinity times zero is not.
    if not bool((q * 0.0).sum() == 0.0):
        bad = int((~torch.isfinite(q)).reshape(-1, q.shape[-1]).any(-1).sum())
        raise InvalidPosture(f"{what} has NaN or infinite values in {bad} of {q[..., 0].numel()} postures")


def to_numpy(values: ArrayLike) -> np.ndarray[Any, np.dtype[np.float64]]:
    """The values as a float64 numpy array without a gradient (a copy only where needed)."""
    return as_float_tensor(values).detach().cpu().numpy().astype(np.float64, copy=False)
