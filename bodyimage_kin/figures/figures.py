"""The figures of a study, each a pure function from arrays to a matplotlib figure.

What goes in is in SI units, as everywhere in this package; the axes show millimetres. Images are drawn as the eye
sees them: x to the right, y down. Names of estimators and landmarks choose the look (``bodyimage_kin.figures.style``).
Nothing here computes a score, and nothing is written: that is ``style.save``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.figures import style
from bodyimage_kin.figures._panels import ArrayLike, lattice, legend_above, letters, numbers, reference, within_one
from bodyimage_kin.figures._robot_figure import touching_face as touching_face

_MM = 1000.0
_FAINT = "0.72"
_MOST_POINTS = 400  # a panel and estimator: enough to see a spread, few enough for an SVG


@style.style()
def velocities(
    time: ArrayLike,
    true: ArrayLike,
    estimates: Mapping[str, ArrayLike],
    *,
    conditions: Sequence[str] = (),
) -> Figure:
    """The velocity of the hand image over time, true and estimated, x above y (Fig. 8 of the paper).

    Args:
        time: (time,) [s].
        true: (time, 2) [m/s], or (condition, time, 2) with NaN where a condition is shorter.
        estimates: By name, shaped as ``true``.
        conditions: Their titles, one a column of panels; empty when there is one and it needs none.

    Returns:
        A panel for each axis and condition, in [mm/s].

    Raises:
        InvalidArray: Shapes that do not fit together.
    """
    moments = numbers(time, "time", None)
    shape = (max(1, len(conditions)), len(moments), 2)
    known = {"truth": true, **estimates}
    curves = {name: numbers(_at_least_3d(value), f"velocity of {name!r}", *shape) for name, value in known.items()}
    figure = style.new_figure(style.SINGLE_COLUMN if shape[0] == 1 else style.DOUBLE_COLUMN, 3.0)
    grid = figure.subplots(2, shape[0], sharex=True, sharey="row", squeeze=False)
    for name, look in style.appearances(curves).items():
        for column in range(shape[0]):
            for row, axes in enumerate(grid[:, column]):
                axes.plot(
                    moments,
                    curves[name][column, :, row] * _MM,
                    color=look["color"],
                    linestyle=look["linestyle"],
                    linewidth=1.6 if name == "truth" else 1.0,
                    label=style.label(name),
                )
    for row, axis in enumerate("xy"):
        grid[row, 0].set_ylabel(f"{axis} velocity [mm/s]")
    for axes in grid.flat:
        axes.axhline(0, color=_FAINT, linewidth=0.5, zorder=0)
        axes.margins(x=0.01)
    for axes in grid[1]:
        axes.set_xlabel("time [s]")
    for axes, title in zip(grid[0], conditions, strict=False):
        axes.set_title(title)
    letters(grid.T.flat)
    legend_above(figure, grid[0, 0].get_lines()[: len(curves)])
    return figure


@style.style()
def trajectories(
    true: ArrayLike,
    estimates: Mapping[str, ArrayLike],
    landmarks: Mapping[str, ArrayLike] | None = None,
) -> Figure:
    """The path of the hand image, true and estimated, with the landmarks where they truly are (Fig. 9 of the paper).

    Args:
        true: (time, 2) [m].
        estimates: By name, (time, 2) [m].
        landmarks: By name, (2,) [m].

    Returns:
        One panel of the image plane in [mm], y down, of equal aspect; each path begins at its large marker.

    Raises:
        InvalidArray: Shapes that do not fit together.
    """
    known = {"truth": true, **estimates}
    paths = {name: numbers(value, f"path of {name!r}", None, 2) * _MM for name, value in known.items()}
    marks = {name: numbers(place, f"landmark {name!r}", 2) * _MM for name, place in (landmarks or {}).items()}
    places = np.concatenate([*paths.values(), *(mark[None] for mark in marks.values())])
    breadth, depth = np.nanmax(places, axis=0) - np.nanmin(places, axis=0)
    # As tall as the paths ask for: axes of equal aspect in a figure of another shape leave it half empty.
    legend = 0.15 * math.ceil((len(paths) + len(marks)) / 2)
    height = 0.6 + legend + 2.75 * float(np.clip(depth / max(breadth, 1e-9), 0.4, 1.4))
    figure = style.new_figure(style.SINGLE_COLUMN, height)
    axes = figure.subplots()
    handles = []
    for name, look in style.appearances(paths).items():
        path = paths[name]
        width = 1.6 if name == "truth" else 1.0
        # A marker every eighth of the way, so that a path can be followed where it is crossed, and in grey.
        handles += axes.plot(
            *path.T, **look, linewidth=width, markevery=max(1, len(path) // 8), label=style.label(name)
        )
        started = path[np.isfinite(path).all(1)][:1]
        axes.plot(*started.T, marker=look["marker"], color=look["color"], markersize=7, linestyle="", alpha=0.6)
    for name, place in marks.items():
        handles += axes.plot(*place, **style.landmark(name), markersize=6.5, label=style.label(name), zorder=5)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    axes.margins(0.08)
    axes.invert_yaxis()
    legend_above(figure, handles)
    return figure


@style.style()
def map_snapshots(
    maps: ArrayLike | Mapping[str, ArrayLike],
    steps: ArrayLike,
    landmarks: Mapping[str, int] | None = None,
    *,
    true_map: ArrayLike | None = None,
) -> Figure:
    """How the tactile map unfolds: where each taxel is thought to be, step by step (Fig. 10 of the paper).

    Args:
        maps: (snapshot, rows, columns, 2) [m], or such by the name of who estimated, one a row of panels.
        steps: (snapshot,) the steps learned by then.
        landmarks: The taxel of each, by name; it and those within one of it are marked.
        true_map: (rows, columns, 2) [m] where the taxels truly are, drawn faintly behind.

    Returns:
        A panel for each snapshot and name in [mm], y down, of equal aspect, one scale within a row.

    Raises:
        InvalidArray: Shapes that do not fit together.
        InvalidConfig: A landmark that is no taxel of the map.
    """
    when = numbers(steps, "steps", None)
    named = dict(maps) if isinstance(maps, Mapping) else {"": maps}
    rows = {name: numbers(value, f"maps of {name!r}", len(when), None, None, 2) * _MM for name, value in named.items()}
    size = style.DOUBLE_COLUMN / max(len(when), 4)
    width = style.DOUBLE_COLUMN if len(when) >= 4 else size * len(when) + 0.4
    figure = style.new_figure(width, len(rows) * size * 1.02 + 0.6)
    grid = figure.subplots(len(rows), len(when), squeeze=False, sharex="row", sharey="row")
    for panels, (name, snapshots) in zip(grid, rows.items(), strict=True):
        truth = None if true_map is None else numbers(true_map, "true_map", *snapshots.shape[1:]) * _MM
        everything = [snapshots.reshape(-1, 2)] + ([] if truth is None else [truth.reshape(-1, 2)])
        low, high = np.nanmin(np.concatenate(everything), 0), np.nanmax(np.concatenate(everything), 0)
        edge = 0.04 * float((high - low).max())
        for axes, snapshot in zip(panels, snapshots, strict=True):
            if truth is not None:
                lattice(axes, truth[_sparse(truth.shape[0])][:, _sparse(truth.shape[1])], color=_FAINT, linewidth=0.7)
            lattice(axes, snapshot, color="0.6", linewidth=0.25)
            style.dots(axes, snapshot.reshape(-1, 2), size=0.9, color="0.15", zorder=3)
            for landmark, taxel in (landmarks or {}).items():
                patch = snapshot[within_one(landmark, taxel, snapshot.shape[:2])].reshape(-1, 2)
                axes.plot(*patch.T, **style.landmark(landmark), markersize=2.3, label=style.label(landmark), zorder=4)
            axes.set(xlim=(low[0] - edge, high[0] + edge), ylim=(high[1] + edge, low[1] - edge), aspect="equal")
        panels[0].set_ylabel(f"{style.label(name)}\ny [mm]" if name else "y [mm]")
    for axes, step in zip(grid[0], when, strict=True):
        axes.set_title(f"{step:.0f} steps")
    for axes in grid[-1]:
        axes.set_xlabel("x [mm]")
    handles = [
        Line2D([], [], **style.landmark(name), markersize=4, label=style.label(name)) for name in (landmarks or {})
    ]
    if true_map is not None:
        handles.append(Line2D([], [], color=_FAINT, label="true places"))
    legend_above(figure, handles, columns=6)
    return figure


@style.style()
def topological_error(
    steps: ArrayLike,
    errors: Mapping[str, ArrayLike],
    *,
    spans: Mapping[str, ArrayLike] | None = None,
    chance: float | int | None = None,
) -> Figure:
    """The topological error of the map over learning (Fig. 11 of the paper), and its span beside it.

    A map that shrinks to a point has no topological error: without its span the error flatters.

    Args:
        steps: (step,) the steps learned.
        errors: By name, (seed, step) taxels out of order.
        spans: By name, (seed, step) size of the map over the true size.
        chance: The error of random maps.

    Returns:
        Means over the seeds, with bands of one standard deviation.

    Raises:
        InvalidArray: Shapes that do not fit together.
    """
    when = numbers(steps, "steps", None)
    quantities = [("topological error [taxels]", errors)] + ([("map span / true span", spans)] if spans else [])
    figure = style.new_figure(style.DOUBLE_COLUMN if spans else style.SINGLE_COLUMN, 2.5)
    panels = figure.subplots(1, len(quantities), squeeze=False)[0]
    looks = style.appearances(dict.fromkeys([*errors, *(spans or {})]))
    handles: dict[str, Line2D] = {}
    for axes, (title, series) in zip(panels, quantities, strict=True):
        for name, values in series.items():
            seeds = numbers(values, f"{title} of {name!r}", None, len(when))
            mean, deviation = seeds.mean(0), seeds.std(0, ddof=1) if len(seeds) > 1 else np.zeros(len(when))
            axes.fill_between(
                when, mean - deviation, mean + deviation, color=looks[name]["color"], alpha=0.18, linewidth=0
            )
            (handles[name],) = axes.plot(
                when, mean, **looks[name], markevery=max(1, len(when) // 8), label=style.label(name)
            )
        axes.set(xlabel="learning steps", ylabel=title)
        axes.margins(x=0.02)
    if chance is not None:
        reference(panels[0], float(chance), "chance")
    if spans:
        reference(panels[1], 1.0, "true size")
        letters(panels)
    for axes in panels:
        axes.set_ylim(bottom=0)
    legend_above(figure, list(handles.values()))
    return figure


@style.style()
def error_by_distance(
    distance: Mapping[str, ArrayLike],
    errors: Mapping[str, Mapping[str, ArrayLike]],
    *,
    distance_label: str = "distance from the seen circle [rad]",
    bins: int = 5,
) -> Figure:
    """The relative error of learned Jacobians against how far from the seen circle they are asked.

    Args:
        distance: By probe (``"on_circle"``, ``"in_front"``, ``"on_face"``), (posture,).
        errors: By estimator and probe, (posture,) or (seed, posture) relative errors, 1 for a Jacobian of zeros.
        distance_label: What the distance is, with its unit.
        bins: Bins of equally many postures, in which median and quartiles are drawn.

    Returns:
        A panel for each probe, of one scale: faint points are some postures (median over the seeds), markers
        medians of a bin, bars its quartiles over postures and seeds.

    Raises:
        InvalidArray: Shapes that do not fit together.
        InvalidConfig: Fewer than one bin.
    """
    if bins < 1:
        raise InvalidConfig(f"bins is {bins}; draw at least one")
    figure = style.new_figure(style.DOUBLE_COLUMN, 2.7)
    panels = figure.subplots(1, len(distance), sharex=True, sharey=True, squeeze=False)[0]
    looks = style.appearances(errors)
    handles: dict[str, Any] = {}
    places = {probe: numbers(values, f"distance of probe {probe!r}", None) for probe, values in distance.items()}
    reach = max(float(np.ptp(np.concatenate(list(places.values())))), 1e-12)
    for axes, (probe, place) in zip(panels, places.items(), strict=True):
        edges = np.quantile(place, np.linspace(0, 1, bins + 1))
        bin_of = np.clip(np.searchsorted(edges, place, side="right") - 1, 0, bins - 1)
        for index, (name, look) in enumerate(looks.items()):
            values = np.asarray(errors[name].get(probe, np.full(place.shape, np.nan)), dtype=float)
            values = numbers(values[None] if values.ndim == 1 else values, f"errors of {name!r}", None, len(place))
            posture_median = np.nanmedian(values[:, np.isfinite(values).any(0)], axis=0)
            points = np.stack([place[np.isfinite(values).any(0)], posture_median], axis=1)
            points = points[:: 1 + len(points) // _MOST_POINTS]
            style.dots(axes, points, size=1.2, color=look["color"], alpha=0.3, zorder=1)
            rows = []
            for one in np.unique(bin_of):
                inside = values[:, bin_of == one]
                if np.isfinite(inside).any():
                    rows.append([np.median(place[bin_of == one]), *np.nanquantile(inside, [0.5, 0.25, 0.75])])
            if not rows:
                continue
            x, median, lower, upper = np.transpose(rows)
            # Side by side, or the bars of several estimators hide each other.
            x = x + (index - (len(looks) - 1) / 2) * 0.006 * reach
            handles[name] = axes.errorbar(
                x,
                median,
                [median - lower, upper - median],
                **look,
                elinewidth=0.8,
                capsize=1.5,
                zorder=3,
                label=style.label(name),
            )
        axes.set(yscale="log", title=style.label(probe))
        axes.yaxis.set_major_formatter("{x:g}")
    for axes in panels:
        reference(axes, 1.0, "zero Jacobian")
    panels[0].set_ylabel("relative error of the Jacobian")
    figure.supxlabel(distance_label, fontsize=8)
    letters(panels)
    legend_above(figure, list(handles.values()))
    return figure


def _at_least_3d(values: ArrayLike) -> Any:
    array = np.asarray(values)
    return array[None] if array.ndim == 2 else array


def _sparse(count: int) -> list[int]:
    return sorted({*range(0, count, max(1, count // 5)), count - 1})
