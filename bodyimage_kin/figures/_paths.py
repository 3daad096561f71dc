"""The hand in the image: its path and its velocity, true and estimated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin._checks import whole
from bodyimage_kin.figures._images import Plane, shaped
from bodyimage_kin.figures._layout import drawing_on
from bodyimage_kin.figures._style import landmark_look, looks
from bodyimage_kin.figures.labels import drawn

_FAINT = "0.72"


def velocities(
    time: ArrayLike,
    true: ArrayLike,
    estimates: Mapping[str, ArrayLike],
    ax: Axes | None = None,
    *,
    axis: int = 0,
    unit: str = "m",
    names: Sequence[str] = ("x", "y"),
) -> Axes:
    """The velocity of the hand image over time, true and estimated, along one coordinate (Fig. 8).

    Args:
        time: (time,) [s].
        true: (time, m) [unit/s]; NaN leaves gaps.
        estimates: By name, shaped as ``true``.
        ax: Axes to draw on; None: those of a new figure.
        axis: Which coordinate.
        unit: Of the image; metres are shown as millimetres.
        names: Of its m coordinates.

    Raises:
        InvalidArray: Shapes that do not fit together.
        InvalidConfig: No such coordinate, or more names than can be told apart.
    """
    plane = Plane(tuple(names), unit)
    whole("axis", axis, least=0, most=len(plane.names) - 1)
    moments = shaped(time, "time", None)
    with drawing_on(ax, height=2.2) as axes:
        axes.axhline(0, color=_FAINT, linewidth=0.5, zorder=0)
        known = {"truth": true, **estimates}
        for name, look in looks(known).items():
            curve = shaped(known[name], f"velocity of {name!r}", len(moments), len(plane.names))[:, axis] * plane.factor
            width = 1.6 if name == "truth" else 1.0
            line = {"color": look["color"], "linestyle": look["linestyle"], "linewidth": width}
            axes.plot(moments, curve, **line, label=drawn(name))
        axes.margins(x=0.01)
        axes.set(xlabel="time [s]", ylabel=plane.label(axis, "velocity", "/s"))
        return axes


def trajectories(
    true: ArrayLike | None,
    estimates: Mapping[str, ArrayLike],
    ax: Axes | None = None,
    *,
    landmarks: Mapping[str, ArrayLike] | None = None,
    unit: str = "m",
    names: Sequence[str] = ("x", "y"),
) -> Axes:
    """The path of the hand image, true and estimated, with landmarks where they truly are (Fig. 9).

    Args:
        true: (time, m) [unit]; None: unknown.
        estimates: By name, (time, m) [unit].
        ax: Axes to draw on; None: those of a new figure.
        landmarks: By name, (m,) [unit].
        unit: Of the image; metres are shown as millimetres.
        names: Of its m coordinates; of more than two the first two are drawn.

    Returns:
        The axes of the image plane, of equal aspect; each path begins at its large marker.

    Raises:
        InvalidArray: Shapes that do not fit together.
        InvalidConfig: More names than can be told apart.
    """
    plane = Plane(tuple(names), unit)
    known = ({} if true is None else {"truth": true}) | dict(estimates)
    with drawing_on(ax, height=3.4) as axes:
        for name, look in looks(known).items():
            path = plane.places(known[name], f"path of {name!r}", None)
            width = 1.6 if name == "truth" else 1.0
            # A marker every eighth of the way, so that a path can be followed where it is crossed, and in grey.
            axes.plot(*path.T, **look, linewidth=width, markevery=max(1, len(path) // 8), label=drawn(name))
            started = path[np.isfinite(path).all(1)][:1]
            axes.plot(*started.T, marker=look["marker"], color=look["color"], markersize=7, linestyle="", alpha=0.6)
        for name, place in (landmarks or {}).items():
            mark = plane.places(place, f"landmark {name!r}")
            axes.plot(*mark, **landmark_look(name), markersize=6.5, label=drawn(name), zorder=5)
        plane.frame(axes, edge=0.08)
        return axes
