"""The plane of a hand image on axes: which two of its coordinates are drawn, in which unit, which way is down."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin.errors import InvalidArray


@dataclass(frozen=True)
class Plane:
    """The first two coordinates of a hand image, as they are drawn.

    Attributes:
        names: Of all m coordinates.
        unit: In which they come: ``"m"`` on a screen or in space, ``"px"`` ...
    """

    names: tuple[str, ...] = ("x", "y")
    unit: str = "m"

    @classmethod
    def of(cls, recording: xr.Dataset) -> Plane:
        """That of a recording's hand image."""
        image = recording["hand_image"]
        return cls(tuple(str(name) for name in image["axis"].values), str(image.attrs.get("units", "m")))

    @property
    def shown_unit(self) -> str:
        """Metres are shown as millimetres, anything else as it is."""
        return "mm" if self.unit == "m" else self.unit

    @property
    def factor(self) -> float:
        """From the unit to the shown one."""
        return 1000.0 if self.unit == "m" else 1.0

    def places(self, values: ArrayLike, what: str, *shape: int | None) -> Float[np.ndarray, "..."]:
        """The first two coordinates in the shown unit.

        Args:
            values: (*shape, m)
            what: Its name in an error.
            shape: All axes but the last; None where any length will do.

        Raises:
            InvalidArray: Another shape, or another number of coordinates than there are names.
        """
        return shaped(values, what, *shape, len(self.names))[..., :2] * self.factor

    def label(self, axis: int, quantity: str = "", per: str = "") -> str:
        """What stands at an axis."""
        return f"{self.names[axis]}{quantity and ' ' + quantity} [{self.shown_unit}{per}]"

    def frame(self, axes: Axes, edge: float = 0.05) -> None:
        """Names, unit, equal aspect, y as the eye sees it (up in space)."""
        axes.set(xlabel=self.label(0), ylabel=self.label(1), aspect="equal")
        if len(self.names) > 2:
            note(axes, f"the first 2 of {len(self.names)} coordinates")
        axes.margins(edge)
        # In space y is up; a screen's and a pixel's run down.
        if len(self.names) != 3 and not axes.yaxis_inverted():
            axes.invert_yaxis()


def shaped(values: ArrayLike, what: str, *shape: int | None) -> Float[np.ndarray, "..."]:
    """Numbers of this shape, None where any length will do.

    Raises:
        InvalidArray: No numbers, none at all, or of another shape; says which array, and the shape it should have.
    """
    array = as_float_array(values, what)
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if not fits or not array.size:
        expected = ", ".join("any" if n is None else str(n) for n in shape)
        raise InvalidArray(f"{what} has shape {array.shape}; give ({expected}), not empty")
    return array


def note(axes: Axes, text: str, *, above: bool = False) -> None:
    """A small line at the lower (upper) right of a panel, on what it does not show."""
    look: dict[str, Any] = {"ha": "right", "va": "top" if above else "bottom", "fontsize": 6.5, "color": "0.35"}
    axes.text(0.99, 0.99 if above else 0.01, text, transform=axes.transAxes, zorder=9, **look)
