"""Attributes as values: what every parser of the field takes for a number, and nothing else."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Final

from bodyimage_kin.robot import transforms
from bodyimage_kin.robot._wording import amount, quote
from bodyimage_kin.robot.transforms import Vector

if TYPE_CHECKING:
    from bodyimage_kin.robot._xml import Element

# Python's float would also take 1_0, nan and digits of other scripts.
NUMBER: Final = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
MIN_NORM: Final = 1e-9
"""An axis or a quaternion shorter than this has no direction."""
_SPACE: Final = " \t\r\n"
_REMEDIES: Final = (
    (re.compile(r"[+-]?(?:nan|inf)", re.IGNORECASE), "numbers must be finite"),
    (re.compile(r"[+-]?0x", re.IGNORECASE), "write it in decimal, not hexadecimal"),
    (re.compile(r"[^,]*,"), "write decimals with a point, and spaces between numbers"),
    (re.compile(r"[0-9+-]*_"), "write it without underscores"),
)


def attribute(element: Element, key: str) -> str | None:
    """An attribute as it stands in the file; None when it does not.

    Raises:
        InvalidURDF: xacro has left an expression in it.
    """
    value = element.attributes.get(key)
    if value is not None and ("${" in value or "$(" in value):
        element.refuse(f"a leftover expression in {key}={quote(value)}", "expand it with xacro")
    return value


def required(element: Element, key: str) -> str:
    """An attribute that must be there and say something."""
    value = attribute(element, key)
    if value is None:
        element.refuse(f"<{element.tag}> has no {key}", f'write {key}="..."')
    if not value.strip():
        element.refuse(f"<{element.tag}> has an empty {key}", "fill it in")
    return value


def number(element: Element, key: str, default: float | None = None) -> float:
    """One finite number; without a default it must be there."""
    found = numbers(element, key, 1)
    if found is not None:
        return found[0]
    if default is None:
        element.refuse(f"<{element.tag}> has no {key}", f'write {key}="..."')
    return default


def vector(element: Element, key: str) -> Vector | None:
    """Three finite numbers; None when there is no such attribute."""
    found = numbers(element, key, 3)
    return (found[0], found[1], found[2]) if found else None


def placement(element: Element | None) -> tuple[Vector, Vector]:
    """Position [m] and roll, pitch, yaw [rad] of an ``<origin>``, zeros without one.

    Raises:
        InvalidURDF: No numbers, an orientation given twice, or a quaternion of no direction.
    """
    zero = (0.0, 0.0, 0.0)
    if element is None:
        return zero, zero
    xyz, rpy = vector(element, "xyz") or zero, vector(element, "rpy")
    quaternion = numbers(element, "quat_xyzw", 4)
    if quaternion is None:
        return xyz, rpy or zero
    if rpy is not None:
        element.refuse("<origin> has both rpy and quat_xyzw", "keep one")
    norm = math.hypot(*quaternion)
    if not MIN_NORM <= norm < math.inf:
        element.refuse(f"the quaternion has no direction: its norm is {norm!r}", "give one of norm 1")
    return xyz, transforms.matrix_rpy(transforms.quaternion_matrix(quaternion))


def numbers(element: Element, key: str, *counts: int) -> list[float] | None:
    """Finite numbers, as many as one of the counts says; None when there is no such attribute.

    Raises:
        InvalidURDF: Anything else.
    """
    text = attribute(element, key)
    if text is None:
        return None
    place = f"<{element.tag}> {key}={quote(text)}"
    most, wanted = max(counts), " or ".join(map(str, counts))
    words = re.split(f"[{_SPACE}]+", text.strip(_SPACE), maxsplit=most)
    if words == [""]:
        element.refuse(f"{place} is empty", f"leave {key} out, or give {amount(most)}")
    found = []
    for word in words[:most]:
        if not NUMBER.fullmatch(word):
            remedy = next((remedy for pattern, remedy in _REMEDIES if pattern.match(word)), "")
            element.refuse(f"{place}: {quote(word)} is not a number", remedy)
        found.append(float(word))
        if math.isinf(found[-1]):
            element.refuse(f"{place}: {quote(word)} is too large for a float64", "numbers must be finite")
    if len(words) not in counts:
        given = f"more than {amount(most)}" if len(words) > most else amount(len(words))
        element.refuse(f"{place} has {given}", f"give {wanted}")
    return found
