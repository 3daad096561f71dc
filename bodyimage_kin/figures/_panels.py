"""What the panels of several figures share: checked numbers, lattices, letters, legends, scales."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.figures import style

ArrayLike: TypeAlias = Any
"""Numpy arrays, xarray DataArrays or nested lists of numbers; their shapes are checked."""


def numbers(values: ArrayLike, name: str, *shape: int | None) -> Float[np.ndarray, "..."]:
    """Numbers of this shape, None where any length will do.

    Raises:
        InvalidArray: No numbers, none at all, or of another shape; says which array, and the shape it should have.
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as problem:
        raise InvalidArray(f"{name} is no array of numbers ({problem})") from None
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if not fits or not array.size:
        expected = ", ".join("any" if n is None else str(n) for n in shape)
        raise InvalidArray(f"{name} has shape {array.shape}; give ({expected}), not empty")
    return array


def within_one(name: str, taxel: int, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """The rows and columns of the taxels of a landmark: its own, and those next to it.

    Raises:
        InvalidConfig: It is no taxel of the grid.
    """
    rows, columns = shape
    if not 0 <= taxel < rows * columns:
        raise InvalidConfig(f"landmark {name!r} is taxel {taxel}; the map has 0 to {rows * columns - 1}")
    row, column = divmod(int(taxel), columns)
    return slice(max(0, row - 1), row + 2), slice(max(0, column - 1), column + 2)


def lattice(axes: Axes, places: Float[np.ndarray, "rows columns 2"], **look: Any) -> None:
    """Lines between neighbours of a grid."""
    for lines in (places, places.transpose(1, 0, 2)):
        broken = np.concatenate([lines, np.full((len(lines), 1, 2), np.nan)], axis=1)
        axes.plot(*broken.reshape(-1, 2).T, solid_joinstyle="round", **look)


def reference(axes: Axes, value: float, text: str) -> None:
    """A dashed line across at a value that says what it is."""
    axes.axhline(value, color="0.45", linewidth=0.7, linestyle=(0, (2, 2)), zorder=0)
    axes.text(
        0.99, value, text, transform=axes.get_yaxis_transform(), ha="right", va="bottom", fontsize=6.5, color="0.25"
    )


def letters(panels: Iterable[Axes]) -> None:
    """(a), (b), (c) ... at the upper left of panels."""
    for index, axes in enumerate(panels):
        axes.set_title(f"({chr(ord('a') + index)})", loc="left")


def legend_above(figure: Figure, handles: Sequence[Any], columns: int | None = None) -> None:
    """A legend above all panels, in rows of like length."""
    if handles:
        columns = columns or (4 if figure.get_figwidth() > style.SINGLE_COLUMN + 0.1 else 2)
        # Rows of like length, rather than one left over.
        columns = math.ceil(len(handles) / math.ceil(len(handles) / columns))
        figure.legend(handles=list(handles), loc="outside upper center", ncols=columns)


def scale_bar(axes: Axes, length: float) -> None:
    """A bar of this length [m] at the lower left of a drawing in metres."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    x, y = left + 0.03 * (right - left), bottom + 0.03 * (top - bottom)
    axes.plot([x, x + length], [y, y], color="black", linewidth=2, solid_capstyle="butt", zorder=6)
    text = axes.text(x + length / 2, y + 0.015 * (top - bottom), f"{length * 100:.0f} cm", ha="center", va="bottom")
    text.set_path_effects([withStroke(linewidth=2, foreground="white")])
    text.set_zorder(6)
