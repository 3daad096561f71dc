"""A recording at a glance: the hand in the image, the joints over time, the touches."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from jaxtyping import Shaped
from matplotlib.axes import Axes

from bodyimage_kin.errors import InvalidArray, InvalidRecording
from bodyimage_kin.figures._images import Plane, note
from bodyimage_kin.figures._layout import DOUBLE_COLUMN, legend, letters
from bodyimage_kin.figures._marks import UNLISTED, dots
from bodyimage_kin.figures._style import style
from bodyimage_kin.figures.labels import drawn
from bodyimage_kin.recordings import is_scattered

_MOST_NAMED = 8
"""Joints that have a colour and a name each."""
_LINES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (6, 1.5, 1, 1.5)))


def recording(rec: xr.Dataset, ax: Iterable[Axes] | None = None) -> Shaped[np.ndarray, "3"]:
    """A recording at a glance: where the hand was seen, its joints over time, and which taxels were touched.

    Args:
        rec: A recording, or the experience that a learner gets.
        ax: Three axes to draw on; None: those of a new figure.

    Returns:
        The three axes. Of several trials the first is drawn, and a note says so; a scattered recording, a set of
        postures without order, is dots over their numbers.

    Raises:
        InvalidRecording: No recording.
        InvalidArray: Other than three axes.
    """
    if "q" not in rec or not {"trial", "time", "joint"} <= set(rec["q"].dims):
        raise InvalidRecording("this is no recording: it has no q (trial, time, joint); give what simulate returned")
    if ax is None:
        with style():
            size = (DOUBLE_COLUMN, 2.6)
            figure, panels = plt.subplots(1, 3, figsize=size, layout="constrained", width_ratios=(1, 1.2, 1.2))
            found = recording(rec, panels)
            legend(figure)
            return found
    found = np.array(list(ax), dtype=object)
    if len(found) != 3:
        raise InvalidArray(f"a recording takes three axes; {len(found)} were given")
    first = rec.isel(trial=0)
    scattered = is_scattered(rec)
    look: dict[str, Any] = {"linestyle": "", "marker": ".", "markersize": 1.5} if scattered else {"linewidth": 0.8}
    moments = np.arange(first.sizes["time"]) if scattered else first["time"].values
    _seen(first, found[0], look)
    _joints(first, found[1], moments, look)
    _touches(first, found[2], moments)
    for axes in found[1:]:
        axes.set_xlabel("number of the posture" if scattered else "time [s]")
        axes.margins(x=0.01)
    if rec.sizes["trial"] > 1:
        note(found[0], f"first of {rec.sizes['trial']} trials")
    letters(found)
    return found


def _seen(first: xr.Dataset, axes: Axes, look: dict[str, Any]) -> None:
    axes.set_title("seen")
    if "hand_image" not in first:
        _nothing(axes, "no hand image")
        return
    plane = Plane.of(first)
    path = plane.places(first["hand_image"].values, "hand_image", None)
    if not np.isfinite(path).all(1).any():
        _nothing(axes, "the hand was not seen")
        return
    axes.plot(*path.T, **look, color="black", label=UNLISTED + "hand in the image")
    plane.frame(axes)


def _joints(first: xr.Dataset, axes: Axes, moments: np.ndarray, look: dict[str, Any]) -> None:
    q = first["q"].transpose("time", "joint")
    axes.set(title="felt", ylabel=f"joint value [{q.attrs.get('units', 'rad')}]")
    names = [str(name) for name in q["joint"].values]
    if len(names) > _MOST_NAMED:
        axes.plot(moments, q.values, **look, color="0.4", alpha=0.6)
        note(axes, f"{len(names)} joints")
        return
    colours = mpl.colormaps["viridis"](np.linspace(0, 0.85, len(names)))
    for index, (name, colour) in enumerate(zip(names, colours, strict=True)):
        own = look if look.get("marker") else look | {"linestyle": _LINES[index % len(_LINES)]}
        axes.plot(moments, q.values[:, index], **own, color=colour, label=drawn(name))


def _touches(first: xr.Dataset, axes: Axes, moments: np.ndarray) -> None:
    taxels = first["touched"].transpose("time", "contact").values if "touched" in first else np.empty((0, 0))
    sample, contact = np.nonzero(taxels >= 0)
    touched = taxels[sample, contact]
    if not touched.size:
        axes.set_title("touched")
        _nothing(axes, "nothing touched")
        return
    axes.set(title=f"touched: {np.unique(touched).size} taxels", ylabel="taxel")
    places = np.stack([moments[sample], touched], 1).astype(float)
    dots(axes, places, size=1.4, color="0.15", label=UNLISTED + "touch")
    axes.autoscale_view()


def _nothing(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color="0.35")
    axes.set(xticks=[], yticks=[])
