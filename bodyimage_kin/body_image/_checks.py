"""What integration and maps ask of their inputs, with the errors that say what is missing."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float, Shaped

from bodyimage_kin._arrays import as_float_array
from bodyimage_kin.errors import InvalidArray, InvalidConfig, InvalidRecording


def choice(field: str, value: object, valid: tuple[str, ...]) -> None:
    """Refuse a setting that is none of its valid names.

    Raises:
        InvalidConfig: It is not; lists the valid ones.
    """
    if value not in valid:
        raise InvalidConfig(f"{field}={value!r} is not known; valid: {', '.join(valid)}")


def number(field: str, value: Any, lower: float, upper: float = np.inf, *, open_below: bool = False) -> float:
    """Return a finite number within [lower, upper], or (lower, upper] when ``open_below``.

    Raises:
        InvalidConfig: It is no number, or outside.
    """
    bracket = "(" if open_below else "["
    try:
        result = float(value)
    except (TypeError, ValueError):
        result = np.nan
    inside = lower < result <= upper if open_below else lower <= result <= upper
    if not (np.isfinite(result) and inside):
        raise InvalidConfig(f"{field}={value!r}; give a finite number in {bracket}{lower:g}, {upper:g}]")
    return result


def whole(field: str, value: Any, lower: int, upper: int | None = None) -> int:
    """Return a whole number of at least ``lower`` (and below ``upper``).

    Raises:
        InvalidConfig: It is not.
    """
    right_kind = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not right_kind or value < lower or (upper is not None and value >= upper):
        bound = f"at least {lower}" + ("" if upper is None else f" and below {upper}")
        raise InvalidConfig(f"{field}={value!r}; give a whole number, {bound}")
    return int(value)


def grid_shape(field: str, value: Any) -> tuple[int, int]:
    """Return (rows, columns).

    Raises:
        InvalidConfig: Not two whole numbers of at least 1.
    """
    try:
        rows, columns = value
    except (TypeError, ValueError):
        raise InvalidConfig(f"{field}={value!r}; give (rows, columns)") from None
    return whole(f"{field} rows", rows, 1), whole(f"{field} columns", columns, 1)


def float_array(name: str, value: Any, *shapes: tuple[int, ...]) -> Float[np.ndarray, "..."]:
    """Return ``value`` as float64, of one of the given shapes.

    Raises:
        InvalidArray: Not floats, or of another shape; names the valid shapes.
    """
    if hasattr(value, "detach"):
        value = value.detach().cpu()
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        raise InvalidArray(f"{name} is no array; give floats of shape {_shapes(shapes)}") from None
    if array.dtype.kind != "f":
        raise InvalidArray(f"{name} holds {array.dtype}, not floats; give floats of shape {_shapes(shapes)}")
    if array.shape not in shapes:
        raise InvalidArray(f"{name} has shape {array.shape}; give {_shapes(shapes)}")
    return array.astype(np.float64)


def _shapes(shapes: tuple[tuple[int, ...], ...]) -> str:
    return " or ".join(str(shape) for shape in shapes)


def variable(exp: Any, name: str, *dims: str) -> Shaped[np.ndarray, "..."]:
    """Return a variable of a recording or experience, its axes in the order of ``dims``.

    Raises:
        InvalidRecording: No dataset, or it lacks the variable, or the variable has other dimensions.
    """
    if not isinstance(exp, xr.Dataset):
        raise InvalidRecording(f"a recording is an xarray.Dataset, not {type(exp).__name__}")
    if name not in exp:
        present = ", ".join(str(key) for key in exp.data_vars) or "(none)"
        raise InvalidRecording(f"the recording has no variable {name!r}; it has: {present}")
    if set(exp[name].dims) != set(dims):
        raise InvalidRecording(f"{name!r} has dimensions {exp[name].dims}; they must be {dims}")
    return exp[name].transpose(*dims).to_numpy()


def postures(exp: Any) -> Float[np.ndarray, "trial time p"]:
    """Return the felt postures [rad or m], NaN where padded.

    Raises:
        InvalidRecording: Not one sample with a posture.
    """
    q = as_float_array(variable(exp, "q", "trial", "time", "joint"), "variable 'q'", error=InvalidRecording)
    if q.shape[-1] == 0:
        raise InvalidRecording("the recording has no joint: variable 'q' is empty")
    for name in ("trial", "time", "axis"):
        if name in exp.coords and exp[name].dims != (name,):
            raise InvalidRecording(f"coordinate '{name}' has dimensions {exp[name].dims}; it must have ('{name}',)")
    if not np.isfinite(q).all(axis=-1).any():
        raise InvalidRecording("the recording has no samples: not one posture q is finite")
    return q
