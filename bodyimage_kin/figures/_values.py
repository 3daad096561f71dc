"""The values that a figure shows, read from what is drawn: for its table, and for the pointer over its SVG.

What has a label is data, also one that no legend lists (``_: NAME``): lines, error bars, bars, dots, coloured cells.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import PathPatch
from matplotlib.ticker import FixedLocator, FuncFormatter

from bodyimage_kin.figures._marks import UNLISTED

_MOST_TARGETS = 150
"""Values of one series in one panel that the pointer finds; a path has more, all in the table."""
_REACH = 4.0  # [pt] about a point


@dataclass(frozen=True)
class Shown:
    """One value.

    Attributes:
        axes: Of its panel.
        series: Label of the artist.
        x: In data coordinates.
        y: In data coordinates.
        lower: Of an error bar, along the axis that has it; NaN where there is none.
        upper: Likewise.
        value: Of a coloured cell; NaN elsewhere.
        box: Left, bottom, right and top in data coordinates; None of a point.
    """

    axes: Axes
    series: str
    x: float
    y: float
    lower: float = np.nan
    upper: float = np.nan
    value: float = np.nan
    box: tuple[float, float, float, float] | None = None

    def row(self) -> dict[str, Any]:
        """Of the table."""
        return {
            "panel": _panel(self.axes),
            "series": _plain(self.series),
            "x_axis": _plain(self.axes.get_xlabel()),
            "x": _named(self.axes.xaxis, self.x),
            "y_axis": _plain(self.axes.get_ylabel()),
            "y": _named(self.axes.yaxis, self.y),
            "lower": self.lower,
            "upper": self.upper,
            "value": self.value,
        }

    def text(self) -> str:
        """For the pointer."""
        said = [
            f"{label or name} {_number(value)}"
            for name, label, value in (
                ("x", self.axes.get_xlabel(), _named(self.axes.xaxis, self.x)),
                ("y", self.axes.get_ylabel(), _named(self.axes.yaxis, self.y)),
            )
        ]
        if np.isfinite(self.lower):
            said.append(f"{_number(self.lower)} to {_number(self.upper)}")
        if np.isfinite(self.value):
            said.append(_number(self.value))
        return f"{_plain(self.series)}: {', '.join(said)}"


def shown(figure: Figure) -> list[Shown]:
    """Every value of every panel."""
    return [one for axes in figure.axes for one in _of(axes)]


def table(every: list[Shown]) -> pd.DataFrame:
    """See :func:`bodyimage_kin.figures.values`."""
    rows = pd.DataFrame([one.row() for one in every])
    if not len(rows):
        return rows
    labels = {axis: set(rows[f"{axis}_axis"]) for axis in ("x", "y")}
    for axis, found in labels.items():
        if len(found) == 1 and labels["x"] != labels["y"]:
            rows = rows.drop(columns=f"{axis}_axis").rename(columns={axis: found.pop() or axis})
    numbers = rows.select_dtypes("number").columns
    rows[numbers] = rows[numbers].map(lambda value: float(f"{value:.6g}"))
    empty = [name for name in ("panel", "lower", "upper", "value") if rows[name].isin(["", np.nan]).all()]
    return rows.drop(columns=empty)


def hover(figure: Figure) -> str:
    """Unseen shapes over the values of a figure [pt], each with a title that a browser shows under the pointer."""
    by_series: dict[tuple[int, str], list[Shown]] = {}
    for one in shown(figure):
        by_series.setdefault((id(one.axes), one.series), []).append(one)
    figure.set_dpi(72)
    height = figure.get_figheight() * 72
    targets = []
    for found in by_series.values():
        cells = found[0].box is not None
        for one in found if cells else found[:: 1 + len(found) // _MOST_TARGETS]:
            x, y, width, tall = _place(one)
            if np.isfinite([x, y]).all():
                left, top = x - width / 2, height - y - tall / 2
                shape = f'x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" height="{tall:.1f}"'
                targets.append(f"<rect {shape}><title>{escape(one.text())}</title></rect>")
    return f'<g class="values" fill="transparent">{"".join(targets)}</g>' if targets else ""


def _place(one: Shown) -> tuple[float, float, float, float]:
    """Middle, width and height on the figure [pt]."""
    if one.box is None:
        x, y = one.axes.transData.transform((one.x, one.y))
        return float(x), float(y), 2 * _REACH, 2 * _REACH
    left, bottom, right, top = one.box
    (left, bottom), (right, top) = one.axes.transData.transform([(left, bottom), (right, top)])
    return (left + right) / 2, (bottom + top) / 2, abs(right - left), abs(top - bottom)


def _of(axes: Axes) -> Iterator[Shown]:
    inside: set[Any] = set()
    for container in axes.containers:
        inside.update(container.get_children())
        if isinstance(container, ErrorbarContainer):
            yield from _errorbars(axes, container)
        elif isinstance(container, BarContainer):
            yield from _bars(axes, container)
    for artist in (*axes.lines, *axes.collections, *axes.patches, *axes.images):
        label = str(artist.get_label()).removeprefix(UNLISTED)
        if artist in inside or not label or label.startswith("_"):
            continue
        if isinstance(artist, AxesImage):
            yield from _cells(axes, artist, label)
        elif isinstance(artist, PathCollection):
            values = artist.get_array()
            for index, (x, y) in enumerate(np.asarray(artist.get_offsets(), dtype=float)):
                yield Shown(axes, label, float(x), float(y), value=np.nan if values is None else float(values[index]))
        elif isinstance(artist, PathPatch):
            yield from _points(axes, np.asarray(artist.get_path().vertices)[::2], label)
        elif hasattr(artist, "get_xydata"):
            yield from _points(axes, np.asarray(artist.get_xydata(), dtype=float), label)


def _points(axes: Axes, places: np.ndarray, label: str) -> Iterator[Shown]:
    for x, y in places:
        if np.isfinite([x, y]).all():
            yield Shown(axes, label, float(x), float(y))


def _errorbars(axes: Axes, container: ErrorbarContainer) -> Iterator[Shown]:
    line, _, bars = container.lines
    along = 0 if container.has_xerr else 1
    # Of a bar that has no end, matplotlib keeps no segment of two.
    ends = [bar[:, along] if len(bar) == 2 else (np.nan, np.nan) for bar in bars[0].get_segments()]
    for (x, y), (lower, upper) in zip(np.asarray(line.get_xydata(), dtype=float), ends, strict=True):
        if np.isfinite([x, y]).all():
            yield Shown(axes, str(container.get_label()), float(x), float(y), float(lower), float(upper))


def _bars(axes: Axes, container: BarContainer) -> Iterator[Shown]:
    """Of a bar that lies the value is its width, wherever in a stack it begins."""
    lies = container.orientation == "horizontal"
    for bar in container.patches:
        (left, bottom), (right, top) = bar.get_bbox().get_points()
        x, y = (bar.get_width(), (bottom + top) / 2) if lies else ((left + right) / 2, bar.get_height())
        yield Shown(axes, str(container.get_label()), float(x), float(y), box=(left, bottom, right, top))


def _cells(axes: Axes, image: AxesImage, label: str) -> Iterator[Shown]:
    values: np.ndarray = np.ma.asarray(image.get_array(), dtype=float).filled(np.nan)
    if values.ndim != 2:
        return
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            box = (column - 0.5, row - 0.5, column + 0.5, row + 0.5)
            yield Shown(axes, label, float(column), float(row), value=float(value), box=box)


def _panel(axes: Axes) -> str:
    return _plain(" ".join(filter(None, (axes.get_title("left"), axes.get_title()))))


def _named(axis: Any, value: float) -> Any:
    """The name that stands at a place of an axis of names, or the number itself."""
    locator, formatter = axis.get_major_locator(), axis.get_major_formatter()
    if isinstance(locator, FixedLocator) and isinstance(formatter, FuncFormatter):
        places = axis.get_majorticklocs()
        nearest = int(np.argmin(np.abs(places - value))) if len(places) else 0
        name = formatter.format_ticks(places)[nearest] if len(places) else ""
        if name and abs(places[nearest] - value) < 0.5:
            return _plain(name)
    return value


def _plain(text: str) -> str:
    return text.replace(r"\$", "$")


def _number(value: Any) -> str:
    return value if isinstance(value, str) else f"{value:.3g}".replace("-", "\N{MINUS SIGN}")
