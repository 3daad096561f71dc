"""Maps that a body image learned: where taxels and postures are thought to be, beside where they are, and over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin.body.graph import grid_edges
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.figures._chart import around
from bodyimage_kin.figures._images import Plane, shaped
from bodyimage_kin.figures._layout import SINGLE_COLUMN, drawing_on
from bodyimage_kin.figures._marks import TRUTH, UNLISTED, dots, graph, reference
from bodyimage_kin.figures._style import landmark_look, looks
from bodyimage_kin.figures.labels import drawn


def tactile_map(
    places: ArrayLike,
    ax: Axes | None = None,
    *,
    true: ArrayLike | None = None,
    neighbours: ArrayLike | None = None,
    landmarks: Mapping[str, int] | None = None,
    unit: str = "m",
    names: Sequence[str] = ("x", "y"),
) -> Axes:
    """Where each taxel is thought to be in the image (Fig. 10), over where it truly is.

    Args:
        places: (rows, columns, m) of a grid, or (taxels, m) of any skin [unit].
        ax: Axes to draw on; None: those of a new figure.
        true: Likewise, where the taxels truly are; drawn faintly behind.
        neighbours: (edges, 2) pairs of neighbouring taxels; of a grid they are known.
        landmarks: The taxel of each, by name; it and those next to it are marked.
        unit: Of the image; metres are shown as millimetres.
        names: Of its m coordinates; of more than two the first two are drawn.

    Returns:
        The axes, y as the eye sees it, of equal aspect.

    Raises:
        InvalidArray: Shapes that do not fit together.
        InvalidConfig: A landmark that is no taxel of the map.
    """
    plane = Plane(tuple(names), unit)
    shape = as_float_array(places, "places", ndim=2).shape[:-1]
    learned = plane.places(places, "places", *shape)
    truth = None if true is None else plane.places(true, "true", *shape)
    edges = _edges(neighbours, shape)
    with drawing_on(ax, height=SINGLE_COLUMN) as axes:
        if truth is not None:
            _behind(axes, truth, edges)
        graph(axes, learned.reshape(-1, 2), edges, color="0.6", linewidth=0.25)
        dots(axes, learned.reshape(-1, 2), size=0.9, color="0.15", zorder=3, label=UNLISTED + "taxels")
        for name, taxel in (landmarks or {}).items():
            near = learned.reshape(-1, 2)[around(taxel, shape, edges, f"landmark {name!r}")]
            axes.plot(*near.T, **landmark_look(name), markersize=2.3, label=drawn(name), zorder=4)
        plane.frame(axes)
        return axes


def posture_map(
    places: ArrayLike,
    true: ArrayLike,
    ax: Axes | None = None,
    *,
    name: str = "learned",
    unit: str = "m",
    names: Sequence[str] = ("x", "y"),
) -> Axes:
    """The images of the representative postures, learned over true (equations 14 and 15).

    Args:
        places: (rows, columns, m) image learned for each unit, ``BodyImage.posture_map`` [unit].
        true: (rows, columns, m) image of the hand in each unit's posture [unit]; NaN where it has none.
        ax: Axes to draw on; None: those of a new figure.
        name: Of who estimated; gives the colour.
        unit: Of the image; metres are shown as millimetres.
        names: Of its m coordinates; of more than two the first two are drawn.

    Returns:
        The axes: the learned lattice over the true one, and a thin line from each true image to its learned one.

    Raises:
        InvalidArray: Shapes that do not fit together, or no true image at all.
    """
    plane = Plane(tuple(names), unit)
    truth = plane.places(true, "true", None, None)
    if not np.isfinite(truth).all(-1).any():
        raise InvalidArray("no unit's posture has an image; the true posture map has no finite place")
    learned = plane.places(places, "places", *truth.shape[:2])
    look = looks([name])[name]
    edges = grid_edges(*truth.shape[:2])
    with drawing_on(ax, height=SINGLE_COLUMN) as axes:
        graph(axes, truth.reshape(-1, 2), edges, color=TRUTH, linewidth=1.0, zorder=1)
        axes.plot([], [], color=TRUTH, linewidth=1.0, label="true image of each posture")
        gaps = np.stack([truth, learned, np.full_like(truth, np.nan)], axis=2).reshape(-1, 2)
        axes.plot(*gaps.T, color="0.45", linewidth=0.35, zorder=2, label="from true to learned")
        graph(axes, learned.reshape(-1, 2), edges, color=look["color"], linewidth=0.5, zorder=3)
        marks: dict[str, Any] = {"color": look["color"], "marker": look["marker"], "linestyle": "", "markersize": 2.4}
        axes.plot(*learned.reshape(-1, 2).T, **marks, zorder=4, label=drawn(name))
        plane.frame(axes)
        return axes


def learning(
    steps: ArrayLike,
    series: Mapping[str, ArrayLike],
    ax: Axes | None = None,
    *,
    ylabel: str = "",
    level: tuple[float | int, str] | None = None,
) -> Axes:
    """A score of the map as it is learned, one line an estimator (Fig. 11).

    A map that shrinks to a point has no topological error: without its span beside it, that error flatters.

    Args:
        steps: (step,) the steps learned.
        series: By name, (seed, step).
        ax: Axes to draw on; None: those of a new figure.
        ylabel: What the score is, with its unit.
        level: A value to read the lines against, and what it is: chance, the true size ...

    Returns:
        The axes: means over the seeds, with bars of one standard deviation.

    Raises:
        InvalidArray: Shapes that do not fit together.
        InvalidConfig: More names than can be told apart.
    """
    when = shaped(steps, "steps", None)
    with drawing_on(ax, height=2.5) as axes:
        for name, look in looks(series).items():
            seeds = shaped(series[name], f"{ylabel or 'score'} of {name!r}", None, len(when))
            deviation = seeds.std(0, ddof=1) if len(seeds) > 1 else np.zeros(len(when))
            axes.errorbar(
                when, seeds.mean(0), deviation, **look, elinewidth=0.8, capsize=1.5, label=drawn(name), alpha=0.9
            )
        axes.set(xlabel="learning steps", ylabel=ylabel)
        axes.margins(x=0.02)
        if level is not None:
            reference(axes, float(level[0]), level[1])
        axes.set_ylim(bottom=0)
        return axes


def _edges(neighbours: ArrayLike | None, shape: tuple[int, ...]) -> Int[np.ndarray, "edges 2"]:
    if neighbours is not None:
        return shaped(neighbours, "neighbours", None, 2).astype(int)
    return grid_edges(*shape) if len(shape) == 2 else np.empty((0, 2), dtype=int)


def _behind(axes: Axes, truth: Float[np.ndarray, "*taxels 2"], edges: Int[np.ndarray, "edges 2"]) -> None:
    """The truth: of a grid every few rows and columns, of any other skin its graph."""
    if truth.ndim == 3:
        rows, columns = (sorted({*range(0, n, max(1, n // 5)), n - 1}) for n in truth.shape[:2])
        truth = truth[rows][:, columns]
        edges = grid_edges(len(rows), len(columns))
    graph(axes, truth.reshape(-1, 2), edges, color=TRUTH, linewidth=0.7)
    axes.plot([], [], color=TRUTH, label="true places")
