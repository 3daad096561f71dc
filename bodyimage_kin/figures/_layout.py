"""Figures and their panels: made in one look, lettered, with one legend for all, and whose axes a drawing goes on."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Literal

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Shaped
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.container import Container
from matplotlib.figure import Figure

from bodyimage_kin._checks import number, whole
from bodyimage_kin.figures._style import style

MILLIMETRE = 1 / 25.4
"""[inch]"""
SINGLE_COLUMN = 88 * MILLIMETRE
"""Width of a figure in one column of a journal [inch]."""
DOUBLE_COLUMN = 180 * MILLIMETRE
"""Width of a figure across the page [inch]."""


def panels(
    rows: int = 1, columns: int = 1, *, width: float | int = DOUBLE_COLUMN, height: float | int = 3.0, **options: Any
) -> tuple[Figure, Shaped[np.ndarray, "rows columns"]]:
    """An empty figure whose panels do not overlap, unknown to pyplot: it needs no closing.

    Draw in it inside :func:`style`, for every figure the same look.

    Args:
        rows: Of panels.
        columns: Of panels.
        width: [inch]; the default is that of a page, ``SINGLE_COLUMN`` that of a column.
        height: [inch]
        options: As of ``Figure.subplots``: ``sharex``, ``sharey``, ``width_ratios`` ...

    Returns:
        The figure, and its axes as an array (rows, columns).
    """
    size = (number("width", width, above=0.0), number("height", height, above=0.0))
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(whole("rows", rows, least=1), whole("columns", columns, least=1), squeeze=False, **options)
    return figure, grid


def letters(axes: Iterable[Axes]) -> None:
    """(a), (b), (c) ... at the upper left of panels, before their titles."""
    for index, one in enumerate(axes):
        one.set_title(f"({chr(ord('a') + index)}) {one.get_title()}".strip(), loc="left")
        one.set_title("")


def legend(figure: Figure, *, columns: int | None = None, below: bool = False) -> None:
    """One legend for all panels of a figure: everything in them that has a label, each label once.

    Args:
        figure: Drawn already.
        columns: Labels in a row at the most, as far as the width takes them; None: four.
        below: Under the panels instead of above.
    """
    found: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(name, handle)
    if not found:
        return
    # Bars and error bars first: what they are read against comes last.
    found = dict(sorted(found.items(), key=lambda one: not isinstance(one[1], Container)))
    place: Literal["outside lower center", "outside upper center"]
    place = "outside lower center" if below else "outside upper center"
    for most in range(columns or 4, 0, -1):
        # Rows of like length, rather than one left over.
        ncols = math.ceil(len(found) / math.ceil(len(found) / most))
        drawn = figure.legend(handles=list(found.values()), labels=list(found), loc=place, ncols=ncols)
        if most == 1 or drawn.get_window_extent().width <= figure.bbox.width:
            return
        drawn.remove()


@contextmanager
def drawing_on(ax: Axes | None, *, height: float, width: float = SINGLE_COLUMN) -> Iterator[Axes]:
    """The axes to draw on: those given, or those of a new figure that pyplot knows and shows, legend included."""
    if ax is not None:
        yield ax
        return
    with style():
        figure = plt.figure(figsize=(width, height), layout="constrained")
        axes = figure.add_subplot()
        try:
            yield axes
        except BaseException:
            plt.close(figure)
            raise
        legend(figure)


def row(
    *draws: Callable[[Axes], object],
    pictures: bool = False,
    lettered: bool = True,
    columns: int = 4,
    below: bool = False,
    **options: Any,
) -> Figure:
    """A figure of drawings side by side, lettered, with one legend.

    Args:
        draws: Each draws on the axes that it is given: ``lambda ax: figures.face(body, values, ax)``.
        pictures: Whether they are of equal aspect: then they take all the width, at one height.
        lettered: Whether they begin with (a), (b), (c) ...
        columns: Of the legend, at the most.
        below: Whether the legend stands below them.
        options: As of :func:`panels`.
    """
    with style():
        figure, grid = panels(1, len(draws), **options)
        for axes, draw in zip(grid[0], draws, strict=True):
            draw(axes)
            if options.keys() & {"sharex", "sharey"}:
                axes.label_outer()
        if lettered and len(draws) > 1:
            letters(grid[0])
        legend(figure, columns=columns, below=below)
        if pictures:
            _fill(figure, list(grid[0]))
    return figure


def _fill(figure: Figure, axes: Sequence[Axes]) -> None:
    """Gives panels of equal aspect, side by side, the height at which they take all the width of their figure."""
    ratios = [abs(float(np.ptp(one.get_xlim()) / np.ptp(one.get_ylim()))) for one in axes]
    grid, engine = axes[0].get_gridspec(), figure.get_layout_engine()
    if grid is None or engine is None:
        return
    grid.set_width_ratios(ratios)
    for _ in range(3):
        with warnings.catch_warnings():
            # A height on the way may leave no room for panels; the one it ends with does.
            warnings.filterwarnings("ignore", "constrained_layout not applied")
            engine.execute(figure)
        width, height = figure.get_size_inches()
        boxes = [one.get_position(original=True) for one in axes]
        wanted = max(box.width * width / ratio for box, ratio in zip(boxes, ratios, strict=True))
        figure.set_figheight(height + wanted - max(box.height * height for box in boxes))
