"""Values on the skin: a grid as the eye sees it, and any skin on its link or laid flat."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.skin import Skin
from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.figures._chart import around, flatten
from bodyimage_kin.figures._images import shaped
from bodyimage_kin.figures._layout import SINGLE_COLUMN, drawing_on
from bodyimage_kin.figures._marks import UNLISTED, bare, dots, graph, halo, scale_bar
from bodyimage_kin.figures._rasteriser import draw_surface
from bodyimage_kin.figures._style import landmark_look
from bodyimage_kin.figures._views import View, facing, hidden, posed, project
from bodyimage_kin.figures.labels import drawn

_COLOURS = "cividis"  # its lightness alone orders the values, for everybody
_RING: dict[str, Any] = {"marker": "o", "markerfacecolor": "none", "markeredgecolor": "black", "markeredgewidth": 1.2}
_MARGIN = 0.006  # [m] features of the face stand out from the skin that bears the taxels


def face(
    body: Embodiment,
    values: ArrayLike,
    ax: Axes | None = None,
    *,
    label: str = "",
    limits: tuple[float | int, float | int] | None = None,
    landmarks: bool = True,
) -> Axes:
    """One value a taxel over a skin that is a grid, as the eye sees it: columns to the right, rows down.

    Holes of a grid stay blank. A skin that is no grid is drawn by :func:`skin`.

    Args:
        body: The embodiment.
        values: (taxels,) or (rows, columns); NaN stays blank.
        ax: Axes to draw on; None: those of a new figure.
        label: What the values are, with their unit; stands at the scale of colours.
        limits: Lowest and highest value of the colours; None: from 0 (or below) to the highest.
        landmarks: Whether these are marked.

    Returns:
        The axes; a scale of colours stands below.

    Raises:
        NoSkin: The body has no skin.
        InvalidArray: Values that are not one a taxel.
        InvalidConfig: A skin that is no grid.
    """
    skin = body.require_skin()
    if skin.layout is None:
        raise InvalidConfig(f"the skin of embodiment '{body.name}' is no grid; draw it with figures.skin(body, values)")
    shape, cells = skin.layout.shape, np.arange(skin.count) if skin.cells is None else skin.cells
    shown = np.full(shape[0] * shape[1], np.nan)
    shown[cells] = _one_a_taxel(values, skin)
    with drawing_on(ax, height=SINGLE_COLUMN + 0.3) as axes:
        grid(shown.reshape(shape), axes, label=label, limits=limits)
        for name, taxel in skin.landmarks.items() if landmarks else ():
            row, column = divmod(int(cells[taxel]), shape[1])
            axes.plot(column, row, **landmark_look(name), label=drawn(name))
        return axes


def grid(
    values: ArrayLike,
    ax: Axes | None = None,
    *,
    label: str = "",
    limits: tuple[float | int, float | int] | None = None,
) -> Axes:
    """Values of a grid of taxels as the eye sees it, without the body: as :func:`face`, but for landmarks.

    Args:
        values: (rows, columns); NaN stays blank.
        ax: Axes to draw on; None: those of a new figure.
        label: What the values are, with their unit.
        limits: Lowest and highest value of the colours.

    Raises:
        InvalidArray: Values that are no grid.
    """
    array = shaped(values, "values", None, None)
    low, high = limits or _limits(array)
    with drawing_on(ax, height=SINGLE_COLUMN + 0.3) as axes:
        look: dict[str, Any] = {"cmap": _COLOURS, "vmin": low, "vmax": max(high, low + 1e-12)}
        image = axes.imshow(array, **look, interpolation="nearest", label=label or "value")
        axes.figure.colorbar(image, ax=axes, location="bottom", shrink=0.85, pad=0.03, label=label)
        bare(axes)
        return axes


def skin(
    body: Embodiment,
    values: ArrayLike | None = None,
    ax: Axes | None = None,
    *,
    flat: bool = False,
    turn: float | int = 0,
    label: str = "",
    limits: tuple[float | int, float | int] | None = None,
) -> Axes:
    """The taxels of any skin, a grid or not, on their link from near or laid flat (Fig. 5).

    Args:
        body: The embodiment.
        values: (taxels,), NaN stays grey; None: dots, and marks at the taxels next to a landmark.
        ax: Axes to draw on; None: those of a new figure.
        flat: In the plane in which distances are, as nearly as can be, those along the graph of neighbours [mm],
            instead of the link as it is seen.
        turn: Of the viewer about the vertical, 0 from the front [degrees].
        label: What the values are, with their unit; stands at the scale of colours.
        limits: Lowest and highest value of the colours; None: from 0 (or below) to the highest.

    Returns:
        The axes, a ring about the reference taxel.

    Raises:
        NoSkin: The body has no skin.
        InvalidArray: Values that are not one a taxel.
        InvalidGeometry: Visuals that cannot be read, or none at all.
    """
    borne = body.require_skin()
    coloured = None if values is None else _one_a_taxel(values, borne)
    with drawing_on(ax, height=SINGLE_COLUMN) as axes:
        if flat:
            places = _laid_flat(axes, body)
            covered = np.zeros(len(places), dtype=bool)
        else:
            places, covered = _on_link(axes, body, float(turn))
        if coloured is None:
            _marked(axes, borne, places, covered)
        else:
            _coloured(axes, places, covered, coloured, label, limits)
        axes.plot(
            *places[borne.reference],
            **_RING,
            linestyle="",
            markersize=9,
            zorder=5,
            label="reference taxel",
            path_effects=halo(3),
        )
        return axes


def _on_link(axes: Axes, body: Embodiment, turn: float) -> tuple[np.ndarray, np.ndarray]:
    """Draws the skin's link from near; where its taxels are on the picture [m], and which of them are covered."""
    skin = body.require_skin()
    surface = posed(body, body.felt_home, (skin.link,))
    positions = skin.positions.numpy()
    middle = positions.mean(0)
    azimuth, elevation = facing(body)
    # From everywhere the window is that of the view from the front.
    width = float(np.ptp(project(positions, View(middle, azimuth, elevation))[0], axis=0).max())
    view = View(middle, azimuth + turn, elevation + (8 if turn else 0))
    half = 0.68 * width
    draw_surface(axes, surface, view, window=(-half, half, -half, half))
    scale_bar(axes, 0.01 if width < 0.2 else 0.05)
    bare(axes)
    return project(positions, view)[0], hidden(positions, surface, view, margin=_MARGIN)


