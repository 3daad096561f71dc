"""Foretold errors: predicted against measured, and what each predictor is worth.

From the summary of :func:`bodyimage_kin.published.foreknowledge.summarise`; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.figures._layout import SINGLE_COLUMN, drawing_on
from bodyimage_kin.figures._marks import DASHED
from bodyimage_kin.figures.labels import drawn
from bodyimage_kin.published.foreknowledge import TARGET

_MARKERS = ("o", "s", "^", "v", "D", "P", "X", "*", "<", ">", "h", "p")
_COLOURS = "viridis"


def predicted_errors(
    found: Mapping[str, Any], estimator: str, predictor: str, ax: Axes | None = None, *, scale: bool = True
) -> Axes:
    """The mean error of each condition against what was foretold of it out of sample.

    Args:
        found: A summary.
        estimator: Whose errors.
        predictor: Who foretold them.
        ax: Axes to draw on; None: those of a new figure.
        scale: Whether the scale of colours stands beside.

    Returns:
        The axes. Points on the line of identity are foretold exactly; colour is the distance of the circle, the marker
        the family of the condition. Predictions beyond twice the greatest error are off the chart.

    Raises:
        UnknownName: No such estimator or predictor.
        InvalidConfig: More families of conditions than can be told apart.
    """
    one = _of(found["estimators"], "estimator", estimator)
    foretold = _of(one["predictors"], "predictor", predictor)
    conditions = found["conditions"]
    families = list(dict.fromkeys(condition["family"] for condition in conditions))
    if len(families) > len(_MARKERS):
        raise InvalidConfig(f"{len(families)} families of conditions; at most {len(_MARKERS)} can be told apart")
    measured, predicted = np.array(one["measured"], dtype=float), np.array(foretold["predicted"], dtype=float)
    distances = np.array([100 * np.mean(condition["distances"]) for condition in conditions])
    colours = mpl.cm.ScalarMappable(mpl.colors.Normalize(distances.min(), distances.max()), _COLOURS)
    predicted = np.where(predicted > 2.0 * np.nanmax(measured), np.nan, predicted)
    low, high = (float(end(np.concatenate([measured, predicted]))) for end in (np.nanmin, np.nanmax))
    with drawing_on(ax, height=SINGLE_COLUMN) as axes:
        axes.axline((low, low), slope=1, **DASHED)
        for family, marker in zip(families, _MARKERS, strict=False):
            there = np.array([condition["family"] == family for condition in conditions])
            axes.scatter(
                predicted[there], measured[there], s=25, c=colours.to_rgba(distances[there]), marker=marker,
                edgecolors="black", linewidths=0.4, label=drawn(family),
            )  # fmt: skip
        said = "\n".join(
            f"{name} {_said(foretold[key]['estimate'])}" for name, key in (("R²", "r2"), ("slope", "slope"))
        )
        axes.text(0.04, 0.96, said, transform=axes.transAxes, va="top", fontsize=7)
        # Not limits of its own: panels that share their axes show the points of all.
        axes.update_datalim([(low, low), (high, high)])
        axes.margins(0.06)
        axes.autoscale_view()
        axes.set(xlabel="predicted relative error", ylabel="measured relative error", title=drawn(predictor))
        axes.set_box_aspect(1)
        if scale:
            axes.figure.colorbar(colours, ax=axes, label="distance of the circle [cm]")
        return axes


def r2_bars(found: Mapping[str, Any], estimator: str, ax: Axes | None = None) -> Axes:
    """Out-of-sample R2 of every predictor of one estimator's errors, with its interval over recordings.

    Args:
        found: A summary.
        estimator: Whose errors.
        ax: Axes to draw on; None: those of a new figure.

    Returns:
        The axes. Bars end at -1, and every R2 is written beside its bar; a predictor that was not asked has none.

    Raises:
        UnknownName: No such estimator.
    """
    one = _of(found["estimators"], "estimator", estimator)
    names = list(dict.fromkeys(name for other in found["estimators"].values() for name in other["predictors"]))
    r2 = {name: one["predictors"][name]["r2"] for name in names if name in one["predictors"]}
    asked = {name: value for name, value in r2.items() if value["estimate"] is not None}
    rows = np.array([names.index(name) for name in asked])
    with drawing_on(ax, height=0.6 + 0.22 * len(names)) as axes:
        widths = [value["estimate"] for value in asked.values()]
        axes.barh(rows, widths, 0.7, facecolor="#7da7c4", edgecolor="black", linewidth=0.4, label="R² out of sample")
        for row, value in zip(rows, asked.values(), strict=True):
            if value["lower"] is not None:
                ends = (value["lower"], value["upper"])
                axes.plot(ends, [row, row], color="black", linewidth=1.0, solid_capstyle="butt")
            axes.annotate(_said(value["estimate"]), (1.04, row), va="center", fontsize=6.5, annotation_clip=False)
        axes.axvline(0.0, color="black", linewidth=0.6)
        axes.axvline(TARGET, **DASHED)
        axes.set(xlim=(-1.0, 1.35), ylim=(len(names) - 0.4, -0.6), xticks=[-1.0, -0.5, 0.0, 0.5, 1.0])
        axes.set(title=drawn(estimator), xlabel=f"R² out of sample; dashed: {TARGET}")
        axes.set_yticks(range(len(names)), [drawn(name) for name in names])
        axes.tick_params(axis="y", length=0)
        return axes


def _of(found: Mapping[str, Any], kind: str, name: str) -> Mapping[str, Any]:
    if name not in found:
        raise UnknownName(kind, name, list(found))
    one: Mapping[str, Any] = found[name]
    return one


def _said(value: float | None) -> str:
    return "none" if value is None else f"{value:.2f}".replace("-", "\N{MINUS SIGN}")
