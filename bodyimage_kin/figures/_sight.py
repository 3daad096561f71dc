"""What the eye sees of a hand's path: lines of sight through the virtual screen, from outside, and the image itself."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, Polygon

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.figures._images import Plane, shaped
from bodyimage_kin.figures._layout import drawing_on
from bodyimage_kin.figures._marks import UNLISTED, bare, halo, scale_bar
from bodyimage_kin.figures._rasteriser import draw_surface, on_white, towards_light
from bodyimage_kin.figures._robot import PATH, broken_line
from bodyimage_kin.figures._style import landmark_look
from bodyimage_kin.figures._views import (
    View,
    Window,
    camera_pose,
    clearest,
    facing,
    posed,
    project,
    window_of,
)
from bodyimage_kin.figures.labels import drawn
from bodyimage_kin.figures.visuals import Surface

_MM = 1000.0
_IMAGE: dict[str, Any] = {"color": "#2f9bd8", "linewidth": 1.4}
_RAY: dict[str, Any] = {"color": "0.35", "linewidth": 0.5}
_SENSES: dict[bool, Any] = {True: "-", False: (0, (2.5, 1.5))}
"""Line style of what turns clockwise, as the eye sees it, and of what does not."""
_PANE, _PANE_EDGE, _OPACITY = (0.55, 0.72, 0.90, 1.0), "#1f4e79", 0.5


def line_of_sight(body: Embodiment, q: ArrayLike, ax: Axes | None = None) -> Axes:
    """The robot with its hand on a path that it sees, and the virtual screen between hand and eye (Fig. 7).

    Args:
        body: The embodiment; its camera is a virtual screen.
        q: (time, p) felt postures along the path, ``recording.true_q[trial]``; NaN rows are left out.
        ax: Axes to draw on, in metres; None: those of a new figure.

    Returns:
        The axes: the robot at the first posture, obliquely from the side where it covers less of the path; the path,
        lines of sight, and the path's image on the screen.

    Raises:
        InvalidArray: Not postures of this body, or fewer than three.
        InvalidConfig: The camera is no virtual screen.
        InvalidGeometry: Visuals that cannot be read.
        NotVisible: A hand that has no image.
    """
    felt, centres, images, in_camera = _along(body, q)
    h_z = body.camera.screen.distance
    pose = camera_pose(body, felt[0])
    surface = posed(body, felt[0], body.robot.link_names)
    half = _half_of_screen(body, felt[0], images)
    corners = _in_root(pose, np.array([[-half, -half], [half, -half], [half, half], [-half, half]]), h_z)
    middle = body.skin.positions.numpy().mean(0) if body.skin is not None else pose[:3, 3]
    straight = facing(body)[0]
    view = clearest([View(middle, straight + turn, 14.0) for turn in (-58, 58)], [(surface, centres)])
    window = _window(body, surface, view, np.concatenate([centres, corners]))
    faint: Any = (0, (1, 1.5))
    with drawing_on(ax, height=3.85) as axes:
        _draw_with_pane(axes, surface, view, window, corners)
        edge = np.concatenate([np.linspace(a, b, 40) for a, b in itertools.pairwise([*corners, corners[0]])])
        broken_line(axes, surface, view, edge, hidden_style=faint, color=_PANE_EDGE, linewidth=0.9, zorder=3)
        broken_line(
            axes, surface, view, centres, hidden_style=faint, **PATH, zorder=5, label="path of the hand's centre"
        )
        on_screen = project(_in_root(pose, images, h_z), view)[0]
        axes.plot(*on_screen.T, **_IMAGE, zorder=4, label="image of the hand")
        pane = f"virtual screen, z = {h_z * _MM:g} mm"
        at_screen = project(corners, view)[0][[0, 0, 0]]  # of no size: for the legend
        axes.add_patch(Polygon(at_screen, facecolor=_PANE, alpha=_OPACITY, edgecolor=_PANE_EDGE, label=pane))
        eye = pose[:3, 3]
        for index in np.linspace(0, _once_round(in_camera), 5).astype(int)[:-1]:
            ray = np.linspace(eye, centres[index], 60)
            broken_line(axes, surface, view, ray, hidden_style=faint, **_RAY, zorder=3)
        axes.plot([], [], **_RAY, label="line of sight")
        axes.plot(*project(centres[0], view)[0], "o", color=PATH["color"], markersize=4, zorder=7)
        optical: dict[str, Any] = {"marker": "x", "color": "black", "markersize": 4.5, "linestyle": ""}
        axes.plot(*project(eye, view)[0], **optical, zorder=7, label="optical centre")
        low, high = in_camera.min(0), in_camera.max(0)
        for clockwise in (True, False):
            arc = _arc(((low + high) / 2)[:2], (high - low)[:2] / 2, clockwise, 0.17)
            depth = np.full((len(arc), 1), (low[2] + high[2]) / 2)
            points = np.concatenate([arc, depth, np.ones((len(arc), 1))], 1) @ pose.T
            _arrow(axes, project(points[:, :3], view)[0], clockwise)
        scale_bar(axes, 0.05)
        bare(axes)
        return axes


def hand_image(body: Embodiment, q: ArrayLike, ax: Axes | None = None) -> Axes:
    """The image of a hand's path as the eye sees it, and where the image would be while it touches a landmark (Fig. 7).

    Args:
        body: The embodiment.
        q: (time, p) felt postures along the path; NaN rows are left out.
        ax: Axes to draw on; None: those of a new figure.

    Returns:
        The axes in the camera's unit (metres as millimetres), y down.

    Raises:
        InvalidArray: Not postures of this body, or fewer than three.
        NotVisible: A hand that has no image.
    """
    felt, _, images, _ = _along(body, q)
    plane = Plane(tuple(body.camera.model.names), body.camera.model.unit)
    path = images[:, :2] * plane.factor
    landmarks = {name: place[:2] * plane.factor for name, place in _landmark_images(body, felt[0]).items()}
    middle, radius = (path.max(0) + path.min(0)) / 2, 0.5 * float(np.ptp(path, axis=0).mean())
    with drawing_on(ax, height=3.6) as axes:
        plane.frame(axes)
        axes.plot(*path.T, **_IMAGE, label="image of the hand")
        axes.plot(*path[0], "o", color=PATH["color"], markersize=4, zorder=5)
        # Round about something, a path has a sense.
        for clockwise in (True, False) if np.ptp(path, axis=0).max() < 2 * np.ptp(path, axis=0).min() else ():
            _arrow(axes, _arc(middle, np.full(2, radius), clockwise, 0.16), clockwise)
            away = 1.22 * radius if clockwise else 0.62 * radius
            text, va = ("clockwise", "bottom") if clockwise else ("anticlockwise", "top")
            axes.annotate(text, middle - [0, away], ha="center", va=va)
        for name, place in landmarks.items():
            look = landmark_look(name) | {"markerfacecolor": "white", "markeredgecolor": landmark_look(name)["color"]}
            axes.plot(*place, **look | {"markeredgewidth": 1.0}, markersize=5, zorder=3, label=UNLISTED + drawn(name))
            at = (float(place[0]), float(place[1]))
            below: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "va": "top", "fontsize": 6.5}
            axes.annotate(drawn(name), at, (0, -4), **below, path_effects=halo())
        if landmarks:
            hollow: dict[str, Any] = {"marker": "D", "color": "0.4", "markerfacecolor": "white", "linestyle": ""}
            axes.plot([], [], **hollow, label="hollow: hand on a landmark, unseen")
        if body.m == 2 and plane.unit == "m":
            half = _half_of_screen(body, felt[0], images) * plane.factor
            axes.set(xlim=(-half, half), ylim=(half, -half))
        axes.set_facecolor((*_PANE[:3], 0.18))
        axes.spines[:].set(visible=True, color=_PANE_EDGE)
        return axes


def _along(
    body: Embodiment, q: ArrayLike
) -> tuple[torch.Tensor, Float[np.ndarray, "time 3"], Float[np.ndarray, "time m"], Float[np.ndarray, "time 3"]]:
    """Finite postures; the hand's centre in the root [m], its image [unit], its centre in the camera [m]."""
    postures = shaped(q, "q", None, body.p)
    postures = postures[np.isfinite(postures).all(1)]
    if len(postures) < 3:
        raise InvalidArray(f"q has {len(postures)} finite postures; a path takes at least 3")
    felt = torch.from_numpy(postures)
    with torch.no_grad():
        centres, images, in_camera = body.hand_position(felt), body.hand_image(felt), body.hand_in_camera(felt)
    return felt, centres.numpy(), images.numpy(), in_camera.numpy()


