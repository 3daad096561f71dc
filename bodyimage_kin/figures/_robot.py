"""The robot itself: at a posture with its skin, with its joints marked, and in every posture of a map."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.axes import Axes

from bodyimage_kin._arrays import ArrayLike, as_postures
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.figures._images import shaped
from bodyimage_kin.figures._layout import DOUBLE_COLUMN, drawing_on
from bodyimage_kin.figures._marks import UNLISTED, bare, dots, halo, scale_bar
from bodyimage_kin.figures._rasteriser import draw_surface, on_white, render
from bodyimage_kin.figures._style import landmark_look
from bodyimage_kin.figures._views import (
    View,
    Window,
    clearest,
    facing,
    felt_links,
    hidden,
    posed,
    project,
    skin_places,
    window_of,
)
from bodyimage_kin.figures.labels import drawn
from bodyimage_kin.figures.visuals import Surface, link_poses

PATH: dict[str, Any] = {"color": "#882255", "linewidth": 1.3}
"""Of a hand in space."""
_FELT, _OTHER = "#882255", "0.45"
_TILE = 160  # pixels along the longer side of a small drawing: 200 to the inch, as figures are saved
_TAXEL_MARGIN = 0.004  # [m] eyeballs and lips stand out a little from the skin that bears the taxels


def robot(
    body: Embodiment,
    q: ArrayLike | None = None,
    ax: Axes | None = None,
    *,
    paths: Mapping[str, ArrayLike] | None = None,
    close: bool = False,
    links: Iterable[str] | None = None,
    azimuth: float | int | None = None,
    elevation: float | int | None = None,
    mesh_folder: str | os.PathLike[str] | None = None,
) -> Axes:
    """The robot at a posture, drawn from its own geometry, with its taxels and landmarks where they are seen.

    Args:
        body: The embodiment.
        q: (p,) felt joints [rad or m]; None: home.
        ax: Axes to draw on, in metres; None: those of a new figure.
        paths: By name, (time, 3) paths in the root [m], NaN for gaps; dashed where the robot covers them.
        close: The face and the paths from near, instead of the robot from its root upwards.
        links: The links to draw; None: all.
        azimuth: Of the viewer, from x to y [degrees]; None: obliquely, from the side where fewest taxels are covered.
        elevation: Of the viewer [degrees]; None: a little above.
        mesh_folder: Where meshes may be read; None: the folder of the URDF.

    Returns:
        The axes; a bar shows the scale.

    Raises:
        InvalidPosture: No posture of this body.
        InvalidArray: Paths that are not places.
        InvalidGeometry: Visuals that cannot be read, or none at all.
    """
    posture = as_postures(body.felt_home if q is None else q, body.p)
    surface = posed(body, posture, body.robot.link_names if links is None else tuple(links), mesh_folder)
    ways = {name: shaped(path, f"path {name!r}", None, 3) for name, path in (paths or {}).items()}
    taxels = skin_places(body, posture) if body.skin is not None else np.empty((0, 3))
    shown = np.concatenate([taxels, *ways.values()])
    middle = taxels.mean(0) if len(taxels) else surface.corners.mean((0, 1))
    straight = facing(body)[0]
    aside, above = (22, 8) if close else (50, 12)
    turns = [straight - aside, straight + aside] if azimuth is None else [float(azimuth)]
    views = [View(middle, turn, above if elevation is None else float(elevation)) for turn in turns]
    view = clearest(views, [(surface, taxels)]) if len(taxels) else views[-1]
    if close and len(shown):
        window = window_of(project(shown, view)[0], 0.12, square=True)
    else:
        window = window_of(_upper_body(surface, view, shown), 0.04)
    with drawing_on(ax, height=3.4) as axes:
        draw_surface(axes, surface, view, window=window)
        if body.skin is not None:
            _taxels(axes, body, surface, view, taxels, size=6.0 if close else 2.5)
        for name, way in ways.items():
            broken_line(axes, surface, view, way, **PATH, hidden_style=(0, (1.5, 1.5)), label=drawn(name), zorder=5)
        scale_bar(axes, 0.02 if close else 0.1)
        bare(axes)
        return axes


def joints(body: Embodiment, ax: Axes | None = None, *, turn: float | int = 0, named: bool = True) -> Axes:
    """The robot at zero posture with every joint marked: the felt ones with their axis, number and name (Fig. 4).

    Args:
        body: The embodiment.
        ax: Axes to draw on, in metres; None: those of a new figure.
        turn: Where it is seen from: 0 from the front, 90 from its left [degrees].
        named: Whether names stand beside the drawing.

    Returns:
        The axes; numbers are those of ``body.joints``, from 1.

    Raises:
        InvalidGeometry: Visuals that cannot be read, or none at all.
    """
    surface = posed(body, None, body.robot.link_names)
    view = View(surface.corners.mean((0, 1)), facing(body)[0] + turn, 0.0)
    # Below the feet there is room for the bar.
    window = window_of(project(surface.corners, view)[0], below=3.3)
    with drawing_on(ax, height=4.5) as axes:
        draw_surface(axes, surface, view, window=window)
        _joint_axes(axes, body, view, window, named=named)
        scale_bar(axes, 0.1)
        bare(axes)
        return axes


def postures(body: Embodiment, postures: ArrayLike, ax: Axes | None = None) -> Axes:
    """The representative postures of a posture map, as the robot that takes them (Fig. 3).

    Args:
        body: The embodiment.
        postures: (rows, columns, p) felt joints [rad or m], ``BodyImage.postures``.
        ax: Axes to draw on, in metres; None: those of a new figure.

    Returns:
        The axes with a drawing for each posture, of one scale, rows and columns as in the array. Drawn are the links
        that felt joints move, and the one that bears the skin, obliquely from the side where the hand is covered least.

    Raises:
        InvalidArray: Not postures of this body on a grid.
        InvalidGeometry: Visuals that cannot be read.
    """
    grid = shaped(postures, "postures", None, None, body.p)
    rows, columns = grid.shape[:2]
    each = grid.reshape(-1, body.p)
    surfaces = [posed(body, posture, felt_links(body)) for posture in each]
    hands = body.hand_position(torch.from_numpy(each)).detach().numpy()
    middle = np.mean([surface.corners.mean((0, 1)) for surface in surfaces], 0)
    some = range(0, len(surfaces), max(1, len(surfaces) // 8))
    view = clearest(
        [View(middle, facing(body)[0] + turn, 8.0) for turn in (-40, 40)],
        [(surfaces[k], hands[k][None]) for k in some],
        margin=2 * float(body.hand.radius),
    )
    window = window_of(np.concatenate([project(surface.corners, view)[0].reshape(-1, 2) for surface in surfaces]))
    tiles = np.stack([on_white(render(surface, view, window, _TILE)) for surface in surfaces])
    tall, wide = tiles.shape[1:3]
    tiles[:, :2], tiles[:, :, :2] = 0.88, 0.88  # a thin line between drawings
    picture = tiles.reshape(rows, columns, tall, wide, 3).swapaxes(1, 2).reshape(rows * tall, columns * wide, 3)
    width, height = window[1] - window[0], window[3] - window[2]
    with drawing_on(ax, width=DOUBLE_COLUMN, height=0.6 + DOUBLE_COLUMN * rows * height / (columns * width)) as axes:
        # Steps too fine to see make a small file.
        axes.imshow(
            np.round(picture * 48) / 48,
            extent=(0, columns * width, rows * height, 0),
            interpolation="none",
        )
        across, down = (np.arange(columns) + 0.5) * width, (np.arange(rows) + 0.5) * height
        places = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
        for joint, angles in zip(body.joints, each.T, strict=True):
            # Not seen, but the values of the drawing.
            axes.scatter(places[:, 0], places[:, 1], c=angles, visible=False, label=UNLISTED + drawn(joint))
        strip = 0.09 * height
        axes.set(ylim=(rows * height + 2.4 * strip, 0), xlabel="column of the map", ylabel="row of the map")
        axes.set_xticks(across, [f"{column + 1}" for column in range(columns)])
        axes.set_yticks(down, [f"{row + 1}" for row in range(rows)])
        axes.tick_params(length=0, top=True, labeltop=True, bottom=False, labelbottom=False)
        axes.xaxis.set_label_position("top")
        axes.spines[:].set_visible(False)
        y = rows * height + 0.8 * strip
        axes.plot([0, 0.1], [y, y], color="black", linewidth=2, solid_capstyle="butt")
        axes.text(0.05, y + 0.4 * strip, "10 cm", ha="center", va="top")
        return axes


def broken_line(
    axes: Axes,
    surface: Surface,
    view: View,
    path: Float[np.ndarray, "points 3"],
    *,
    hidden_style: Any,
    label: str = "",
    **look: Any,
) -> None:
    """A path in the root on the picture: solid where it is seen, broken and faint where the robot covers it."""
    line, covered = project(path, view)[0], hidden(path, surface, view)[:, None]
    axes.plot(*np.where(covered, np.nan, line).T, **look, label=label or "_seen")
    axes.plot(*np.where(covered, line, np.nan).T, **look, linestyle=hidden_style, alpha=0.6)


def _upper_body(surface: Surface, view: View, shown: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "corners 2"]:
    """What of the robot is above its root, where all that is shown on it is; or else all of it."""
    flat, places = project(surface.corners, view)[0].reshape(-1, 2), project(shown, view)[0]
    root = float(project(np.zeros(3), view)[0][1])
    above = len(places) and root < np.nanmin(places[:, 1])
    return np.concatenate([flat[flat[:, 1] >= root] if above else flat, places])


def _taxels(
    axes: Axes, body: Embodiment, surface: Surface, view: View, taxels: Float[np.ndarray, "taxels 3"], size: float
) -> None:
    flat, covered = project(taxels, view)[0], hidden(taxels, surface, view, margin=_TAXEL_MARGIN)
    dots(axes, flat[~covered], size=size / 5, color="0.15", zorder=2)
    axes.plot([], [], linestyle="", marker=".", color="0.15", markersize=3, label="taxels")
    behind = False
    for name, taxel in body.require_skin().landmarks.items():
        look = landmark_look(name)
        axes.plot([], [], **look, markersize=5, label=drawn(name))
        if covered[taxel]:
            behind = True
            look |= {"markerfacecolor": "none", "markeredgecolor": look["color"], "markeredgewidth": 0.9}
        axes.plot(*flat[taxel], **look, markersize=size, zorder=4)
    if behind:
        hollow: dict[str, Any] = {"marker": "o", "markerfacecolor": "none", "markeredgecolor": "0.35", "linestyle": ""}
        axes.plot([], [], **hollow, markersize=5, label="hollow: behind the hand")


def _joint_axes(axes: Axes, body: Embodiment, view: View, window: Window, *, named: bool) -> None:
    """Every joint a ring, the felt ones with their axis and number; their names beside the drawing, a line to each."""
    poses = link_poses(body.robot, {})
    tall = window[3] - window[2]
    felt: dict[str, Float[np.ndarray, "2"]] = {}
    for joint in body.robot.moving_joints:
        origin, along = poses[joint.child][:3, 3], poses[joint.child][:3, :3] @ joint.axis
        place = project(origin, view)[0]
        if joint.name not in body.joints:
            axes.plot(*place, "o", color=_OTHER, markerfacecolor="white", markersize=2.6, markeredgewidth=0.7, zorder=3)
            continue
        felt[joint.name] = place
        ends = project(origin + np.outer([-0.05 * tall, 0.05 * tall], along), view)[0]
        axes.plot(*ends.T, color=_FELT, linewidth=1.1, solid_capstyle="butt", zorder=4)
        axes.plot(*place, "o", color=_FELT, markersize=3.6, zorder=5, label=UNLISTED + drawn(joint.name))
    if not named:
        return
    x, step = window[1] + 0.02 * tall, 0.055 * tall
    # Names in the order of height, then of the chain, each beside its joint where there is room.
    ordered = sorted(felt.items(), key=lambda item: -round(float(item[1][1]), 4))
    y = float(ordered[0][1][1]) + 2 * step
    for name, place in ordered:
        y = y - step if name == ordered[0][0] else min(y - step, float(place[1]))
        text = axes.annotate(
            f"{body.joints.index(name) + 1}  {drawn(name)}",
            (float(place[0]), float(place[1])),
            (x, y),
            va="center",
            fontsize=6.5,
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": _FELT, "shrinkA": 1, "shrinkB": 1},
        )
        text.set_path_effects(halo(1.5))
