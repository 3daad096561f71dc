"""Attributes in NetCDF: what its files hold is written as it is, the rest as JSON, and all come back the same."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from bodyimage_kin.errors import InvalidRecording

_JSON = "json:"
_OF_HDF5 = ("CLASS", "NAME", "DIMENSION_LIST", "DIMENSION_LABELS", "REFERENCE_LIST", "coordinates", "dtype")
"""Names that HDF5, NetCDF and xarray keep for themselves, beside all that begin with an underscore."""
_LONGEST = 60_000
"""Bytes of a text; an HDF5 file holds no more than 64 kB in an attribute."""


def encoded(where: str, attributes: Mapping[Any, Any]) -> dict[str, Any]:
    """Attributes as NetCDF can hold them.

    Args:
        where: Whose they are, in an error.
        attributes: Text, numbers, booleans, None, and lists and tables of these. A tuple comes back as a list.

    Raises:
        InvalidRecording: One that no file can hold; names it.
    """
    found = {}
    for name, value in attributes.items():
        if (
            not isinstance(name, str)
            or not name
            or not _is_plain(name)
            or name in _OF_HDF5
            or name.startswith(("_", _JSON))
        ):
            raise InvalidRecording(f"{where}: no file can hold an attribute named {name!r}; name it otherwise")
        if not _is_native(value):
            try:
                value = _JSON + json.dumps(_known_to_json(value))
            except (TypeError, ValueError, RecursionError):
                raise InvalidRecording(
                    f"{where}: attribute '{name}' is {type(value).__name__}; give text, numbers, lists or tables"
                ) from None
        if isinstance(value, str) and len(value.encode()) > _LONGEST:
            raise InvalidRecording(f"{where}: attribute '{name}' has more than {_LONGEST} bytes; keep it elsewhere")
        found[name] = value
    return found


def decoded(attributes: Mapping[Any, Any]) -> dict[str, Any]:
    """Attributes as they were before :func:`encoded`."""
    found = {}
    for name, value in attributes.items():
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, str) and value.startswith(_JSON):
            # What is no JSON is somebody else's text.
            with contextlib.suppress(ValueError, RecursionError):
                value = json.loads(value.removeprefix(_JSON))
        found[str(name)] = value
    return found


def _is_native(value: object) -> bool:
    """Whether NetCDF holds a value as it is, and xarray gives it back."""
    if isinstance(value, str):
        return bool(value) and _is_plain(value) and not value.startswith(_JSON)
    if isinstance(value, np.ndarray):
        return value.ndim == 1 and value.size > 1 and value.dtype in (np.float64, np.int64)
    return isinstance(value, float) or (isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**63)


def _is_plain(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return "\0" not in text


def _known_to_json(value: Any) -> Any:
    """The value, once it is known that JSON gives it back."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if value is None or isinstance(value, bool | str | int | float):
        return value
    if isinstance(value, list | tuple):
        return [_known_to_json(item) for item in value]
    if isinstance(value, dict) and all(isinstance(key, str) for key in value):
        return {key: _known_to_json(item) for key, item in value.items()}
    raise TypeError
