"""Every reading of every ambiguity in one figure: which choices matter, and for what."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bodyimage_kin import figures
from bodyimage_kin.published.ambiguities import DRAWN, MEASURES

TITLES = {
    "posture": "Posture as an input of f",
    "jacobian": "Which Jacobian of f",
    "hidden": '"Number of hidden layer: 10"',
    "learning_rate": "What the learning rate is scaled by",
    "kernel": "Kernel and unit of gamma",
    "alpha": "How alpha decays",
    "secant": "Δθ in equation 7",
    "reset_to": "What the integral is reset to",
    "reset_when": "When the integral is reset",
    "noise": "Noise on torques or joint angles",
    "captions": "Noise and learning steps",
    "silence": "Silence by touch or by taxel",
    "circle": "Where the hand circles",
    "dimensions": "The robot's dimensions",
}
"""In the order of the documentation. The posture map's kernel is left out: it changes none of these scores."""
ENDS = dict(zip(DRAWN, (1.1, 42.0, 0.65, 330.0), strict=True))
"""Measure -> where its axis ends; the measures follow the chain from Jacobian to map."""
LOOKS = {"kinematic": ("#0b6fa4", "o", 0.17), "noise": ("#c2407e", "D", -0.17)}
"""Motion -> colour, marker, and place above or below the middle of the row."""


@figures.style()
def draw(summary: Mapping[str, Mapping[str, Any]]) -> Figure:
    """A row a reading, a panel a measure; a line shows where the library's own reading, the first of each group, is."""
    groups = {name: summary[name] for name in TITLES}
    rows = sum(len(readings) + 1.6 for readings in groups.values())
    made, grid = figures.panels(1, len(ENDS), height=0.105 * rows + 0.6, sharey=True)
    panels = grid[0]
    # Without it the longest name loses its first letter: text is wider at the resolution of the file.
    made.get_layout_engine().set(w_pad=0.08)
    height, ticks, labels = 0.0, [], []
    for name, readings in groups.items():
        height -= 1.0
        ticks.append(height)
        labels.append(TITLES[name])
        bottom = height - len(readings) - 0.5
        for axes, measure in zip(panels, ENDS, strict=True):
            _group(axes, readings, measure, height, bottom)
        for reading in readings:
            height -= 1.0
            ticks.append(height)
            labels.append(reading)
        height -= 0.6
    for axes, (measure, end) in zip(panels, ENDS.items(), strict=True):
        axes.set(xlim=(0.0, end), ylim=(height, 0.0), xlabel=MEASURES[measure].title)
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        axes.grid(axis="x", color="0.92", linewidth=0.6)
    panels[0].set_yticks(ticks, labels, fontsize=6)
    for text in panels[0].get_yticklabels():
        if text.get_text() in TITLES.values():
            text.set_fontweight("bold")
    for label, (colour, mark, _) in zip(("kinematic", "dynamics with noise"), LOOKS.values(), strict=True):
        panels[0].plot([], [], color=colour, marker=mark, markersize=3, linewidth=1.2, label=label)
    dashed = {"color": "0.55", "linewidth": 0.8, "linestyle": (0, (2, 2))}
    panels[0].plot([], [], **dashed, label="first of each group: the library's")
    figures.legend(made)
    return made


def _group(axes: Axes, readings: Mapping[str, Any], measure: str, top: float, bottom: float) -> None:
    """One ambiguity in one panel; scores beyond the axis sit at its end as arrows."""
    end = ENDS[measure]
    for reading, by_motion in enumerate(readings.values(), start=1):
        means = [found[measure]["mean"] for found in by_motion.values() if measure in found]
        if means and all(mean is None for mean in means):
            axes.text(end, top - reading, "diverges", color="0.4", fontsize=6, ha="right", va="center")
        for motion, found in by_motion.items():
            one = found.get(measure)
            if one is None or one["mean"] is None:
                continue
            colour, mark, aside = LOOKS[motion]
            y = top - reading + aside
            if reading == 1 and one["mean"] <= end:
                axes.plot([one["mean"]] * 2, [top - 0.5, bottom], color=colour, linewidth=0.7, linestyle=(0, (2, 2)))
            if one["lower"] is not None:
                axes.plot([one["lower"], one["upper"]], [y, y], color=colour, linewidth=1.2)
            beyond = one["mean"] > end
            axes.plot(
                min(one["mean"], end), y, ">" if beyond else mark, color=colour, markersize=2.6, clip_on=False, zorder=3
            )
