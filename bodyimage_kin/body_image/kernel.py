"""The neighbourhood on a grid of units, and what it alone does to a map that knows every true position."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from bodyimage_kin.body_image._checks import choice, float_array, number, whole
from bodyimage_kin.body_image._layout import Layout, Units
from bodyimage_kin.errors import InvalidArray

__all__ = ["KERNELS", "activation", "expected_map", "exponents", "kernel_matrix", "window"]

KERNELS = ("squared", "plain")


def exponents(grid: tuple[int, int], kernel: str) -> Float[np.ndarray, "row_offsets column_offsets"]:
    """Logarithm of the kernel at gamma = 1, for every offset between two units of the grid.

    Args:
        grid: (rows, columns).
        kernel: ``"squared"``: -d^2 (equation 16). ``"plain"``: -d (equations 11, 13 and 15).

    Returns:
        (2 rows - 1, 2 columns - 1), offset zero in the middle, d in grid units. The window for a winner (row, column)
        is `window(grid, row, column)`.

    Raises:
        InvalidConfig: An unknown kernel.
    """
    choice("kernel", kernel, KERNELS)
    rows, columns = grid
    squared = np.arange(1.0 - rows, rows)[:, None] ** 2 + np.arange(1.0 - columns, columns) ** 2
    return -squared if kernel == "squared" else -np.sqrt(squared)


def window(grid: tuple[int, int], row: int, column: int) -> tuple[slice, slice]:
    """Slices that cut, out of a table over offsets, the part seen from one unit: shape ``grid``."""
    rows, columns = grid
    return slice(rows - 1 - row, 2 * rows - 1 - row), slice(columns - 1 - column, 2 * columns - 1 - column)


def activation(
    taxel: int, skin: Units = (21, 21), gamma: float | int = 40.0, kernel: str = "squared"
) -> Float[np.ndarray, "*taxels"]:
    """Activation of every taxel when one is touched (equation 16).

    Args:
        taxel: The one nearest to the touch; of a grid row * columns + column.
        skin: (rows, columns) of a grid, a Skin, or distances (taxels, taxels).
        gamma: Width; squared grid units (or spacings) for ``"squared"``, grid units for ``"plain"``.
        kernel: ``"squared"``: exp(-d^2 / gamma); ``"plain"``: exp(-d / gamma).

    Returns:
        (rows, columns) of a grid, (taxels,) of any other skin; 1 at the taxel.

    Raises:
        InvalidConfig: No such taxel or kernel, or gamma not positive.
    """
    layout = Layout.of(skin)
    taxel = whole("taxel", taxel, 0, layout.count)
    gamma = number("gamma", gamma, 0.0, open_below=True)
    choice("kernel", kernel, KERNELS)
    if layout.grid is None:
        return np.asarray(np.exp(layout.exponents(kernel)[taxel] / gamma))
    table: Float[np.ndarray, "row_offsets column_offsets"] = np.exp(exponents(layout.grid, kernel) / gamma)
    return table[window(layout.grid, *divmod(taxel, layout.grid[1]))]


def kernel_matrix(layout: Layout, gamma: float, kernel: str) -> Float[np.ndarray, "units units"]:
    """Kernel between every two units, symmetric."""
    grid = layout.grid
    if grid is None:
        return np.asarray(np.exp(layout.exponents(kernel) / gamma))
    table = np.exp(exponents(grid, kernel) / gamma)
    rows, columns = (np.arange(size) for size in grid)
    between_rows = rows[:, None, None, None] - rows[:, None] + grid[0] - 1
    between_columns = columns[:, None, None] - columns + grid[1] - 1
    units = grid[0] * grid[1]
    return np.asarray(table[between_rows, between_columns].reshape(units, units))


def expected_map(
    true_positions: Any, taxels: Any, skin: Units = (21, 21), gamma: float | int = 40.0, kernel: str = "squared"
) -> Float[np.ndarray, "*taxels m"]:
    """Kernel average of the true positions over given touches: the map that perfect sight would end at.

    Every taxel gets ``sum_t h(d_it) p(c_t) / sum_t h(d_it)`` over the touches c_t. Against it a learned map shows what
    learning did, free of the shrinkage that the kernel alone causes.

    Args:
        true_positions: (number of taxels, m) [m].
        taxels: The taxel of each touch, any shape, whole numbers; negative ones are no touch.
        skin: As for `activation`.
        gamma: Width of the kernel, as for `activation`.
        kernel: As for `activation`.

    Returns:
        (rows, columns, m) of a grid, (taxels, m) of any other skin [m]; NaN for a taxel that no touch reaches within
        floating-point range.

    Raises:
        InvalidArray: Arrays of the wrong shape or kind, or a taxel that is none.
        InvalidConfig: An unknown kernel, or gamma not positive.
    """
    layout = Layout.of(skin)
    choice("kernel", kernel, KERNELS)
    gamma = number("gamma", gamma, 0.0, open_below=True)
    units = layout.count
    m = np.shape(true_positions)[-1] if np.ndim(true_positions) == 2 else 0
    positions = float_array("true_positions", true_positions, (units, m))
    touches = np.asarray(taxels)
    if touches.dtype.kind not in "iu" or (touches >= units).any():
        raise InvalidArray(f"taxels must be whole numbers below {units}, the taxels of the skin")
    counts = np.bincount(touches[touches >= 0].ravel(), minlength=units)
    touched = counts > 0
    pull = kernel_matrix(layout, gamma, kernel)[:, touched] * counts[touched]
    total = pull.sum(axis=1, keepdims=True)
    mean = np.divide(pull @ positions[touched], total, out=np.full((units, m), np.nan), where=total > 0)
    return np.asarray(mean.reshape(*layout.shape, m))
