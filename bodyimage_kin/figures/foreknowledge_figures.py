"""Figures of foretold errors: predicted against measured, and what each predictor is worth.

From the summary of :func:`bodyimage_kin.published.foreknowledge.summarise`; nothing is computed here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.figures import style
from bodyimage_kin.figures._panels import legend_above
from bodyimage_kin.published.foreknowledge.run import TARGET

_SHOWN = (
    "posture_distance",
    "excitation_deficit",
    "gaussian_process",
    "without_structure",
    "perturbed_arms",
    "calibrated_arm",
)
"""Predictors that have a panel each, in this order; the structure is unknown in the upper row."""
_TITLES = {
    "posture_distance": "mean postures",
    "posture_distance_seen": "mean postures, seen spreads",
    "posture_distance_use": "mean postures, touch steps",
    "excitation_deficit": "excitation (control)",
    "gaussian_process": "Gaussian process",
    "gaussian_process_radial": "Gaussian process, radial",
    "without_structure": "combined, structure unknown",
    "with_structure": "combined, structure known",
    "perturbed_arms": "perturbed arms",
    "perturbed_arms_rough": "perturbed arms, rough",
    "calibrated_arm": "calibrated arm",
    "mean_of_others": "mean of the others",
}
_MARKERS = ("o", "s", "^", "v", "D", "P", "X", "*", "<", ">", "h", "p")
_COLOURS = "viridis"
_CENTIMETRE = 100.0


@style.style()
def predicted_against_measured(found: Mapping[str, Any], estimator: str) -> Figure:
    """The mean error of each condition against what was foretold of it out of sample, a panel a predictor.

    Args:
        found: A summary.
        estimator: Whose errors.

    Returns:
        Points on the line of identity are foretold exactly. Colour is the distance of the circle, the marker tells
        what else is special about a condition.

    Raises:
        UnknownName: No such estimator.
        InvalidConfig: A summary without any of the predictors that are drawn.
    """
    one = _of(found, estimator)
    shown = [name for name in _SHOWN if name in one["predictors"]]
    if not shown:
        raise InvalidConfig(f"the summary has none of the predictors {', '.join(_SHOWN)}; nothing to draw")
    conditions = found["conditions"]
    measured = np.array(one["measured"], dtype=np.float64)
    predicted = {name: np.array(one["predictors"][name]["predicted"], dtype=np.float64) for name in shown}
    low, high = _span([measured, *predicted.values()])
    columns = min(3, len(shown))
    rows = math.ceil(len(shown) / columns)
    figure = style.new_figure(style.DOUBLE_COLUMN, 0.75 + 2.1 * rows)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    looks = _looks(conditions)
    for index, name in enumerate(shown):
        axes = grid.flat[index]
        axes.plot([low, high], [low, high], color="0.45", linewidth=0.7, linestyle=(0, (2, 2)), zorder=0)
        for x, y, look in zip(predicted[name], measured, looks, strict=True):
            axes.plot(x, y, **look)
        r2, slope = (one["predictors"][name][score]["estimate"] for score in ("r2", "slope"))
        axes.set_title(f"({chr(ord('a') + index)}) {_TITLES.get(name, name)}", loc="left")
        axes.text(0.04, 0.96, f"R² {_said(r2)}\nslope {_said(slope)}", transform=axes.transAxes, va="top", fontsize=7)
        axes.set(xlim=(low, high), ylim=(low, high))
        axes.set_box_aspect(1)
        if index + columns >= len(shown):
            axes.set_xlabel("predicted relative error")
            axes.tick_params(labelbottom=True)
        if index % columns == 0:
            axes.set_ylabel("measured relative error")
    for axes in grid.flat[len(shown) :]:
        axes.remove()
    families = dict.fromkeys(condition["family"] for condition in conditions)
    handles = [
        Line2D([], [], color="0.4", linestyle="", marker=marker, label=family)
        for family, marker in zip(families, _cycle(len(families)), strict=True)
    ]
    legend_above(figure, handles, columns=4)
    distances = [_CENTIMETRE * float(np.mean(condition["distances"])) for condition in conditions]
    scale = mpl.cm.ScalarMappable(mpl.colors.Normalize(min(distances), max(distances)), _COLOURS)
    figure.colorbar(
        scale, ax=grid[:, -1] if len(shown) % columns == 0 else grid[:1, -1], label="distance of the circle [cm]"
    )
    return figure


@style.style()
def r2_bars(found: Mapping[str, Any]) -> Figure:
    """Out-of-sample R2 of every predictor, a panel an estimator, with its interval over recordings.

    Args:
        found: A summary.

    Returns:
        Bars are cut at -1, and every R2 is written beside its bar. A predictor that was not asked has none.

    Raises:
        InvalidConfig: A summary without estimators.
    """
    estimators = found["estimators"]
    if not estimators:
        raise InvalidConfig("the summary has no estimators; nothing to draw")
    names = list(dict.fromkeys(name for one in estimators.values() for name in one["predictors"]))
    figure = style.new_figure(style.DOUBLE_COLUMN, 0.6 + 0.22 * len(names))
    grid = figure.subplots(1, len(estimators), sharex=True, sharey=True, squeeze=False)
    for index, (axes, estimator) in enumerate(zip(grid[0], estimators, strict=True)):
        for y, name in enumerate(names):
            r2 = estimators[estimator]["predictors"].get(name, {}).get("r2")
            if r2 is None or r2["estimate"] is None:
                continue
            value = float(r2["estimate"])
            axes.barh(y, max(value, -1.0), 0.7, facecolor="#7da7c4", edgecolor="black", linewidth=0.4)
            if r2["lower"] is not None:
                ends = np.clip([r2["lower"], r2["upper"]], -1.0, None)
                axes.plot(ends, [y, y], color="black", linewidth=1.0, solid_capstyle="butt")
            axes.annotate(_said(value), (1.04, y), va="center", fontsize=6.5, annotation_clip=False)
        axes.axvline(0.0, color="black", linewidth=0.6)
        axes.axvline(TARGET, color="0.45", linewidth=0.7, linestyle=(0, (2, 2)), zorder=0)
        axes.set_title(f"({chr(ord('a') + index)}) {style.label(estimator)}", loc="left")
        axes.set_xlabel(f"R² out of sample; dashed: {TARGET}")
        axes.tick_params(axis="y", length=0)
    grid[0, 0].set(xlim=(-1.0, 1.35), ylim=(len(names) - 0.4, -0.6), xticks=[-1.0, -0.5, 0.0, 0.5, 1.0])
    grid[0, 0].set_yticks(range(len(names)), [_TITLES.get(name, name) for name in names])
    return figure


def _of(found: Mapping[str, Any], estimator: str) -> Mapping[str, Any]:
    if estimator not in found["estimators"]:
        raise UnknownName("estimator", estimator, found["estimators"])
    one: Mapping[str, Any] = found["estimators"][estimator]
    return one


def _span(values: Sequence[np.ndarray]) -> tuple[float, float]:
    """Limits that show everything, with a margin; predictions beyond twice the greatest error are off the chart."""
    top = 2.0 * float(np.nanmax(values[0]))
    everything = np.clip(np.concatenate(values), 0.0, top)
    low, high = float(np.nanmin(everything)), float(np.nanmax(everything))
    margin = 0.06 * (high - low) or 0.1
    return low - margin, high + margin


def _looks(conditions: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    families = list(dict.fromkeys(condition["family"] for condition in conditions))
    markers = _cycle(len(families))
    distances = np.array([np.mean(condition["distances"]) for condition in conditions])
    width = float(np.ptp(distances)) or 1.0
    colours = mpl.colormaps[_COLOURS]((distances - distances.min()) / width)
    return [
        {
            "color": colour,
            "marker": markers[families.index(condition["family"])],
            "markeredgecolor": "black",
            "markeredgewidth": 0.4,
            "markersize": 5.0,
            "linestyle": "",
        }
        for condition, colour in zip(conditions, colours, strict=True)
    ]


def _cycle(count: int) -> list[str]:
    if count > len(_MARKERS):
        raise InvalidConfig(f"a figure can tell only {len(_MARKERS)} families of conditions apart, not {count}")
    return list(_MARKERS[:count])


def _said(value: float | None) -> str:
    return "none" if value is None else f"{value:.2f}".replace("-", "\N{MINUS SIGN}")