def _landmark_images(body: Embodiment, q: torch.Tensor) -> dict[str, Float[np.ndarray, "m"]]:
    """Where the hand's image would be while it touches each landmark [unit]; those that have none are left out."""
    if body.skin is None or not body.skin.landmarks:
        return {}
    with torch.no_grad():
        root_T_skin = body.kinematics.pose(q, body.skin.link).numpy()
        camera_T_skin = torch.from_numpy(np.linalg.solve(camera_pose(body, q), root_T_skin))
        centres = body.touch_centres(list(body.skin.landmarks.values()))
        images = body.camera.model.project(centres @ camera_T_skin[:3, :3].T + camera_T_skin[:3, 3]).numpy()
    return {name: image for name, image in zip(body.skin.landmarks, images, strict=True) if np.isfinite(image).all()}


def _half_of_screen(body: Embodiment, q: torch.Tensor, images: Float[np.ndarray, "time m"]) -> float:
    """Half the side of a square screen that shows all images [unit]."""
    return 1.25 * float(np.abs(np.stack([*images, *_landmark_images(body, q).values()])).max())


def _arc(
    middle: Float[np.ndarray, "2"], radii: Float[np.ndarray, "2"], clockwise: bool, beside: float
) -> Float[np.ndarray, "points 2"]:
    """A piece of a circle above another: outside of it what turns clockwise to the eye, inside what does not."""
    # y runs down, so a growing angle turns clockwise.
    angles = np.radians(np.linspace(-128, -57, 40) if clockwise else np.linspace(-57, -128, 40))
    return middle + np.stack([np.cos(angles), np.sin(angles)], 1) * radii * (1 + (beside if clockwise else -beside))


