"""What several drawings share: dots, graphs, scales, lines of reference, axes of an image and of decades."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

DASHED: dict[str, Any] = {"color": "0.45", "linewidth": 0.7, "linestyle": (0, (2, 2)), "zorder": 0}
"""A line that values are read against."""
UNLISTED = "_: "
"""Begins the label of data that no legend lists: of dots, of those who are one among many."""
TRUTH = "0.72"
"""Colour of the truth that is drawn behind what was learned."""


def dots(axes: Axes, points: Float[np.ndarray, "points 2"], *, size: float | int, **look: Any) -> None:
    """Dots as lines next to no length with round ends: a tenth of what as many markers take in an SVG."""
    points = points[np.isfinite(points).all(1)]
    reach = float(np.ptp(points[:, 0])) if len(points) else 0.0
    ends = points + np.array([1e-4 * reach, 0.0])
    vertices = np.stack([points, ends], axis=1).reshape(-1, 2)
    outline = Path(vertices, np.tile(np.array([Path.MOVETO, Path.LINETO], dtype=Path.code_type), len(points)))
    colour = look.pop("color")
    axes.add_patch(
        PathPatch(outline, facecolor="none", edgecolor=colour, linewidth=size, capstyle="round", snap=False, **look)
    )


def graph(axes: Axes, places: Float[np.ndarray, "taxels 2"], edges: Int[np.ndarray, "edges 2"], **look: Any) -> None:
    """A line for each edge between neighbours, as one artist."""
    ends = places[edges]
    broken = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1)
    axes.plot(*broken.reshape(-1, 2).T, solid_capstyle="round", **look)


def reference(axes: Axes, value: float, text: str) -> None:
    """A dashed line across at a value that says what it is."""
    axes.axhline(value, **DASHED)
    axes.text(
        0.99, value, text, transform=axes.get_yaxis_transform(), ha="right", va="bottom", fontsize=6.5, color="0.25"
    )


def halo(width: float | int = 2) -> list[Any]:
    """White about a text or a mark, so that it is seen on anything."""
    return [withStroke(linewidth=width, foreground="white")]


def scale_bar(axes: Axes, length: float) -> None:
    """A bar at the lower left of a drawing in metres: of this length [m], or of a round one that suits the drawing."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    if not 0.05 < length / (right - left) < 0.6:
        decade = 10.0 ** np.floor(np.log10(0.3 * (right - left)))
        length = max(step * decade for step in (1, 2, 5) if step * decade <= 0.3 * (right - left))
    x, y = left + 0.03 * (right - left), bottom + 0.03 * (top - bottom)
    axes.plot([x, x + length], [y, y], color="black", linewidth=2, solid_capstyle="butt", zorder=6)
    unit, factor = ("m", 1) if length >= 0.995 else ("cm", 100) if length >= 0.00995 else ("mm", 1000)
    said = f"{length * factor:.3g} {unit}"
    text = axes.text(x + length / 2, y + 0.015 * (top - bottom), said, ha="center", va="bottom")
    text.set(path_effects=halo(), zorder=6)


def bare(axes: Axes) -> None:
    """No ticks and no frame: a picture."""
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)


def decades(axes: Axes, which: str, values: Sequence[float] | np.ndarray) -> None:
    """A logarithmic axis whose ticks are plain numbers, enough of them also within one decade.

    Args:
        axes: Of the panel.
        which: ``"x"`` or ``"y"``, the axis.
        values: What is drawn along it; what is not positive has no place there.
    """
    there = np.asarray(values, dtype=float)
    there = there[np.isfinite(there) & (there > 0)]
    if not there.size:
        return
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    axis = axes.xaxis if which == "x" else axes.yaxis
    spread = float(np.log10(there.max() / there.min()))
    place = axes.get_subplotspec()
    # A panel of a third of the width has room for half as many.
    narrow = which == "x" and place is not None and place.get_gridspec().ncols > 2
    many, some = (1.0, 2.0, 3.0, 5.0, 7.0), (1.0, 2.0, 5.0)
    subs = (some if narrow else many) if spread < 1.0 else some if spread < (1.2 if narrow else 2.5) else (1.0,)
    axis.set_major_locator(LogLocator(subs=subs, numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
