"""The figures of a body: its postures, its specification, its face, its circle, drawn from its own geometry.

Counterparts of Figs. 3 to 7 of Fuke, Ogino and Asada (2007). Nothing is known here but the embodiment: whatever is
drawn, named or numbered is read from it. The figures of scores beside them are of the room ``score_figures``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.figures import style
from bodyimage_kin.figures._circle_figure import seen_circle as seen_circle
from bodyimage_kin.figures._panels import numbers, scale_bar, within_one
from bodyimage_kin.figures._screen_figure import virtual_screen as virtual_screen
from bodyimage_kin.figures._views import facing, felt_links, posed
from bodyimage_kin.figures.drawing import Surface, View, Window, draw_surface, hidden, project
from bodyimage_kin.figures.score_figures import attribution_bars as attribution_bars
from bodyimage_kin.figures.score_figures import dose_response as dose_response
from bodyimage_kin.figures.score_figures import posture_map as posture_map
from bodyimage_kin.figures.specification import Limb, limbs, link_masses
from bodyimage_kin.figures.visuals import link_poses

_POSTURE_PIXELS = 200  # to the inch, as figures are saved
_FELT, _OTHER = "#882255", "0.45"
_ROW = 0.125
"""Height of a row of the table [inch]."""


@style.style()
def posture_grid(body: Embodiment, postures: ArrayLike, *, view: View | None = None) -> Figure:
    """The representative postures of a posture map, as the robot that takes them (Fig. 3 of the paper).

    Args:
        body: The embodiment.
        postures: (rows, columns, p) felt joints [rad or m], ``BodyImage.postures``.
        view: Where they are seen from; None: obliquely, from the side where the hand is covered least.

    Returns:
        A grid of drawings of one scale, rows and columns as in the array; drawn are the links that felt joints move,
        and the one that bears the skin. A bar shows the scale.

    Raises:
        InvalidArray: Not postures of this embodiment on a grid.
        InvalidGeometry: Visuals that cannot be read.
    """
    grid = numbers(postures, "postures", None, None, body.p)
    rows, columns = grid.shape[:2]
    links = felt_links(body)
    drawn = [posed(body, posture, links) for posture in grid.reshape(-1, body.p)]
    hands = body.hand_position(torch.from_numpy(grid.reshape(-1, body.p))).detach().numpy()
    view = view or _clearest(body, drawn, hands)
    window = _common_window(drawn, view)
    # The drawings are as wide as the page and keep their proportions.
    gap, side, top, bottom = 0.02, 0.32, 0.32, 0.25
    width = (style.DOUBLE_COLUMN - side) / columns
    height = width * (window[3] - window[2]) / (window[1] - window[0])
    figure = style.new_figure(style.DOUBLE_COLUMN, top + rows * height + bottom)
    figure.set_layout_engine("none")
    size = figure.get_size_inches()
    for index, surface in enumerate(drawn):
        row, column = divmod(index, columns)
        corner = (side + column * width, bottom + (rows - 1 - row) * height)
        box = (*(corner / size), (width - gap) / size[0], (height - gap) / size[1])
        axes = figure.add_axes(box, label=f"{row},{column}")
        painted = draw_surface(
            axes, surface, view, window=window, pixels=round(_POSTURE_PIXELS * (max(width, height) - gap))
        )
        # Steps too fine to see, kept by drawing pixel on pixel: many small pictures in a small file.
        painted.set_data(np.round(np.asarray(painted.get_array()) * 48) / 48)
        painted.set_interpolation("nearest")
        axes.set(xticks=[], yticks=[])
        axes.spines[:].set(visible=True, linewidth=0.3, color="0.8")
        if row == 0:
            axes.set_title(f"{column + 1}", pad=2)
        if column == 0:
            axes.set_ylabel(f"{row + 1}", rotation=0, ha="right", va="center", labelpad=3)
    figure.text((side + columns * width / 2) / size[0], 1 - 0.02 / size[1], "column of the map", ha="center", va="top")
    figure.text(0.02 / size[0], (bottom + rows * height / 2) / size[1], "row of the map", rotation=90, va="center")
    # A strip below, in metres as the drawings are.
    strip = figure.add_axes(
        (side / size[0], 0.03 / size[1], (width - gap) / size[0], 0.8 * bottom / size[1]), label="scale"
    )
    metres = window[1] - window[0]
    strip.set(xlim=(0, metres), ylim=(0, 0.8 * metres * bottom / (width - gap)))
    strip.set_axis_off()
    scale_bar(strip, 0.1)
    return figure


@style.style()
def specification(body: Embodiment) -> Figure:
    """The robot from the front and from the side, its felt joints marked, and its specification (Fig. 4 of the paper).

    Args:
        body: The embodiment; drawn at zero posture.

    Returns:
        Drawings with the axes of the felt joints, numbered as in the table beside them: joint limits, the length from a
        joint to the next, and the mass that moves between the two, limb by limb.

    Raises:
        InvalidGeometry: Visuals that cannot be read.
    """
    parts = limbs(body.robot)
    count = sum(len(limb.joints) + 1.35 for limb in parts) + 3
    surface = posed(body, None, body.robot.link_names)
    forward = facing(body)
    height = max(3.4, count * _ROW + 0.1)
    figure = style.new_figure(style.DOUBLE_COLUMN, height)
    figure.set_layout_engine("none")
    size = figure.get_size_inches()
    views = [View.around(surface.corners.mean((0, 1)), azimuth=forward + turn, elevation=0) for turn in (0, 90)]
    # Below the feet there is room for the bar.
    windows = [(a, b, c - 0.07 * (d - c), d) for a, b, c, d in (_common_window([surface], view) for view in views)]
    # One scale for both, the taller of page and robot deciding.
    names = 0.95
    room = style.DOUBLE_COLUMN - 3.15 - names - 0.1
    scale = min((height - 0.35) / (windows[0][3] - windows[0][2]), room / sum(w[1] - w[0] for w in windows))
    left = 0.02
    for letter, title, view, window in zip("ab", ("front", "left side"), views, windows, strict=True):
        width, tall = (window[1] - window[0]) * scale, (window[3] - window[2]) * scale
        axes = figure.add_axes(
            (left / size[0], (height - 0.25 - tall) / size[1], width / size[0], tall / size[1]), label=title
        )
        draw_surface(axes, surface, view, window=window, pixels=round(200 * tall))
        axes.set_axis_off()
        axes.set_title(f"({letter}) {title}", loc="left")
        _joint_axes(axes, body, view, window, named=letter == "a")
        left += width + (names if letter == "a" else 0)
        if letter == "a":
            scale_bar(axes, 0.1)
    table = figure.add_axes(((size[0] - 3.1) / size[0], 0, 3.1 / size[0], (height - 0.05) / size[1]), label="table")
    _table(table, body, parts, count, float(np.ptp(surface.corners[..., 2])))
    return figure


@style.style()
def face(body: Embodiment) -> Figure:
    """The face from near, with its taxels and the landmarks among them (Fig. 5 of the paper).

    Args:
        body: The embodiment.

    Returns:
        The face from the front and obliquely: a dot for each taxel, another mark for those at and next to a landmark, a
        ring about the reference taxel.

    Raises:
        InvalidGeometry: Visuals that cannot be read.
    """
    skin = body.require_skin()
    surface = posed(body, body.felt_home, (skin.link,))
    figure = style.new_figure(style.DOUBLE_COLUMN, 3.75)
    azimuth, elevation = facing(body), _elevation(body)
    places = skin.positions.numpy()
    middle = places.mean(0)
    for axes, title, turn in zip(
        figure.subplots(1, 2), ("(a) from the front", "(b) from the left"), (0, 50), strict=True
    ):
        view = View.around(middle, azimuth=azimuth + turn, elevation=elevation + (0 if turn == 0 else 8))
        flat, _ = project(places, view)
        half = 0.68 * float(
            np.ptp(project(places, View.around(middle, azimuth=azimuth, elevation=elevation))[0], 0).max()
        )
        draw_surface(axes, surface, view, window=(-half, half, -half, half))
        _taxels(axes, body, flat, hidden(places, surface, view, margin=0.006))
        scale_bar(axes, 0.01)
        axes.set(xticks=[], yticks=[])
        axes.spines[:].set_visible(False)
        axes.set_title(title, loc="left")
    rows, columns = skin.shape
    handles = [
        Line2D([], [], linestyle="", marker=".", color="0.1", markersize=3, label=f"taxels, {rows} \u00d7 {columns}")
    ]
    handles += [
        Line2D([], [], **style.landmark(name), markersize=4, label=style.label(name)) for name in skin.landmarks
    ]
    handles.append(Line2D([], [], **_RING, markersize=8, label="reference taxel"))
    figure.legend(handles=handles, loc="outside lower center", ncols=6)
    return figure


_RING: dict[str, Any] = {"linestyle": "", "marker": "o", "markerfacecolor": "none", "markeredgecolor": "black"}
_RING |= {"markeredgewidth": 1.2}
_HALO = [withStroke(linewidth=3, foreground="white")]


def _taxels(axes: Axes, body: Embodiment, flat: Float[np.ndarray, "taxels 2"], covered: np.ndarray) -> None:
    numbered = np.arange(body.require_skin().count).reshape(body.require_skin().shape)
    marked = {
        name: numbered[within_one(name, taxel, body.require_skin().shape)].ravel()
        for name, taxel in body.require_skin().landmarks.items()
    }
    plain = np.setdiff1d(numbered.ravel(), np.concatenate([np.empty(0, int), *marked.values()]))
    style.dots(axes, flat[plain[~covered[plain]]], size=1.6, color="0.1", zorder=2)
    for name, taxels in marked.items():
        look = style.landmark(name) | {"markersize": 4.2, "zorder": 3}
        axes.plot(*flat[taxels[~covered[taxels]]].T, **look, label=name)
    axes.plot(
        *flat[body.require_skin().reference], **_RING, markersize=9, zorder=4, label="reference", path_effects=_HALO
    )


def _joint_axes(axes: Axes, body: Embodiment, view: View, window: Window, *, named: bool) -> None:
    """Every joint a ring, the felt ones with their axis and number; their names beside the drawing, a line to each."""
    robot = body.robot
    poses = link_poses(robot, {})
    half = 0.05 * (window[3] - window[2])
    felt: dict[str, Float[np.ndarray, "2"]] = {}
    for joint in robot.moving_joints:
        origin, along = poses[joint.child][:3, 3], poses[joint.child][:3, :3] @ joint.axis
        place = project(origin, view)[0]
        if joint.name not in body.joints:
            axes.plot(*place, "o", color=_OTHER, markerfacecolor="white", markersize=2.6, markeredgewidth=0.7, zorder=3)
            continue
        felt[joint.name] = place
        ends = project(origin + np.outer([-half, half], along), view)[0]
        axes.plot(*ends.T, color=_FELT, linewidth=1.1, solid_capstyle="butt", zorder=4)
        axes.plot(*place, "o", color=_FELT, markersize=3.6, zorder=5)
    if not named:
        return
    top = max(place[1] for place in felt.values())
    step = 0.055 * (window[3] - window[2])
    x = window[1] + 0.02 * (window[3] - window[2])
    y = top
    # Names in the order of height, then of the chain, each beside its joint where there is room.
    for index, (name, place) in enumerate(sorted(felt.items(), key=lambda item: -round(float(item[1][1]), 4))):
        number = body.joints.index(name) + 1
        y = top + step if index == 0 else min(y - step, float(place[1]))
        text = axes.annotate(
            f"{number}  {style.label(name)}",
            (float(place[0]), float(place[1])),
            (x, y),
            va="center",
            fontsize=6.5,
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": _FELT, "shrinkA": 1, "shrinkB": 1},
        )
        text.set_path_effects([withStroke(linewidth=1.5, foreground="white")])


def _table(axes: Axes, body: Embodiment, parts: Sequence[Limb], count: float, height: float) -> None:
    """The specification as text on axes whose unit is a row."""
    axes.set(xlim=(0, 1), ylim=(count, 0))
    axes.set_axis_off()
    right = (0.60, 0.83, 1.0)
    titles = ("limits [\N{DEGREE SIGN}]", "length [mm]", "mass [g]")
    size: dict[str, Any] = {"fontsize": 6.5, "va": "center"}
    axes.text(0.055, 0.5, "joint", **size, weight="bold")
    for x, title in zip(right, titles, strict=True):
        axes.text(x, 0.5, title, **size, ha="right", weight="bold")
    axes.axhline(1, color="black", linewidth=0.6)
    y = 1.0
    for limb in parts:
        title = f"{style.label(limb.base)} to {style.label(limb.tip)}"
        freedom = f"{limb.degrees_of_freedom} degree{'s' if limb.degrees_of_freedom != 1 else ''} of freedom"
        y += 0.35
        axes.text(0.0, y + 0.5, title, **size, style="italic")
        axes.text(1.0, y + 0.5, freedom, **size, style="italic", ha="right")
        y += 1
        for row in limb.joints:
            felt = row.joint.name in body.joints
            look = size | ({"color": _FELT, "weight": "bold"} if felt else {})
            if felt:
                axes.text(0.025, y + 0.5, f"{body.joints.index(row.joint.name) + 1}", **look, ha="center")
            axes.text(0.055, y + 0.5, style.label(row.joint.name), **look)
            length = "\N{EN DASH}" if row.length is None else f"{1000 * row.length:.0f}"
            mass = "\N{EN DASH}" if row.mass is None else f"{1000 * row.mass:.0f}"
            for x, value in zip(right, (row.limits, length, mass), strict=True):
                axes.text(x, y + 0.5, value, **look, ha="right")
            y += 1
    axes.axhline(y + 0.1, color="black", linewidth=0.6)
    masses = link_masses(body.robot)
    total = f", {sum(masses.values()):.2f} kg" if masses else ""
    axes.text(0.0, y + 0.65, f"{body.robot.n} degrees of freedom{total}, {height:.2f} m tall. Numbered: felt.", **size)
    axes.text(0.0, y + 1.55, "Length: to the next joint. Mass: of what lies between the two.", **size)


def _clearest(body: Embodiment, drawn: Sequence[Surface], hands: Float[np.ndarray, "postures 3"]) -> View:
    """Obliquely from the side on which fewer hands are covered, or else on which the arm is not."""
    middle = np.concatenate([surface.corners.mean((0, 1))[None] for surface in drawn]).mean(0)
    views = [View.around(middle, azimuth=facing(body) + turn, elevation=8) for turn in (-40, 40)]
    some = range(0, len(drawn), max(1, len(drawn) // 8))
    radius = float(body.hand.radius)
    return min(
        views, key=lambda view: sum(int(hidden(hands[k][None], drawn[k], view, margin=2 * radius)[0]) for k in some)
    )


def _elevation(body: Embodiment) -> float:
    """How steeply the face looks up, the robot at home [degrees]."""
    forward = body.require_skin().root_T_link[:3, :3].numpy() @ body.require_skin().patch.forward
    elevation = float(np.degrees(np.arcsin(np.clip(forward[2], -1, 1))))
    if abs(elevation) > 80:
        raise InvalidConfig(f"the skin looks {elevation:.0f} degrees up; only upright faces are drawn")
    return elevation


def _common_window(surfaces: Sequence[Surface], view: View) -> Window:
    flat = np.concatenate([project(surface.corners, view)[0].reshape(-1, 2) for surface in surfaces])
    (left, bottom), (right, top) = flat.min(0), flat.max(0)
    edge = 0.03 * max(right - left, top - bottom)
    return float(left - edge), float(right + edge), float(bottom - edge), float(top + edge)
