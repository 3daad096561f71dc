"""Errors that grow as probes leave what was seen: all estimators of a study in one figure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.figures import style
from bodyimage_kin.figures._panels import legend_above

_SHADES = ("#c9c9c9", "#8fb5d9", "#c2407e", "#5b3a8e")
_MARKS = ("D", "s", "o", "^")
_LEAST, _MOST = 1e-3, 30.0
"""Errors beyond are drawn here, as open marks: of the truth itself, and of what extrapolates wildly."""


@style.style()
def by_probe(scores: Mapping[str, Mapping[str, Mapping[str, Any]]], probes: Sequence[str]) -> Figure:
    """Relative error of every estimator at every probe, in the motion's metric.

    Args:
        scores: Recording -> estimator -> ``{"relative_error_use": {probe: {"mean", "lower", "upper"}}}``; None where
            there is no number.
        probes: In the order in which they leave what was seen; at most four.

    Returns:
        A panel a recording, a row an estimator, the smallest error on the face of the first recording on top; bars are
        95 % intervals. Errors below 0.001 or above 30 are open marks there.

    Raises:
        InvalidConfig: No recording, or more probes than can be told apart.
    """
    if not scores or not 0 < len(probes) <= len(_SHADES):
        raise InvalidConfig(f"{len(scores)} recordings and {len(probes)} probes; give one to {len(_SHADES)} probes")
    last = "on_face" if "on_face" in probes else probes[-1]
    first = next(iter(scores.values()))
    names = sorted(first, key=lambda name: _order(first[name], last), reverse=True)
    panels_in_row = min(3, len(scores))
    rows = math.ceil(len(scores) / panels_in_row)
    figure = style.new_figure(style.DOUBLE_COLUMN, rows * (0.5 + 0.16 * len(names)) + 0.5)
    panels = figure.subplots(rows, panels_in_row, squeeze=False, sharex=True, sharey=True).ravel()
    handles: dict[str, Any] = {}
    drawn = [_place(row, probe, "mean") for found in scores.values() for row in found.values() for probe in probes]
    drawn = [value for value in drawn if math.isfinite(value)] or [1.0]
    for axes, (recording, found) in zip(panels, scores.items(), strict=False):
        for height, name in enumerate(names):
            if name not in found:
                continue
            for probe, shade, mark in zip(probes, _SHADES, _MARKS, strict=False):
                mean, lower, upper = (_place(found[name], probe, key) for key in ("mean", "lower", "upper"))
                if not math.isfinite(mean):
                    continue
                front = 3 if probe == last else 2
                axes.plot([lower, upper], [height, height], color=shade, linewidth=1.4, zorder=front)
                beyond = found[name]["relative_error_use"][probe]["mean"] != mean
                dot = axes.plot([mean], [height], mark, color=shade, markersize=3.5, zorder=front)[0]
                if beyond:
                    dot.set_markerfacecolor("white")
                elif probe not in handles:
                    handles[probe] = dot
                    dot.set_label(style.label(probe))
        axes.axvline(1.0, color="0.45", linewidth=0.7, linestyle=(0, (2, 2)), zorder=0)
        axes.set(
            xscale="log",
            xlim=(min(drawn) / 1.4, max(*drawn, 1.0) * 1.4),
            ylim=(-0.6, len(names) - 0.4),
            yticks=range(len(names)),
            yticklabels=[style.label(name) for name in names],
            title=style.label(recording),
        )
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0,) if max(drawn) > 30 * min(drawn) else (1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid(axis="x", color="0.92", linewidth=0.6)
    for axes in panels[len(scores) - panels_in_row : len(scores)]:
        axes.tick_params(labelbottom=True)
    for axes in panels[len(scores) :]:
        axes.set_visible(False)
    told = "relative error of the Jacobian, motion's metric (dashed: a Jacobian of zeros"
    figure.supxlabel(f"{told}; open: beyond {_LEAST:g} or {_MOST:g})", fontsize=8)
    legend_above(figure, [handles[probe] for probe in probes if probe in handles])
    return figure


def _order(row: Mapping[str, Any], probe: str) -> float:
    """The error itself, that of nobody last."""
    mean = row["relative_error_use"][probe]["mean"]
    return math.inf if mean is None else float(mean)


def _place(row: Mapping[str, Any], probe: str, key: str) -> float:
    """A number within the axis; NaN where there is none."""
    value = row["relative_error_use"][probe][key]
    return math.nan if value is None else min(max(value, _LEAST), _MOST)