def _laid_flat(axes: Axes, body: Embodiment) -> Float[np.ndarray, "taxels 2"]:
    """Draws the graph of neighbours in the plane; where the taxels are in it [mm]."""
    skin = body.require_skin()
    right, up, _ = View(np.zeros(3), *facing(body)).axes()
    edges = skin.neighbours
    places = 1000 * flatten(skin.positions.numpy(), edges, np.stack([right, up]))
    graph(axes, places, edges, color="0.75", linewidth=0.6, zorder=1)
    axes.set(xlabel="along the skin [mm]", ylabel="along the skin [mm]", aspect="equal")
    axes.set_title("laid flat: distances\nalong the skin kept")
    axes.margins(0.05)
    return places


def _marked(axes: Axes, skin: Skin, places: np.ndarray, covered: np.ndarray) -> None:
    marked = {
        name: around(taxel, skin.shape or (skin.count,), skin.neighbours) for name, taxel in skin.landmarks.items()
    }
    plain = np.setdiff1d(np.arange(len(places)), np.concatenate([np.empty(0, int), *marked.values()]))
    dots(axes, places[plain[~covered[plain]]], size=1.6, color="0.1", zorder=2)
    axes.plot([], [], linestyle="", marker=".", color="0.1", markersize=3, label=f"taxels, {_size(skin)}")
    for name, taxels in marked.items():
        look = landmark_look(name) | {"markersize": 4.2, "zorder": 3}
        axes.plot(*places[taxels[~covered[taxels]]].T, **look, label=drawn(name))


def _coloured(
    axes: Axes,
    places: np.ndarray,
    covered: np.ndarray,
    values: Float[np.ndarray, "taxels"],
    label: str,
    limits: tuple[float | int, float | int] | None,
) -> None:
    low, high = limits or _limits(values)
    blank = ~covered & ~np.isfinite(values)
    dots(axes, places[blank], size=1.6, color="0.6", zorder=2)
    there = ~covered & np.isfinite(values)
    size = float(np.clip(9000 / max(len(places), 1), 5, 40))  # [pt^2]
    x, y = places[there].T
    look: dict[str, Any] = {"cmap": _COLOURS, "vmin": low, "vmax": max(high, low + 1e-12), "linewidths": 0}
    painted = axes.scatter(x, y, size, values[there], **look, zorder=3, label=UNLISTED + (label or "value"))
    axes.figure.colorbar(painted, ax=axes, location="bottom", shrink=0.85, pad=0.03, label=label)


def _one_a_taxel(values: ArrayLike, skin: Skin) -> Float[np.ndarray, "taxels"]:
    array = as_float_array(values, "values")
    shapes = ((skin.count,),) if skin.shape is None else ((skin.count,), skin.shape)
    if array.shape not in shapes:
        raise InvalidArray(f"values have shape {array.shape}; give one a taxel, {' or '.join(map(str, shapes))}")
    return array.ravel()


def _limits(values: np.ndarray) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    return (min(0.0, float(finite.min())), float(finite.max())) if finite.size else (0.0, 1.0)


def _size(skin: Skin) -> str:
    if skin.shape is None:
        return str(skin.count)
    rows, columns = skin.shape
    return f"{rows} \N{MULTIPLICATION SIGN} {columns}"
