"""One way to read a setting: each check returns the value as plain Python, or names the field and the remedy.

Whole numbers are numbers everywhere; booleans and text are not. What a check raises is
:class:`~bodyimage_kin.errors.InvalidConfig` unless its caller asks for another class.
"""

from __future__ import annotations

import math
import numbers
import operator
from collections.abc import Iterable
from typing import Any, NoReturn

from bodyimage_kin.errors import BodyImageKinError, InvalidConfig

_MOST_SHOWN = 80


def number(
    field: str,
    value: object,
    *,
    least: float = -math.inf,
    most: float = math.inf,
    above: float | None = None,
    below: float | None = None,
    error: type[BodyImageKinError] = InvalidConfig,
) -> float:
    """A finite number within its bounds.

    Args:
        field: Its name in an error.
        value: What was given: an int, a float, or a number of numpy's or torch's without dimensions.
        least: It may be this, or more.
        most: It may be this, or less.
        above: It must be more than this.
        below: It must be less than this.
        error: Class of the error.

    Raises:
        error: Not a number (a bool or a text is none), not finite, or out of bounds.
    """
    found = _real(value)
    inside = found is not None and least <= found <= most and math.isfinite(found)
    if not inside or (above is not None and not found > above) or (below is not None and not found < below):  # type: ignore[operator]
        refuse(field, value, _bounds("a number", least, most, above, below), error)
    return float(found)  # type: ignore[arg-type]


def whole(
    field: str,
    value: object,
    *,
    least: int | None = None,
    most: int | None = None,
    error: type[BodyImageKinError] = InvalidConfig,
) -> int:
    """A whole number within its bounds; 3.0 is none, for what counts is written without a point.

    Args:
        field: Its name in an error.
        value: What was given.
        least: It may be this, or more.
        most: It may be this, or less.
        error: Class of the error.

    Raises:
        error: Not a whole number, or out of bounds.
    """
    try:
        found = None if _is_flag(value) else operator.index(value)  # type: ignore[arg-type]
    except (TypeError, RuntimeError, ValueError):
        found = None
    if found is None or (least is not None and found < least) or (most is not None and found > most):
        low, high = (-math.inf if least is None else float(least)), (math.inf if most is None else float(most))
        refuse(field, value, _bounds("a whole number", low, high, None, None), error)
    return found


def flag(field: str, value: object, *, error: type[BodyImageKinError] = InvalidConfig) -> bool:
    """True or false, and nothing that merely counts as one.

    Raises:
        error: Anything but a bool.
    """
    if not _is_flag(value):
        refuse(field, value, "true or false", error)
    return bool(value)


def choice(field: str, value: object, valid: Iterable[str], *, error: type[BodyImageKinError] = InvalidConfig) -> str:
    """One of a setting's valid names.

    Raises:
        error: Another one; lists the valid ones.
    """
    names = tuple(valid)
    if not isinstance(value, str) or value not in names:
        refuse(field, value, "one of " + ", ".join(map(repr, names)), error)
    return value


def text(field: str, value: object, *, error: type[BodyImageKinError] = InvalidConfig) -> str:
    """Text that is not empty.

    Raises:
        error: Anything else.
    """
    if not isinstance(value, str) or not value:
        refuse(field, value, "a text that is not empty", error)
    return value


def numbers_of(
    field: str,
    value: object,
    count: int | None = None,
    *,
    error: type[BodyImageKinError] = InvalidConfig,
    **bounds: Any,
) -> tuple[float, ...]:
    """Several numbers, each within the bounds of :func:`number`.

    Args:
        field: Its name in an error.
        value: A list, a tuple, or an array of one axis.
        count: How many there must be; None: any number.
        error: Class of the error.
        bounds: As of :func:`number`.

    Raises:
        error: No list of so many numbers.
    """
    wanted = "a list of numbers" if count is None else f"{count} numbers"
    if isinstance(value, str | bytes):
        refuse(field, value, wanted, error)
    try:
        items = list(value)  # type: ignore[call-overload]
    except TypeError:
        refuse(field, value, wanted, error)
    if count is not None and len(items) != count:
        refuse(field, value, wanted, error)
    return tuple(number(f"{field}[{index}]", item, error=error, **bounds) for index, item in enumerate(items))


def refuse(field: str, value: object, wanted: str, error: type[BodyImageKinError] = InvalidConfig) -> NoReturn:
    """Raises the error of a field: what was given, cut to a line, and what to give."""
    shown = repr(value)
    shown = " ".join(shown.split())
    shown = shown if len(shown) <= _MOST_SHOWN else shown[: _MOST_SHOWN - 3] + "..."
    raise error(f"{field}={shown}: give {wanted}")


def _real(value: object) -> float | None:
    """The value as a float; None where it is no number."""
    if _is_flag(value) or isinstance(value, str | bytes):
        return None
    if not isinstance(value, numbers.Real) and getattr(value, "shape", None) != ():
        return None
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError, RuntimeError):
        return None


def _is_flag(value: object) -> bool:
    return isinstance(value, bool) or str(getattr(value, "dtype", "")) in ("bool", "torch.bool")


def _bounds(kind: str, least: float, most: float, above: float | None, below: float | None) -> str:
    said = []
    if math.isfinite(least):
        said.append(f"of at least {_plain(least)}")
    if above is not None:
        said.append(f"above {_plain(above)}")
    if math.isfinite(most):
        said.append(f"at most {_plain(most)}")
    if below is not None:
        said.append(f"below {_plain(below)}")
    return " ".join([kind, " and ".join(said)]) if said else kind


def _plain(bound: float) -> str:
    """A bound as people write it: 1000000 and 0.25, not 1e+06."""
    return f"{bound:.0f}" if bound == round(bound) and abs(bound) < 1e12 else f"{bound:g}"