def _arrow(axes: Axes, arc: Float[np.ndarray, "points 2"], clockwise: bool) -> None:
    name = "clockwise, to the eye" if clockwise else "anticlockwise, to the eye"
    axes.plot(*arc.T, color="black", linewidth=0.9, linestyle=_SENSES[clockwise], zorder=6, label=name)
    head: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 8, "color": "black", "shrinkA": 0, "shrinkB": 0}
    axes.add_patch(FancyArrowPatch(tuple(arc[-3]), tuple(arc[-1]), **head, zorder=6))


def _draw_with_pane(
    axes: Axes, surface: Surface, view: View, window: Window, corners: Float[np.ndarray, "4 3"]
) -> None:
    """The robot, and the screen as a pane of glass in it: what is in front of the pane covers it."""
    first, second = corners[[0, 1, 2]], corners[[0, 2, 3]]
    panes = np.stack([first, second, first[::-1], second[::-1]])
    glazed = Surface(
        np.concatenate([surface.corners, panes]),
        # Normals along the light: the pane has its own colour from both sides.
        np.concatenate([surface.normals, np.broadcast_to(towards_light(view), panes.shape)]),
        np.concatenate([surface.colours, np.broadcast_to(_PANE, (4, 4))]),
        np.concatenate([surface.links, np.zeros(4, dtype=np.int64)]),
        surface.link_names,
    )
    painted = draw_surface(axes, surface, view, window=window)
    pane = draw_surface(axes, glazed, view, window=window)
    behind, before = (on_white(np.asarray(image.get_array())) for image in (painted, pane))
    painted.set_data((1 - _OPACITY) * behind + _OPACITY * before)
    pane.remove()


def _in_root(
    pose: Float[np.ndarray, "4 4"], places: Float[np.ndarray, "points 2"], depth: float
) -> Float[np.ndarray, "points 3"]:
    """Places on the screen, in the root [m]."""
    points = np.concatenate([places, np.full((len(places), 1), depth), np.ones((len(places), 1))], axis=1)
    return (points @ pose.T)[:, :3]


def _once_round(in_camera: Float[np.ndarray, "time 3"]) -> int:
    """Samples until the hand has gone round once, or all of them."""
    aside = in_camera[:, :2] - (in_camera[:, :2].max(0) + in_camera[:, :2].min(0)) / 2
    turned = np.abs(np.unwrap(np.arctan2(aside[:, 1], aside[:, 0])) - np.arctan2(aside[0, 1], aside[0, 0]))
    round_once = np.flatnonzero(turned >= 2 * np.pi)
    return int(round_once[0]) if len(round_once) else len(in_camera) - 1


def _window(body: Embodiment, surface: Surface, view: View, points: Float[np.ndarray, "points 3"]) -> Window:
    """The skin's link, the hand's, the points, and some of what is below them."""
    links = [body.hand.link] + ([body.skin.link] if body.skin is not None else [])
    shown = [surface.link_names.index(link) for link in links]
    drawn = surface.corners[np.isin(surface.links, shown)].reshape(-1, 3)
    return window_of(project(np.concatenate([drawn, points]), view)[0], 0.05, below=3.0)
