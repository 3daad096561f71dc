"""How objects show themselves: a line in a terminal, a small table in a notebook; of arrays their shape alone."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

_FEW = 4
"""Numbers, or things in a list, that are still written out."""
_LONGEST = 80
"""Characters of what is written of one value."""


class Shown:
    """A dataclass that shows what it is and what shape it has: its numbers are for computing, not for reading."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        # Before ``dataclass`` gives a class a repr of its own, which would print whole arrays.
        if "__repr__" not in vars(cls):
            cls.__repr__ = cls.__repr__  # type: ignore[method-assign]

    def _glance(self) -> str:
        """What it is, in a line: the first of the class's docstring."""
        return next(iter((inspect.getdoc(type(self)) or "").splitlines()), "")

    def _rows(self) -> dict[str, str]:
        """What is shown of it, by name: its fields."""
        fields = dataclasses.fields(self)  # type: ignore[arg-type]  # its subclasses are dataclasses
        return {field.name: brief(getattr(self, field.name)) for field in fields if field.repr}

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value}' for name, value in self._rows().items())})"

    def _repr_html_(self) -> str:
        return table(type(self).__name__, self._glance(), self._rows())


def table(name: str, glance: str, rows: Mapping[str, str]) -> str:
    """HTML for notebooks: a name in bold, a line, and a row for each property.

    Args:
        name: Of the thing or of its class.
        glance: What it is, in a line; docstrings' markup is taken off.
        rows: Property -> text.
    """
    plain = re.sub(r":\w+:`~?([^`]*)`", r"\1", glance).replace("``", "")
    cells = "".join(f"<tr><th>{escape(key)}</th><td>{escape(value)}</td></tr>" for key, value in rows.items())
    said = f"<b>{escape(name)}</b>" + (f": {escape(plain)}" if plain else "")
    return f"<p>{said}</p><table>{cells}</table>"


def brief(value: Any) -> str:
    """A value in a few words: of arrays and tables the shape, of long lists the number."""
    sizes = getattr(value, "sizes", None)
    if sizes is not None and hasattr(value, "dims"):  # xarray
        return f"{type(value).__name__} ({', '.join(f'{name} {size}' for name, size in sizes.items())})"
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return _array(value)
    if isinstance(value, bool | np.bool_) or value is None:
        return str(value)
    if isinstance(value, float | np.floating):
        return f"{value:.4g}"
    if isinstance(value, Mapping):
        inner = [f"{key}: {brief(one)}" for key, one in value.items()] if len(value) <= 2 * _FEW else []
        return _listed(inner, f"{len(value)} entries", "{}")
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        named = all(isinstance(one, str) for one in value)
        inner = [brief(one) for one in value] if len(value) <= (4 * _FEW if named else _FEW) else []
        kinds = ", ".join(sorted({type(one).__name__ for one in value}))
        brackets = "[]" if isinstance(value, list) else "()"
        return _listed(inner, f"{len(value)} of {kinds}" if value else "", brackets)
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    return _clipped(value if isinstance(value, str) else repr(value))


def _array(value: Any) -> str:
    shape = tuple(value.shape)
    if len(shape) <= 1 and int(np.prod(shape)) <= _FEW:
        written = value.tolist()
        return f"[{', '.join(map(brief, written))}]" if isinstance(written, list) else brief(written)
    return f"({', '.join(map(str, shape))}) {str(value.dtype).removeprefix('torch.')}"


def _listed(inner: Sequence[str], otherwise: str, brackets: str) -> str:
    said = ", ".join(inner)
    return f"{brackets[0]}{said if inner and len(said) <= 2 * _LONGEST else otherwise}{brackets[1]}"


def _clipped(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 4]} ..."
