"""The robot touching its own face, drawn with its skin and the circle on which it saw its hand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.figures import style
from bodyimage_kin.figures._panels import scale_bar
from bodyimage_kin.figures.drawing import Surface, View, draw_surface, hidden, project, triangles
from bodyimage_kin.figures.visuals import RobotSource

_CIRCLE: dict[str, Any] = {"color": "#882255", "linewidth": 1.3}


@style.style()
def touching_face(
    urdf_source: RobotSource,
    posture: Mapping[str, Any],
    taxels: ArrayLike,
    landmarks: Mapping[str, int] | None = None,
    circle_path: ArrayLike | None = None,
    *,
    close_up: bool = True,
    links: Iterable[str] | None = None,
    mesh_folder: Any = None,
    body_view: View | None = None,
    face_view: View | None = None,
) -> Figure:
    """The robot touching its own face, and the face from near (Figs. 4, 5 and 7 of the paper).

    Args:
        urdf_source: A robot, the path of a URDF, or the XML itself.
        posture: Joint values by name [rad or m].
        taxels: (taxel, 3) in the root [m].
        landmarks: The taxel of each, by name.
        circle_path: (time, 3) path of the seen hand in the root [m], NaN for gaps; dashed where the robot covers it.
        close_up: Whether to draw the face from near as well.
        links: The links to draw; None for all.
        mesh_folder: Where meshes may be read; None for the folder of the URDF.
        body_view: Where the robot is seen from; None: obliquely, from the side where the fewest taxels are covered.
        face_view: Likewise of the close-up.

    Returns:
        The robot from its root upwards, and beside it the face with its taxels; a bar shows the scale.

    Raises:
        InvalidArray: Taxels or a path that are not places.
        InvalidConfig: A landmark that is no taxel.
        InvalidGeometry: Visuals that cannot be read.
    """
    skin = _places(taxels, "taxels")
    for name, taxel in (landmarks or {}).items():
        if not 0 <= taxel < len(skin):
            raise InvalidConfig(f"landmark {name!r} is taxel {taxel}; there are {len(skin)}")
    path = None if circle_path is None else _places(circle_path, "circle_path")
    surface = triangles(urdf_source, posture, links=links, mesh_folder=mesh_folder)
    front = _front(skin, surface, path)
    figure = style.new_figure(style.DOUBLE_COLUMN if close_up else style.SINGLE_COLUMN, 3.6)
    panels = figure.subplots(1, 2 if close_up else 1, squeeze=False)[0]
    view = body_view or _clearest(skin, surface, front, 50, 12)
    draw_surface(panels[0], surface, view, window=_upper_body(surface, view, skin, path))
    _overlay(panels[0], surface, view, skin, landmarks or {}, path, size=2.5)
    if close_up:
        view = face_view or _clearest(skin, surface, front, 22, 8)
        flat, _ = project(skin if path is None else np.concatenate([skin, path]), view)
        centre, half = (
            (np.nanmax(flat, 0) + np.nanmin(flat, 0)) / 2,
            0.62 * float((np.nanmax(flat, 0) - np.nanmin(flat, 0)).max()),
        )
        draw_surface(
            panels[1],
            surface,
            view,
            window=(centre[0] - half, centre[0] + half, centre[1] - half, centre[1] + half),
        )
        _overlay(panels[1], surface, view, skin, landmarks or {}, path, size=6)
    for letter, axes, bar in zip("ab", panels, (0.1, 0.02), strict=False):
        scale_bar(axes, bar)
        axes.set(xticks=[], yticks=[])
        axes.spines[:].set_visible(False)
        if close_up:
            axes.set_title(f"({letter})", loc="left")
    handles = [Line2D([], [], linestyle="", marker=".", color="0.15", markersize=3, label="taxels")]
    handles += [
        Line2D([], [], **style.landmark(name), markersize=5, label=style.label(name)) for name in landmarks or {}
    ]
    if landmarks:
        hollow = style.landmark("") | {"marker": "o", "markerfacecolor": "none", "markeredgecolor": "0.35"}
        handles.append(Line2D([], [], **hollow, markersize=5, label="hollow: covered"))
    if path is not None:
        handles.append(Line2D([], [], **_CIRCLE, label="seen circle of the hand"))
    figure.legend(handles=handles, loc="outside lower center", ncols=7 if close_up else 3)
    return figure


def _places(values: ArrayLike, name: str) -> Float[np.ndarray, "points 3"]:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3 or not len(array):
        raise InvalidArray(f"{name} has shape {array.shape}; give (points, 3) in the root [m]")
    return array


def _front(skin: Float[np.ndarray, "taxels 3"], surface: Surface, path: Any) -> Float[np.ndarray, "3"]:
    """The way the face looks: across the taxels, towards the seen circle or else away from the robot."""
    centre = skin.mean(0)
    across = np.asarray(np.linalg.svd(skin - centre)[2][2])
    outside = np.nanmean(path, 0) - centre if path is not None else centre - surface.corners.mean((0, 1))
    return across if across @ outside >= 0 else -across


def _clearest(
    skin: Float[np.ndarray, "taxels 3"],
    surface: Surface,
    front: Float[np.ndarray, "3"],
    aside: float | int,
    above: float | int,
) -> View:
    straight = np.degrees(np.arctan2(front[1], front[0]))
    views = [View.around(skin.mean(0), azimuth=straight + turn, elevation=above) for turn in (-aside, aside)]
    return min(views, key=lambda view: int(hidden(skin, surface, view).sum()))


def _upper_body(surface: Surface, view: View, skin: Any, path: Any) -> tuple[float, float, float, float]:
    flat = project(surface.corners, view)[0].reshape(-1, 2)
    root = float(project(np.zeros(3), view)[0][1])
    shown = flat[flat[:, 1] >= root] if root < project(skin, view)[0][:, 1].min() else flat
    if path is not None:
        shown = np.concatenate([shown, project(path, view)[0]])
    (left, bottom), (right, top) = np.nanmin(shown, 0), np.nanmax(shown, 0)
    edge = 0.04 * max(right - left, top - bottom)
    return float(left - edge), float(right + edge), float(bottom - edge), float(top + edge)


def _overlay(
    axes: Axes, surface: Surface, view: View, skin: Any, landmarks: Mapping[str, int], path: Any, size: float | int
) -> None:
    flat, _ = project(skin, view)
    # Eyeballs and lips stand out a little from the skin that bears the taxels; only what is well in front hides them.
    covered = hidden(skin, surface, view, margin=0.004)
    shown = flat[~covered]
    style.dots(axes, shown, size=size / 5, color="0.15", zorder=2)
    for name, taxel in landmarks.items():
        look = style.landmark(name)
        if covered[taxel]:
            look |= {"markerfacecolor": "none", "markeredgecolor": look["color"], "markeredgewidth": 0.9}
        axes.plot(*flat[taxel], **look, markersize=size, zorder=4)
    if path is not None:
        line, _ = project(path, view)
        behind = hidden(path, surface, view)
        axes.plot(*_only(line, ~behind).T, **_CIRCLE, zorder=5)
        axes.plot(*_only(line, behind).T, **_CIRCLE, linestyle=(0, (1.5, 1.5)), alpha=0.8, zorder=5)


def _only(line: Float[np.ndarray, "points 2"], wanted: Bool[np.ndarray, "points"]) -> Float[np.ndarray, "points 2"]:
    return np.where(wanted[:, None], line, np.nan)
