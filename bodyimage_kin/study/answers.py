"""What learned Jacobians answer, known to be of the right shape and finite before it is scored."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from bodyimage_kin._arrays import as_float_array
from bodyimage_kin.errors import BodyImageKinError

__all__ = ["WrongResult", "answers", "checked", "jacobians"]

_CHUNK = 5000
"""Postures that are asked for at once: bounds the memory of wide probes."""
_LARGEST = 1e150
"""Beyond it a square is not finite, nor is any score."""


class WrongResult(BodyImageKinError):
    """What an estimator returned is no learned Jacobian of finite values."""


def checked(what: str, value: Any, shape: tuple[int, ...]) -> Float[np.ndarray, "..."]:
    """What an estimator answers, once its shape and values are known to be right.

    Raises:
        WrongResult: Of another shape, not finite, or too large to be scored.
    """
    values = as_float_array(value, what, error=WrongResult)
    if values.shape != shape:
        raise WrongResult(f"{what} has shape {values.shape}; it must be {shape}")
    for problem, sound in (("not finite", np.isfinite(values)), ("too large to be scored", abs(values) < _LARGEST)):
        wrong = int((~sound).reshape(len(values), -1).any(1).sum()) if values.size else 0
        if wrong:
            raise WrongResult(f"{what} is {problem} in {wrong} of {len(values)} postures")
    return values


def answers(of: Callable[..., Any], q: Float[np.ndarray, "postures p"]) -> Float[np.ndarray, "postures ..."]:
    """What a function of postures says, asked for few of them at a time."""
    return np.concatenate([as_float_array(of(part)) for part in torch.split(torch.from_numpy(q), _CHUNK)])


def jacobians(what: str, of: Callable[..., Any], q: torch.Tensor, m: int) -> Float[np.ndarray, "postures m p"]:
    """Jacobians at postures, few of them at a time.

    Raises:
        WrongResult: As :func:`checked`.
    """
    found = np.empty((len(q), m, q.shape[-1]))
    for part, here in zip(np.split(found, range(_CHUNK, len(q), _CHUNK)), torch.split(q, _CHUNK), strict=True):
        part[...] = checked(what, of(here), part.shape)
    return found
