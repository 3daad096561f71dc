"""Figures of scores: what an error is made of, what a measure can detect, and the posture map against the truth.

Like ``figures``: pure functions from arrays in SI units to matplotlib figures, and nothing is computed here that a
reader might take for a score.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.figures import style
from bodyimage_kin.figures._panels import ArrayLike, lattice, legend_above, letters, numbers

_MM = 1000.0
_PARTS: dict[str, dict[str, Any]] = {
    "scale": {"facecolor": "#24405e", "label": "one scale"},
    "mean_excited": {"facecolor": "#7da7c4", "hatch": "/////", "label": "mean, excited directions"},
    "mean_unexcited": {"facecolor": "#dbe7f0", "hatch": "\\\\\\", "label": "mean, unexcited directions"},
    "variation": {"facecolor": "#e8b04a", "label": "variation with posture"},
}
"""The parts of ``metrics.Attribution``, from the axis upwards; each its own lightness and hatch."""
_MORE = (("#000000", "-", "o"), ("#d55e00", (0, (4, 1.5)), "v"), ("#0072b2", (0, (1, 1)), "s"), ("#c9a227", "-", "^"))


@style.style()
def attribution_bars(parts: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Figure:
    """The squared relative error of learned Jacobians as the sum of its parts (``metrics.attribute``).

    Args:
        parts: By condition and estimator, ``scale``, ``mean_excited``, ``mean_unexcited`` and ``variation``.

    Returns:
        A panel for each condition and a stacked bar for each estimator, its length the squared pooled relative error.
        An estimator that a condition lacks has no bar there;
        the error 1 of a Jacobian of zeros is marked where the bars come near it.

    Raises:
        InvalidConfig: No condition, no estimator, or a part that is missing or unknown.
        InvalidArray: A part that is negative or not a number.
    """
    estimators = list(dict.fromkeys(name for of in parts.values() for name in of))
    if not estimators:
        raise InvalidConfig("parts is empty; give at least one condition with one estimator")
    heights = {
        condition: {name: _bar(condition, name, bar) for name, bar in of.items()} for condition, of in parts.items()
    }
    top = max(float(bar.sum()) for of in heights.values() for bar in of.values())
    columns = {1: 1, 2: 2, 4: 2}.get(len(parts), 3)
    rows = math.ceil(len(parts) / columns)
    # The legend takes five rows in a single column, two across the page.
    figure = style.new_figure(
        style.DOUBLE_COLUMN if columns > 1 else style.SINGLE_COLUMN,
        (0.75 if columns > 1 else 1.25) + rows * (0.4 + 0.24 * max(2, len(estimators))),
    )
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for index, (axes, (condition, of)) in enumerate(zip(grid.flat, heights.items(), strict=False)):
        for name, bar in of.items():
            y, left = estimators.index(name), 0.0
            for (part, look), length in zip(_PARTS.items(), bar, strict=True):
                axes.barh(y, length, 0.7, left, **look | {"label": part}, edgecolor="black", linewidth=0.4)
                left += float(length)
            axes.annotate(f"{left:.2f}", (left, y), (2, 0), textcoords="offset points", va="center", fontsize=6.5)
        axes.set_yticks(range(len(estimators)), [style.label(name) for name in estimators])
        axes.tick_params(axis="y", length=0)
        letter = f"({chr(ord('a') + index)}) " if len(parts) > 1 else ""
        axes.set_title(letter + style.label(condition), loc="left")
        if top > 0.6:
            axes.axvline(1.0, color="0.45", linewidth=0.7, linestyle=(0, (2, 2)), zorder=0)
        if index + columns >= len(parts):
            axes.set_xlabel("squared relative error")
            axes.tick_params(labelbottom=True)
    for axes in grid.flat[len(parts) :]:
        axes.remove()
    # The first estimator on top, room for the numbers at the right.
    grid[0, 0].set(
        xlim=(0, 1.18 * (max(top, 1.0) if top > 0.6 else max(top, 1e-3))), ylim=(len(estimators) - 0.4, -0.6)
    )
    handles: list[Any] = [Patch(**look, edgecolor="black", linewidth=0.4) for look in _PARTS.values()]
    handles += (
        [Line2D([], [], color="0.45", linewidth=0.7, linestyle=(0, (2, 2)), label="zero Jacobian")] if top > 0.6 else []
    )
    legend_above(figure, handles, columns=3 if columns > 1 else 1)
    return figure


@style.style()
def dose_response(
    doses: ArrayLike | Mapping[str, ArrayLike],
    power: Mapping[str, Mapping[str, ArrayLike]],
    *,
    false_alarms: float | int = 0.05,
    dose_labels: Mapping[str, str] | None = None,
) -> Figure:
    """The power of measures to detect a corrupted Jacobian, against how badly it is corrupted.

    Args:
        doses: (dose,) of all corruptions, or by corruption, the mildest first; any unit.
        power: By corruption and measure, (dose,) the share of corrupted Jacobians that are detected; NaN leaves a gap.
        false_alarms: The share of sound Jacobians that every measure calls corrupted.
        dose_labels: What the dose of each corruption is, with its unit.

    Returns:
        A panel for each corruption, a line for each measure.

    Raises:
        InvalidArray: Shapes that do not fit together, or a power outside 0 to 1.
        InvalidConfig: No corruption, one without doses, or more measures than can be told apart.
    """
    if not power:
        raise InvalidConfig("power is empty; give at least one corruption")
    columns = {1: 1, 2: 2, 4: 2}.get(len(power), 3)
    rows = math.ceil(len(power) / columns)
    looks = _measure_looks(list(dict.fromkeys(name for of in power.values() for name in of)))
    figure = style.new_figure(style.DOUBLE_COLUMN if columns > 1 else style.SINGLE_COLUMN, 0.5 + 1.9 * rows)
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False)
    handles: dict[str, Line2D] = {}
    for axes, (corruption, of) in zip(grid.flat, power.items(), strict=False):
        if isinstance(doses, Mapping) and corruption not in doses:
            raise InvalidConfig(f"corruption {corruption!r} has no doses; doses are of {', '.join(doses)}")
        dose = numbers(doses[corruption] if isinstance(doses, Mapping) else doses, f"doses of {corruption!r}", None)
        for index, (name, values) in enumerate(of.items()):
            curve = numbers(values, f"power of {name!r} against {corruption!r}", len(dose))
            if ((curve < 0) | (curve > 1)).any():
                raise InvalidArray(f"power of {name!r} against {corruption!r} is no probability; give 0 to 1")
            # Markers of curves that coincide, as at power 1, take turns.
            (handles[name],) = axes.plot(
                dose, curve, **looks[name], markevery=(index % 2, 2) if len(dose) > 6 else 1, label=style.label(name)
            )
        if (dose > 0).all() and dose.max() > 20 * dose.min():
            axes.set_xscale("log")
        if dose[-1] < dose[0]:
            axes.invert_xaxis()
        axes.axhline(float(false_alarms), color="0.45", linewidth=0.7, linestyle=(0, (2, 2)), zorder=0)
        axes.set(ylim=(-0.03, 1.05), title=style.label(corruption), xlabel=(dose_labels or {}).get(corruption, "dose"))
        axes.margins(x=0.04)
    for axes in grid.flat[len(power) :]:
        axes.remove()
    for axes in grid[:, 0]:
        axes.set_ylabel("power")
    first = Line2D([], [], color="0.45", linewidth=0.7, linestyle=(0, (2, 2)), label=f"false alarms, {false_alarms:g}")
    letters(grid.flat[: len(power)])
    legend_above(figure, [*handles.values(), first])
    return figure


@style.style()
def posture_map(maps: Mapping[str, ArrayLike], true_map: ArrayLike) -> Figure:
    """The images of the representative postures, learned and true (equations 14 and 15 of the paper).

    Args:
        maps: By the name of who estimated, (rows, columns, 2) image learned for each unit, ``BodyImage.posture_map``
            [m].
        true_map: (rows, columns, 2) image of the hand in each unit's posture [m]; NaN where it has none.

    Returns:
        A panel for each name in [mm], y down, of one scale: the learned lattice over the true one, and a thin line from
        each unit's true image to its learned one.

    Raises:
        InvalidArray: Shapes that do not fit together, or no true image at all.
        InvalidConfig: No map.
    """
    if not maps:
        raise InvalidConfig("maps is empty; give at least one posture map")
    truth = numbers(true_map, "true_map", None, None, 2) * _MM
    if not np.isfinite(truth).all(-1).any():
        raise InvalidArray("no unit's posture has an image; the true posture map has no finite place")
    learned = {name: numbers(value, f"posture map of {name!r}", *truth.shape) * _MM for name, value in maps.items()}
    everything = np.concatenate([places.reshape(-1, 2) for places in (truth, *learned.values())])
    low, high = np.nanmin(everything, 0), np.nanmax(everything, 0)
    edge = 0.06 * float((high - low).max())
    columns = min(4, len(maps))
    rows = math.ceil(len(maps) / columns)
    size = min(style.DOUBLE_COLUMN / columns, style.SINGLE_COLUMN)
    tall = float(np.clip((high - low + 2 * edge)[1] / (high - low + 2 * edge)[0], 0.4, 2.0))
    figure = style.new_figure(
        style.DOUBLE_COLUMN if columns > 1 else style.SINGLE_COLUMN, 0.5 + rows * ((size - 0.35) * tall + 0.5)
    )
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    looks = style.appearances(maps)
    for axes, (name, places) in zip(grid.flat, learned.items(), strict=False):
        gaps = np.stack([truth, places, np.full_like(truth, np.nan)], axis=2).reshape(-1, 2)
        axes.plot(*gaps.T, color="0.45", linewidth=0.35, zorder=2, label="error")
        lattice(axes, truth, color="0.72", linewidth=1.0, zorder=1)
        lattice(axes, places, color=looks[name]["color"], linewidth=0.5, zorder=3)
        look = {"color": looks[name]["color"], "marker": looks[name]["marker"], "linestyle": "", "markersize": 2.4}
        axes.plot(*places.reshape(-1, 2).T, **look, zorder=4, label="learned")
        axes.set(xlim=(low[0] - edge, high[0] + edge), ylim=(high[1] + edge, low[1] - edge), aspect="equal")
        axes.set_title(style.label(name))
    for index, axes in enumerate(grid.flat):
        if index >= len(maps):
            axes.remove()
        elif index + columns >= len(maps):
            axes.set_xlabel("x [mm]")
            axes.tick_params(labelbottom=True)
    for axes in grid[:, 0]:
        axes.set_ylabel("y [mm]")
    if len(maps) > 1:
        letters(grid.flat[: len(maps)])
    handles = [
        Line2D([], [], color="0.72", linewidth=1.0, label="true image of each posture"),
        Line2D([], [], color="black", linewidth=0.5, marker="o", markersize=2.4, label="learned image"),
        Line2D([], [], color="0.45", linewidth=0.35, label="from true to learned"),
    ]
    legend_above(figure, handles, columns=3 if columns > 1 else 1)
    return figure


@style.style()
def score_chain(scores: Mapping[str, Mapping[str, ArrayLike]], *, named: Collection[str] | None = None) -> Figure:
    """Each score of a chain against the one before it, a point a cell.

    Args:
        scores: What each axis says -> estimator -> (cells,) values; what drives the others comes first. Of an
            estimator, a cell has the same place on every axis; NaN, or a value that is not positive, has no point.
        named: Estimators that are told apart, at most six without a role; the others are grey. None: all.

    Returns:
        A panel of logarithmic axes for each link of the chain.

    Raises:
        InvalidConfig: Fewer than two scores, no estimator, or more than can be told apart.
        InvalidArray: Estimators, or their cells, that are not the same on every axis.
    """
    axes_of = list(scores)
    estimators = list(scores[axes_of[0]]) if axes_of else []
    if len(axes_of) < 2 or not estimators:
        raise InvalidConfig("scores must hold at least two scores with one estimator, what drives the others first")
    looks = style.appearances(estimators if named is None else [name for name in estimators if name in named])
    cells: dict[str, dict[str, np.ndarray]] = {name: {} for name in estimators}
    for axis, of in scores.items():
        if list(of) != estimators:
            raise InvalidArray(f"{axis!r} has estimators {', '.join(of)}; give {', '.join(estimators)} on every axis")
        for name, values in of.items():
            count = len(next(iter(cells[name].values()))) if cells[name] else None
            given = numbers(values, f"{axis!r} of {name!r}", count)
            cells[name][axis] = np.where(given > 0, given, np.nan)
    figure = style.new_figure(style.DOUBLE_COLUMN, 3.1)
    panels = figure.subplots(1, len(axes_of) - 1, squeeze=False)[0]
    for panel, (source, target) in zip(panels, pairwise(axes_of), strict=True):
        for name in sorted(estimators, key=lambda name: name in looks):
            look = looks.get(name, style.Appearance(color="0.75", linestyle="", marker="."))
            panel.plot(
                cells[name][source],
                cells[name][target],
                color=look["color"],
                marker=look["marker"],
                linestyle="",
                markersize=4.0,
                markeredgewidth=0.0,
                alpha=0.85,
            )
        panel.set(xlabel=source, ylabel=target)
        for axis, values in (("x", source), ("y", target)):
            _logarithmic(panel, axis, np.concatenate([cells[name][values] for name in estimators]))
    letters(panels)
    handles: list[Any] = [
        Line2D(
            [], [], color=look["color"], marker=look["marker"], linestyle="", markersize=3.6, label=style.label(name)
        )
        for name, look in looks.items()
    ]
    if len(looks) < len(estimators):
        handles.append(Line2D([], [], color="0.75", marker=".", linestyle="", label="others"))
    legend_above(figure, handles)
    return figure


def _logarithmic(panel: Axes, axis: str, values: np.ndarray) -> None:
    """A logarithmic axis whose ticks are plain numbers, enough of them also within one decade."""
    there = values[np.isfinite(values)]
    if not there.size:
        return
    (panel.set_xscale if axis == "x" else panel.set_yscale)("log")
    of = panel.xaxis if axis == "x" else panel.yaxis
    decades = float(np.log10(there.max() / there.min()))
    subs = (1.0, 2.0, 3.0, 5.0, 7.0) if decades < 1.0 else (1.0, 2.0, 5.0) if decades < 2.5 else (1.0,)
    of.set_major_locator(LogLocator(subs=subs, numticks=12))
    of.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    of.set_minor_formatter(NullFormatter())


def _measure_looks(names: list[str]) -> dict[str, style.Appearance]:
    """As ``style.appearances``, with more that are free where no estimator is drawn."""
    first = len(names) - min(len(names), 6) if len(names) <= len(_MORE) + 6 else 0
    more = {
        name: style.Appearance(color=c, linestyle=line, marker=m)
        for name, (c, line, m) in zip(names[:first], _MORE, strict=False)
    }
    return more | style.appearances(names[first:])


def _bar(condition: str, name: str, parts: Mapping[str, float]) -> Any:
    if set(parts) != set(_PARTS):
        raise InvalidConfig(f"{name!r} in {condition!r} has parts {', '.join(parts)}; give {', '.join(_PARTS)}")
    heights = numbers([parts[part] for part in _PARTS], f"parts of {name!r} in {condition!r}", len(_PARTS))
    if not (heights >= 0).all():
        raise InvalidArray(f"a part of {name!r} in {condition!r} is negative or not a number; leave that bar out")
    return heights
