"""Results as JSON says them: numbers to the digits that count, not-a-number as null."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bodyimage_kin._files import write_text


def plain(value: Any, digits: int | None = None) -> Any:
    """Tables, lists and numbers within each other; what is not finite is None.

    Args:
        value: Anything that JSON can say, tuples and numbers that are not finite beside.
        digits: That count, of each number with a point; None: all.
    """
    if isinstance(value, Mapping):
        return {key: plain(item, digits) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, digits) for item in value]
    if isinstance(value, float):
        return rounded(value, digits)
    return value


def rounded(value: float, digits: int | None) -> float | None:
    """A number to so many digits that count (None: all of them); None where it is not finite."""
    if not math.isfinite(value):
        return None
    return value if digits is None else float(f"{value:.{digits}g}")


def write_json(path: Path, value: Any, indent: int = 1) -> None:
    """Writes a file, atomically; what is not finite is refused (:func:`plain` takes it out)."""
    write_text(path, json.dumps(value, indent=indent, allow_nan=False) + "\n")
