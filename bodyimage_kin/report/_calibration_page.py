"""A calibrated body as a page: what it is worth, what was off, and what nobody can know."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bodyimage_kin import figures
from bodyimage_kin.calibration import Calibrated
from bodyimage_kin.report._answer import Section, Table, size, write_answer
from bodyimage_kin.report._page import Picture, number

_WHAT = {
    "images": "where the hand is seen",
    "points": "where the tracker finds the hand",
    "touches": "where the skin is touched",
    "plane": "how far the hand is from the plane",
}
_MOST = 12
"""Measures that the first table holds."""


def write(calibrated: Calibrated, path: Path, said: Sequence[str] = ()) -> Path:
    """See :func:`bodyimage_kin.report.write_calibration`."""
    sections = [_how(calibrated), _unknown(calibrated), _blocks(calibrated), _regions(calibrated), _told(calibrated)]
    if said or calibrated.problem.left_out:
        sections.append(Section("Said on the way", items=[*calibrated.problem.left_out, *said]))
    return write_answer(
        path,
        f"What is the robot really like? {calibrated.problem.body.name}, calibrated",
        _sentences(calibrated),
        _picture(calibrated),
        _measures(calibrated),
        notes=[
            "Change: found less as it was thought to be. Doubt: standard deviation of what was found. Allowed: how far "
            "it was thought to be off beforehand. Directions are those of the joint's own axes."
        ],
        sections=sections,
    )


def _sentences(calibrated: Calibrated) -> list[str]:
    if not calibrated.explains:
        return [calibrated.verdict]
    found = []
    for index, label in enumerate(calibrated.labels):
        new, old = calibrated.held_out.medians[index], calibrated.nominal.medians[index]
        unit = calibrated.units[index]
        what = _WHAT[label.split()[0]]
        better = "off" if new < old else "off, so the body as it was drawn is the better one"
        found.append(
            f"The calibrated body foretells {what} to within {size(float(new), unit)} (half of the observations that "
            f"it had not seen); as it was drawn, it was {size(float(old), unit)} {better}."
        )
    if calibrated.still:
        found.append(
            f"{', '.join(calibrated.still)} hardly moved, so nothing is known of other postures of "
            f"{'it' if len(calibrated.still) == 1 else 'them'}."
        )
    count = len(calibrated.unobservable)
    if count:
        found.append(
            f"Of {calibrated.free} measures, {count} combinations were told by nothing that was observed: they are as "
            "they were thought to be, and are named below."
        )
    return found


def _picture(calibrated: Calibrated) -> Picture:
    def draw() -> Figure:
        labels = calibrated.labels
        figure, grid = figures.panels(
            1, len(labels), height=2.6, width=figures.SINGLE_COLUMN if len(labels) == 1 else figures.DOUBLE_COLUMN
        )
        for index, axes in enumerate(grid[0]):
            factor, unit = (1e3, "mm") if calibrated.units[index] == "m" else (1.0, calibrated.units[index])
            drawn = []
            for of, name, look in (
                (calibrated.nominal, "as it was drawn", {"color": "0.55", "linestyle": (0, (4, 1.5))}),
                (calibrated.held_out, "calibrated", {"color": "#c2407e", "linestyle": "-", "linewidth": 1.6}),
            ):
                errors = np.sort(factor * of.errors[index])
                shares = 100 * (np.arange(len(errors)) + 1) / len(errors)
                kept = np.unique(np.linspace(0, len(errors) - 1, min(len(errors), 300)).astype(int))
                drawn.append(np.maximum(errors[kept], 1e-9))
                axes.plot(drawn[-1], shares[kept], label=name, **look)
            figures.decades(axes, "x", np.concatenate(drawn))
            axes.set(xlabel=f"error [{unit}]", ylabel="observations below it [%]", ylim=(0, 101))
            axes.set_title(labels[index])
        figures.legend(figure)
        return figure

    text = (
        "Share of the observations, each judged by a fit that had not seen its part of the recording, below an error."
    )
    return Picture("held_out", "first", draw, "Errors of what the fit had not seen", text)


def _measures(calibrated: Calibrated) -> Table:
    free = np.flatnonzero(calibrated.fit.free)
    doubt = np.sqrt(np.diagonal(calibrated.covariance))
    # Those first whose change says most against what was allowed.
    order = sorted(free, key=lambda index: -abs(_certain(calibrated, int(index), doubt)))
    rows = [_row(calibrated, int(index), float(doubt[index])) for index in order[:_MOST]]
    more = len(free) - len(rows)
    caption = "What was found" + (f" ({more} more in measures.csv)" if more > 0 else "")
    return Table(("measure", "change", "doubt", "allowed"), rows, caption)


def _certain(calibrated: Calibrated, index: int, doubt: np.ndarray) -> float:
    sd = calibrated.fit.sd[index]
    return float(calibrated.fit.theta[index] / (sd if math.isfinite(sd) else max(doubt[index], 1e-300)))


def _row(calibrated: Calibrated, index: int, doubt: float) -> list[str]:
    parameter = calibrated.parameters[index]
    sd = float(calibrated.fit.sd[index])
    cells = [_said(value, parameter.unit) for value in (float(calibrated.fit.theta[index]), doubt, sd)]
    return [parameter.name, *cells]


def _said(value: float, unit: str) -> str:
    if not math.isfinite(value):
        return "anything"
    if unit == "rad":
        return f"{number(math.degrees(value))}°"
    return size(value, unit) if unit == "m" else f"{number(value)} {unit}".removesuffix(" 1")


def _how(calibrated: Calibrated) -> Section:
    rows = []
    for index, label in enumerate(calibrated.labels):
        unit = calibrated.units[index]
        rows.append(
            [
                label, str(len(calibrated.held_out.errors[index])),
                size(float(calibrated.nominal.medians[index]), unit),
                size(float(calibrated.held_out.medians[index]), unit), size(calibrated.fit.sigma[index], unit),
            ]
        )  # fmt: skip
    table = Table(("observations", "number", "as drawn", "calibrated", "noise of each coordinate"), rows)
    return Section(
        "What was done",
        [
            f"{calibrated.free} measures of the body ({', '.join(_fitted(calibrated))}) were fitted to all "
            "observations, and to all but one part in turn to judge. What was allowed beforehand counts as much as an "
            "observation: a measure that nothing tells stays as it was.",
            calibrated.verdict,
        ],
        tables=[table],
    )


def _fitted(calibrated: Calibrated) -> list[str]:
    """Groups that were fitted, of those that there are."""
    free = [one.group for one, freed in zip(calibrated.parameters, calibrated.fit.free, strict=True) if freed]
    return list(dict.fromkeys(free))


def _unknown(calibrated: Calibrated) -> Section:
    if not calibrated.unobservable:
        return Section("What these observations cannot tell", ["Nothing of what was fitted."])
    return Section(
        "What these observations cannot tell",
        ["Each line is one measure, or one combination of several, that stayed as it was thought to be."],
        calibrated.unobservable,
    )


def _blocks(calibrated: Calibrated) -> Section:
    tables = []
    for index, label in enumerate(calibrated.labels):
        unit = calibrated.units[index]
        pairs = zip(calibrated.nominal.by_block(index), calibrated.held_out.by_block(index), strict=True)
        rows = [
            [str(number_ + 1), size(float(old), unit), size(float(new), unit)]
            for number_, (old, new) in enumerate(pairs)
        ]
        tables.append(Table(("part", "as drawn", "calibrated"), rows, f"{label}, median error"))
    return Section("Part by part", tables=tables)


def _regions(calibrated: Calibrated) -> Section:
    regions = {joint: calibrated.residuals_by_region(joint) for joint in calibrated.problem.body.joints}
    tables = []
    for index, label in enumerate(calibrated.labels):
        unit = calibrated.units[index]
        rows = [[joint, *(size(float(value), unit) for value in of[label])] for joint, of in regions.items()]
        parts = max(len(row) for row in rows) - 1
        rows = [[*row, *[number(math.nan)] * (parts + 1 - len(row))] for row in rows]
        tables.append(Table(("joint", *(f"quarter {k + 1}" for k in range(parts))), rows, f"{label}, median residual"))
    return Section(
        "Where in the joints' ranges it fits",
        ["From each joint's smallest values to its largest. What grows to one side is no noise."],
        tables=tables,
    )


def _told(calibrated: Calibrated) -> Section:
    indices = calibrated.observability
    rows = [[name, number(value)] for name, value in indices.items() if name != "told"]
    return Section(
        "How well it was told",
        [
            f"{indices['told']:.0f} directions of {calibrated.free} are told at all; the indices of Joubair and Bonev "
            f"(2013) are of these. Reduced chi-square: {number(calibrated.chi2)} (about one by construction where the "
            "noise was estimated)."
        ],
        tables=[Table(("index", "value"), rows)],
    )
